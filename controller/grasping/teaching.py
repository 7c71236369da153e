"""Teaching of touch areas: attention on, brush over the skin, attention off [M14, IV.C]."""

import numpy as np
from numpy.typing import NDArray

from controller.touch.fusion import TactilePicture
from skinnet.messages import Modality

__all__ = ["Attention", "learn_area"]


class Attention:
    """Collector of the cells with new contacts while attention is on.

    A cell already in contact must be released and touched again: only new contacts count.

    Attributes:
        label: Name of the taught area.
    """

    def __init__(self, label: str, picture: TactilePicture, contact_level: int) -> None:
        """Start collecting; a proximity level of at least `contact_level` is contact."""
        self.label = label
        self._level = contact_level
        self._before = self._contact(picture)
        self._touched = np.zeros_like(self._before)

    def see(self, picture: TactilePicture) -> None:
        """Add the cells with new contact."""
        contact = self._contact(picture)
        self._touched |= contact & ~self._before
        self._before = contact

    @property
    def brushed(self) -> bool:
        """True while any cell is in contact."""
        return bool(self._before.any())

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cell indices (n,) with a new contact, ascending."""
        return np.flatnonzero(self._touched)

    def _contact(self, picture: TactilePicture) -> NDArray[np.bool_]:
        close = picture.level(Modality.PROXIMITY) >= self._level
        contact: NDArray[np.bool_] = close | (picture.level(Modality.FORCE) > 0)
        return contact


def learn_area(
    areas: dict[str, NDArray[np.int64]], label: str, cells: NDArray[np.int64]
) -> dict[str, NDArray[np.int64]]:
    """Return the areas with `label` replaced; a cell belongs to the area taught last."""
    kept = {name: np.setdiff1d(old, cells) for name, old in areas.items() if name != label}
    return {name: old for name, old in kept.items() if len(old)} | {label: cells}
