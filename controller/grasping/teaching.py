"""Teaching of touch areas: attention on, brush over the skin, attention off [M14, IV.C]."""

import numpy as np
from numpy.typing import NDArray

from controller.touch.fusion import TactilePicture
from skinnet.messages import Modality

__all__ = ["Attention", "learn_area"]


class Attention:
    """Collects the cells with new contact events while the robot pays attention.

    A cell that was in contact before must be let go and touched again: only a new event counts.

    Attributes:
        label: Area that is taught.
    """

    def __init__(self, label: str, picture: TactilePicture, contact_level: int) -> None:
        """Begins to pay attention; proximity from `contact_level` on is close contact."""
        self.label = label
        self._level = contact_level
        self._before = self._contact(picture)
        self._touched = np.zeros_like(self._before)

    def see(self, picture: TactilePicture) -> None:
        """Takes in what is in contact now."""
        contact = self._contact(picture)
        self._touched |= contact & ~self._before
        self._before = contact

    @property
    def brushed(self) -> bool:
        """Something is in contact now."""
        return bool(self._before.any())

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cells with a new contact so far."""
        return np.flatnonzero(self._touched)

    def _contact(self, picture: TactilePicture) -> NDArray[np.bool_]:
        close = picture.level(Modality.PROXIMITY) >= self._level
        contact: NDArray[np.bool_] = close | (picture.level(Modality.FORCE) > 0)
        return contact


def learn_area(
    areas: dict[str, NDArray[np.int64]], label: str, cells: NDArray[np.int64]
) -> dict[str, NDArray[np.int64]]:
    """The areas with `label` taught anew; a cell belongs to the area that it was taught for last."""
    kept = {name: np.setdiff1d(old, cells) for name, old in areas.items() if name != label}
    return {name: old for name, old in kept.items() if len(old)} | {label: cells}
