"""Self-model of the robot: structure, sensory-motor maps, key poses and touch areas."""

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
    """Self-model acquired by exploration and by teaching, without a given robot model.

    Attributes:
        cut: Norm of the fused map row below which a cell cannot move along its normal.
        structure: Kinematic structure from structural exploration; None before.
        map: Sensory-motor maps by pose.
        map_problems: Measurements that the exploration of the map lacks, one line each.
        poses: Key poses by name, positions (D,) [rad].
        areas: Touch areas by label, cell indices (n,) in ascending order.
        parameters: Tuned state parameters by name.
    """

    cut: float
    structure: Structure | None = None
    map: SensoryMotorMap = field(default_factory=SensoryMotorMap)
    map_problems: tuple[str, ...] = ()
    poses: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    areas: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)

    def result(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return facts and arrays of the exploration, for the results of a run."""
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
        """Return the activity matrix (S, D); all true before the structure is explored."""
        if self.structure is None:
            return np.ones((n_cells, n_dofs), dtype=np.bool_)
        return self.structure.activity

    def learn_map(self, found: Deflections) -> None:
        """Add the map of an explored pose, fused with the activity matrix: equation (3) of [M14]."""
        weights = normal_weights(found.deflection_m)
        self.map_problems += found.problems
        self.map.add(found.pose_rad, fuse(self.activity(*weights.shape), weights, self.cut))

    def learn_pose(self, name: str, found: Deflections) -> None:
        """Add a key pose with its map; replace an older pose of the same name."""
        if name in self.poses:
            self.map.forget(self.poses[name])
        self.poses[name] = found.pose_rad
        self.learn_map(found)
