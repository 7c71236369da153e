"""Teaching of touch areas: attention on, brush over the skin, attention off [M14, IV.C]."""

import numpy as np
from numpy.typing import NDArray

from controller.touch.tactile_state import TactileState
from skinnet.protocol.messages import Modality

__all__ = ["AreaTeaching", "replace_area"]


class AreaTeaching:
    """Collector of the cells with new contacts while attention is on.

    A cell already in contact must be released and touched again: only new contacts count.

    Attributes:
        area: Name of the taught area.
    """

    def __init__(self, area: str, tactile_state: TactileState, contact_level: int) -> None:
        """Start collecting; a proximity level of at least `contact_level` is contact."""
        self.area = area
        self._contact_level = contact_level
        self._previous_contact = self._contact(tactile_state)
        self._touched = np.zeros_like(self._previous_contact)

    def update(self, tactile_state: TactileState) -> None:
        """Add the cells with new contact."""
        contact = self._contact(tactile_state)
        self._touched |= contact & ~self._previous_contact
        self._previous_contact = contact

    @property
    def in_contact(self) -> bool:
        """True while any cell is in contact."""
        return bool(self._previous_contact.any())

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cell indices (n,) with a new contact, ascending."""
        return np.flatnonzero(self._touched)

    def _contact(self, tactile_state: TactileState) -> NDArray[np.bool_]:
        close = tactile_state.level(Modality.PROXIMITY) >= self._contact_level
        contact: NDArray[np.bool_] = close | (tactile_state.level(Modality.FORCE) > 0)
        return contact


def replace_area(
    areas: dict[str, NDArray[np.int64]], label: str, cells: NDArray[np.int64]
) -> dict[str, NDArray[np.int64]]:
    """Return the areas with `label` replaced; a cell belongs to the area taught last."""
    kept = {name: np.setdiff1d(old, cells) for name, old in areas.items() if name != label}
    return {name: old for name, old in kept.items() if len(old)} | {label: cells}
