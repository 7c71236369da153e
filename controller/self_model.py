"""Self-model of the robot: structure, sensory-motor maps, key poses and touch areas."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.deflections import Deflections
from controller.selforganisation.kinematic_structure import KinematicStructure, complete_structure
from controller.selforganisation.sensory_motor_map import SensoryMotorMap, fuse_with_activity, normal_weights

__all__ = ["SelfModel"]


@dataclass
class SelfModel:
    """Self-model acquired by exploration and by teaching, without a given robot model.

    Attributes:
        min_row_norm: Norm of the fused map row below which a cell cannot move along its normal.
        min_lever_m: Lever arm above which acceleration tells that a DoF moves a cell [m].
        structure: Kinematic structure from structural exploration; None before.
        sensory_motor_map: Sensory-motor maps by pose.
        map_problems: Measurements that the exploration of the map lacks, one line each.
        poses: Key poses by name, positions (D,) [rad].
        areas: Touch areas by label, cell indices (n,) in ascending order.
        parameters: Tuned state parameters by name.
        dof_names: Names of the DoFs in messages; their numbers without.
        cell_names: Names of the cells in messages likewise.
    """

    min_row_norm: float
    min_lever_m: float
    structure: KinematicStructure | None = None
    sensory_motor_map: SensoryMotorMap = field(default_factory=SensoryMotorMap)
    map_problems: tuple[str, ...] = ()
    poses: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    areas: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    dof_names: Sequence[str] = ()
    cell_names: Sequence[str] = ()

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
        if len(self.sensory_motor_map):
            arrays |= {
                "map_pose_rad": self.sensory_motor_map.poses_rad,
                "map": self.sensory_motor_map.weights,
            }
        return facts, arrays

    def activity(self, n_cells: int, n_dofs: int) -> NDArray[np.bool_]:
        """Return the activity matrix (S, D); all true before the structure is explored."""
        if self.structure is None:
            return np.ones((n_cells, n_dofs), dtype=np.bool_)
        return self.structure.activity

    def add_map(self, deflections: Deflections) -> None:
        """Add the map of an explored pose, fused with the activity matrix: equation (3) of [M14].

        What gravity did not tell of the structure is completed by the accelerations.
        """
        if self.structure is not None:
            self.structure = complete_structure(
                self.structure,
                deflections.accelerates(self.min_lever_m),
                deflections.measured,
                dof_names=self.dof_names,
                cell_names=self.cell_names,
            )
        weights = normal_weights(deflections.deflection_m)
        self.map_problems += deflections.problems
        self.sensory_motor_map.add(
            deflections.pose_rad,
            fuse_with_activity(self.activity(*weights.shape), weights, self.min_row_norm),
        )

    def add_pose(self, name: str, deflections: Deflections) -> None:
        """Add a key pose with its map; replace an older pose of the same name."""
        if name in self.poses:
            self.sensory_motor_map.remove(self.poses[name])
        self.poses[name] = deflections.pose_rad
        self.add_map(deflections)
