"""Long-term memory of the controller: loaded at the start of a run, written through on every change."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np

from controller.self_model import SelfModel
from controller.selforganisation.kinematic_structure import find_structure
from skinnet.deployment import Deployment
from skinnet.deployment.memory_loading import load_memory, robot_description
from skinnet.memory.contents import KeyPose, MemoryContents
from skinnet.memory.sqlite_store import MemoryStore

__all__ = ["MEMORY_FILE", "LongTermMemory", "restore_self_model"]

MEMORY_FILE = "memory.sqlite"
"""File name in the run folder."""
_POSE_TOLERANCE_RAD = 0.05
"""Joint distance [rad] within which a map belongs to a key pose.

Five times a posture's accuracy, and far below the distance between key poses (assumed).
"""


def restore_self_model(memory: MemoryContents, self_model: SelfModel) -> None:
    """Add stored memory to the self-model; each map is valid around the key pose stored with it."""
    if memory.activity is not None:
        unknown = np.zeros(memory.robot.shape, dtype=np.bool_)
        unknown[memory.unmeasured] = True
        self_model.structure = find_structure(
            memory.activity, unknown, dof_names=self_model.dof_names, cell_names=self_model.cell_names
        )
    for name, pose in memory.poses.items():
        self_model.poses[name] = pose.position_rad
        if pose.weights is not None:
            self_model.sensory_motor_map.add(pose.position_rad, pose.weights)
    self_model.areas.update(memory.areas)
    self_model.parameters.update(memory.parameters)


class LongTermMemory:
    """Long-term memory: stores the self-model; each method is durable when it returns.

    Args:
        store: Store of the run; None to store nothing.
        self_model: Self-model to store, in its state at each call.
    """

    def __init__(self, store: MemoryStore | None, self_model: SelfModel) -> None:
        self._store = store
        self._self_model = self_model
        self._stored_structure = self_model.structure

    @classmethod
    def open(cls, deployment: Deployment, base: Path, out: Path | None, self_model: SelfModel) -> Self:
        """Load the deployment's memory into `self_model`, and store it and later changes in the run folder.

        Args:
            deployment: Deployment of the run; a robot without patches stores nothing.
            base: Folder of the deployment.
            out: Run folder; None to store nothing.
            self_model: Self-model of a controller that has just started.

        Raises:
            MemoryFileError: the file that the deployment names is invalid or of another robot, or the run's
                own file is in use.
        """
        known = load_memory(deployment, base)
        if known is not None:
            restore_self_model(known, self_model)
        if out is None or not deployment.patches:
            return cls(None, self_model)
        return cls(MemoryStore.create(out / MEMORY_FILE, robot_description(deployment), known), self_model)

    def store_structure(self) -> None:
        """Store the kinematic structure, if it is another one than before."""
        structure = self._self_model.structure
        if self._store is not None and structure is not None and structure is not self._stored_structure:
            unmeasured = np.array(structure.unmeasured, dtype=np.int64)
            self._store.store_structure(structure.activity, unmeasured)
        self._stored_structure = structure

    def store_pose(self, name: str) -> None:
        """Store a key pose, with the map explored there, if any."""
        if self._store is not None:
            position_rad = self._self_model.poses[name]
            weights = self._self_model.sensory_motor_map.explored_at(position_rad, _POSE_TOLERANCE_RAD)
            self._store.store_pose(name, KeyPose(position_rad, weights))

    def store_areas(self) -> None:
        """Store all touch areas: teaching one removes its cells from the others."""
        if self._store is not None:
            self._store.replace_contents(
                dataclasses.replace(self._store.contents, areas=dict(self._self_model.areas))
            )

    def store_parameters(self, parameters: Mapping[str, float]) -> None:
        """Update and store parameters by name; others stay."""
        self._self_model.parameters.update(parameters)
        if self._store is not None:
            self._store.store_parameters(parameters)

    def close(self) -> None:
        """Close the store and release its file."""
        if self._store is not None:
            self._store.close()
