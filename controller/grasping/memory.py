"""Long-term memory of the controller: recalled at the start of a run, written through as it learns."""

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
"""In the run folder."""
_SAME_POSE_RAD = 0.05
"""A map belongs to a key pose that is no farther away in any joint: five times a posture's accuracy, and far
below what tells key poses apart (assumed)."""


def take_in(memory: Memory, knowledge: Knowledge) -> None:
    """Adds what is remembered to `knowledge`; a map holds around the key pose that it was kept with."""
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
    """Keeps what the controller knows; each method is durable when it returns.

    Args:
        store: Where it is kept; None if it is not.
        knowledge: What to keep, as it is when a method is called.
    """

    def __init__(self, store: MemoryStore | None, knowledge: Knowledge) -> None:
        self._store = store
        self._knowledge = knowledge

    @classmethod
    def begin(cls, deployment: Deployment, base: Path, out: Path | None, knowledge: Knowledge) -> Self:
        """Recalls into `knowledge` what the deployment names; keeps it, and what follows, in the run folder.

        Args:
            deployment: What is run; a robot without patches keeps nothing.
            base: Its folder.
            out: The run folder; nothing is kept without one.
            knowledge: Of a controller that has just started.

        Raises:
            MemoryFileError: the file that the deployment names does not hold or is of another robot, or the
                run's own is in use.
        """
        known = recall(deployment, base)
        if known is not None:
            take_in(known, knowledge)
        if out is None or not deployment.patches:
            return cls(None, knowledge)
        return cls(MemoryStore.create(out / MEMORY_FILE, robot_of(deployment), known), knowledge)

    def remember_structure(self) -> None:
        """Keeps the structure that was found."""
        structure = self._knowledge.structure
        assert structure is not None, "there is no structure to remember"
        if self._store is not None:
            unmeasured = np.array(structure.unmeasured, dtype=np.int64)
            self._store.remember_structure(structure.activity, unmeasured)

    def remember_pose(self, name: str) -> None:
        """Keeps a key pose, with the map that was explored there, if one was."""
        if self._store is not None:
            position_rad = self._knowledge.poses[name]
            weights = self._knowledge.map.explored_at(position_rad, _SAME_POSE_RAD)
            self._store.remember_pose(name, KeyPose(position_rad, weights))

    def remember_areas(self) -> None:
        """Keeps all touch areas: one that is taught takes cells away from others."""
        if self._store is not None:
            self._store.replace(dataclasses.replace(self._store.memory, areas=dict(self._knowledge.areas)))

    def remember_parameters(self, parameters: Mapping[str, float]) -> None:
        """Knows and keeps parameters; others stay."""
        self._knowledge.parameters.update(parameters)
        if self._store is not None:
            self._store.remember_parameters(parameters)

    def close(self) -> None:
        """Gives the file back to whoever wants to read it."""
        if self._store is not None:
            self._store.close()
