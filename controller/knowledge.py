"""What the robot knows of itself."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.sensory_motor_map import SensoryMotorMap
from controller.selforganisation.structure import Structure

__all__ = ["Knowledge"]


@dataclass
class Knowledge:
    """Found by exploration or taught by touch, used by reactions; no model of the robot in it.

    Attributes:
        cut: Cells whose fused vector is shorter cannot move along their normal.
        structure: From the structural exploration; None before.
        map: Sensory-motor maps by pose.
        map_problems: What the exploration of the map could not measure.
        poses: Key poses by name, positions (D,) [rad].
        areas: Touch areas by label, numbers (n,) of their cells in ascending order.
        parameters: Tuned numbers by name.
    """

    cut: float
    structure: Structure | None = None
    map: SensoryMotorMap = field(default_factory=SensoryMotorMap)
    map_problems: tuple[str, ...] = ()
    poses: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    areas: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
