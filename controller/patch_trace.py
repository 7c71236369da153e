"""What each patch felt most, tick by tick, while a session lasts: for plots as Fig. 10 [M14]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.touch.fusion import TactilePicture

__all__ = ["PatchTrace"]

_FORCE, _PROXIMITY = slice(0, 3), 3


class PatchTrace:
    """The newest readings that the controller has, reduced to the largest of each patch.

    Args:
        sizes: Number of cells of each patch, by name, in order.
    """

    def __init__(self, sizes: dict[str, int]) -> None:
        self._first = np.cumsum([0, *sizes.values()])[:-1]
        self._n_patches = len(sizes)
        self._t_ns: list[int] = []
        self._felt: list[NDArray[np.float32]] = []

    def add(self, t_ns: int, picture: TactilePicture) -> None:
        """Adds a tick."""
        touch = picture.touch(t_ns)
        felt = np.column_stack([touch[:, _FORCE].max(axis=1), touch[:, _PROXIMITY]])
        self._t_ns.append(t_ns)
        self._felt.append(np.maximum.reduceat(felt, self._first, axis=0).astype(np.float32))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Times (n,) and largest force and proximity readings (n, P, 2)."""
        return {
            "patch_t_ns": np.array(self._t_ns, dtype=np.int64),
            "patch_felt": np.array(self._felt, dtype=np.float32).reshape(-1, self._n_patches, 2),
        }
