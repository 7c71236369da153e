"""Trace of the largest readings of each patch, per tick of a teach-and-grasp stage: [M14, Fig. 10]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.touch.tactile_state import TactileState

__all__ = ["PatchTrace"]

_FORCE, _PROXIMITY = slice(0, 3), 3


class PatchTrace:
    """Trace of the controller's newest readings, reduced to the maximum of each patch.

    Args:
        cell_counts: Number of cells of each patch, by name, in order.
    """

    def __init__(self, cell_counts: dict[str, int]) -> None:
        self._first_cell = np.cumsum([0, *cell_counts.values()])[:-1]
        self._n_patches = len(cell_counts)
        self._t_ns: list[int] = []
        self._readings: list[NDArray[np.float32]] = []

    def add(self, t_ns: int, tactile_state: TactileState) -> None:
        """Add the readings of a tick."""
        touch = tactile_state.reaction_readings(t_ns)
        felt = np.column_stack([touch[:, _FORCE].max(axis=1), touch[:, _PROXIMITY]])
        self._t_ns.append(t_ns)
        self._readings.append(np.maximum.reduceat(felt, self._first_cell, axis=0).astype(np.float32))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return times (n,) and largest force and proximity readings (n, P, 2)."""
        return {
            "patch_t_ns": np.array(self._t_ns, dtype=np.int64),
            "patch_readings": np.array(self._readings, dtype=np.float32).reshape(-1, self._n_patches, 2),
        }
