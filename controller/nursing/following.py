"""Follows the recorded contacts through what the skin says period by period."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts import Region

__all__ = ["Following"]

Floats = NDArray[np.float64]
_Felt = dict[tuple[str, int], Region]


class Following:
    """Force and centre of pressure of C contacts, and for how long each was too weak to be held.

    A contact is the region of its number. If a board gave up the number, since regions merged or the contact
    broke for a moment, it goes on as the nearest region of its sheet that no other contact is. What jumps too
    far from one period to the next is another region, whatever its number.
    """

    def __init__(self, regions: Sequence[Region], t_ns: int, contact_n: float, follow_m: float) -> None:
        """Starts at what was recorded at `t_ns`.

        Args:
            regions: The contacts.
            t_ns: now.
            contact_n: Weaker is no contact.
            follow_m: How far a contact may jump along its sheet.
        """
        self._regions = list(regions)
        self._contact_n, self._follow_m = contact_n, follow_m
        self._held_ns = np.full(len(regions), t_ns)
        self.force_n: Floats = np.array([region.force_n for region in regions])
        """(C,): f_c; zero where the skin says nothing of the contact."""
        self.xi_m: Floats = np.array([region.xi_m for region in regions])
        """(C, 2): ξ_c, the last one that was felt."""

    def take(self, t_ns: int, regions: Sequence[Region]) -> None:
        """Takes in all regions that are felt at `t_ns`."""
        felt = {(region.sheet, region.number): region for region in regions}
        found = [self._same(old, felt) for old in self._regions]
        for c, old in enumerate(self._regions):
            region = found[c] or self._nearest(old, felt)
            self.force_n[c] = 0.0
            if region is None:
                continue
            self._regions[c] = region
            self.force_n[c], self.xi_m[c] = region.force_n, region.xi_m
            if region.force_n >= self._contact_n:
                self._held_ns[c] = t_ns

    def weak_ns(self, t_ns: int) -> NDArray[np.int64]:
        """(C,) time since each contact was strong enough."""
        weak: NDArray[np.int64] = t_ns - self._held_ns
        return weak

    def _same(self, old: Region, felt: _Felt) -> Region | None:
        """Takes the region of the same number out of `felt`, unless it jumped."""
        region = felt.get((old.sheet, old.number))
        if region is None or _way_m(old, region) > self._follow_m:
            return None
        return felt.pop((old.sheet, old.number))

    def _nearest(self, old: Region, felt: _Felt) -> Region | None:
        """Takes the nearest of what is left on the sheet out of `felt`; the lower number of two as near."""
        near = [(_way_m(old, region), key) for key, region in felt.items() if key[0] == old.sheet]
        way_m, key = min(near, default=(np.inf, ("", 0)))
        return felt.pop(key) if way_m <= self._follow_m else None


def _way_m(old: Region, new: Region) -> float:
    return float(np.hypot(new.xi_m[0] - old.xi_m[0], new.xi_m[1] - old.xi_m[1]))
