"""Long-term memory of the controller: loaded at the start of a run, written through on every change."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Self

import numpy as np

from controller.knowledge import Knowledge
from controller.selforganisation.structure import find_structure
from skinnet.deployment import Deployment
from skinnet.deployment.recall import recall, robot_of
from skinnet.memory.record import KeyPose, Memory
from skinnet.memory.store import MemoryStore

__all__ = ["MEMORY_FILE", "LongTermMemory", "take_in"]

MEMORY_FILE = "memory.sqlite"
"""File name in the run folder."""
_SAME_POSE_RAD = 0.05
"""Joint distance [rad] within which a map belongs to a key pose.

Five times a posture's accuracy, and far below the distance between key poses (assumed).
"""


def take_in(memory: Memory, knowledge: Knowledge) -> None:
    """Add stored memory to the self-model; each map is valid around the key pose stored with it."""
    if memory.activity is not None:
        unknown = np.zeros(memory.robot.shape, dtype=np.bool_)
        unknown[memory.unmeasured] = True
        knowledge.structure = find_structure(memory.activity, unknown)
    for name, pose in memory.poses.items():
        knowledge.poses[name] = pose.position_rad
        if pose.weights is not None:
            knowledge.map.add(pose.position_rad, pose.weights)
    knowledge.areas.update(memory.areas)
    knowledge.parameters.update(memory.parameters)


class LongTermMemory:
    """Long-term memory: stores the self-model; each method is durable when it returns.

    Args:
        store: Store of the run; None to store nothing.
        knowledge: Self-model to store, in its state at each call.
    """

    def __init__(self, store: MemoryStore | None, knowledge: Knowledge) -> None:
        self._store = store
        self._knowledge = knowledge

    @classmethod
    def begin(cls, deployment: Deployment, base: Path, out: Path | None, knowledge: Knowledge) -> Self:
        """Load the deployment's memory into `knowledge`, and store it and later changes in the run folder.

        Args:
            deployment: Deployment of the run; a robot without patches stores nothing.
            base: Folder of the deployment.
            out: Run folder; None to store nothing.
            knowledge: Self-model of a controller that has just started.

        Raises:
            MemoryFileError: the file that the deployment names is invalid or of another robot, or the run's
                own file is in use.
        """
        known = recall(deployment, base)
        if known is not None:
            take_in(known, knowledge)
        if out is None or not deployment.patches:
            return cls(None, knowledge)
        return cls(MemoryStore.create(out / MEMORY_FILE, robot_of(deployment), known), knowledge)

    def remember_structure(self) -> None:
        """Store the kinematic structure."""
        structure = self._knowledge.structure
        assert structure is not None, "there is no structure to remember"
        if self._store is not None:
            unmeasured = np.array(structure.unmeasured, dtype=np.int64)
            self._store.remember_structure(structure.activity, unmeasured)

    def remember_pose(self, name: str) -> None:
        """Store a key pose, with the map explored there, if any."""
        if self._store is not None:
            position_rad = self._knowledge.poses[name]
            weights = self._knowledge.map.explored_at(position_rad, _SAME_POSE_RAD)
            self._store.remember_pose(name, KeyPose(position_rad, weights))

    def remember_areas(self) -> None:
        """Store all touch areas: teaching one removes its cells from the others."""
        if self._store is not None:
            self._store.replace(dataclasses.replace(self._store.memory, areas=dict(self._knowledge.areas)))

    def remember_parameters(self, parameters: Mapping[str, float]) -> None:
        """Update and store parameters by name; others stay."""
        self._knowledge.parameters.update(parameters)
        if self._store is not None:
            self._store.remember_parameters(parameters)

    def close(self) -> None:
        """Close the store and release its file."""
        if self._store is not None:
            self._store.close()
