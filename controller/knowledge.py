"""What the robot knows of itself."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.map_exploration import Deflections
from controller.selforganisation.sensory_motor_map import SensoryMotorMap, fuse, normal_weights
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

    def result(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Facts and arrays about what was explored, for the results of a run."""
        facts: dict[str, Any] = {"map_problems": self.map_problems}
        arrays: dict[str, NDArray[Any]] = {}
        if self.structure is not None:
            structure = self.structure
            facts["structure"] = {
                "parts": structure.parts,
                "joints": structure.joints,
                "parent_part": structure.parent_part,
                "parent_joint": structure.parent_joint,
                "problems": structure.problems,
            }
            arrays["activity"] = structure.activity
        if len(self.map):
            arrays |= {"map_pose_rad": self.map.poses_rad, "map": self.map.weights}
        return facts, arrays

    def activity(self, n_cells: int, n_dofs: int) -> NDArray[np.bool_]:
        """(S, D) which DoF moves which cell; any may before the structure is explored."""
        if self.structure is None:
            return np.ones((n_cells, n_dofs), dtype=np.bool_)
        return self.structure.activity

    def learn_map(self, found: Deflections) -> None:
        """Adds the map of an explored pose, fused with the activity of the structure: equation (3)."""
        weights = normal_weights(found.deflection_m)
        self.map_problems += found.problems
        self.map.add(found.pose_rad, fuse(self.activity(*weights.shape), weights, self.cut))

    def learn_pose(self, name: str, found: Deflections) -> None:
        """Adds a key pose with its map, in the place of an older one of that name."""
        if name in self.poses:
            self.map.forget(self.poses[name])
        self.poses[name] = found.pose_rad
        self.learn_map(found)
