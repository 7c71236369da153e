"""What the robot knows of itself."""

from dataclasses import dataclass, field

from controller.selforganisation.sensory_motor_map import SensoryMotorMap
from controller.selforganisation.structure import Structure

__all__ = ["Knowledge"]


@dataclass
class Knowledge:
    """Found by exploration, used by reactions; no model of the robot in it.

    Attributes:
        cut: Cells whose fused vector is shorter cannot move along their normal.
        structure: From the structural exploration; None before.
        map: Sensory-motor maps by pose.
        map_problems: What the exploration of the map could not measure.
    """

    cut: float
    structure: Structure | None = None
    map: SensoryMotorMap = field(default_factory=SensoryMotorMap)
    map_problems: tuple[str, ...] = ()
