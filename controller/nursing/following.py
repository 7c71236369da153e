"""Contact tracking: recorded contacts matched to the tactile regions of every period."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts import Region

__all__ = ["Following"]

Floats = NDArray[np.float64]
_Felt = dict[tuple[str, int], Region]


class Following:
    """Tracked force and centre of pressure of C contacts, and the time since each was above threshold.

    A contact is matched to the region with its id. If that id no longer exists, because regions merged or the
    contact broke briefly, it is matched to the nearest unassigned region of its sheet. A region further than
    `follow_m` from the contact's last position is never matched, whatever its id.
    """

    def __init__(self, regions: Sequence[Region], t_ns: int, contact_n: float, follow_m: float) -> None:
        """Start from the contacts recorded at `t_ns`.

        Args:
            regions: The contacts.
            t_ns: Current time [ns].
            contact_n: Contact threshold [N].
            follow_m: Greatest displacement of a contact along its sheet per period [m].
        """
        self._regions = list(regions)
        self._contact_n, self._follow_m = contact_n, follow_m
        self._held_ns = np.full(len(regions), t_ns)
        self.force_n: Floats = np.array([region.force_n for region in regions])
        """Contact forces f_c (C,) [N]; zero where no region matches the contact."""
        self.xi_m: Floats = np.array([region.xi_m for region in regions])
        """Centres of pressure ξ_c (C, 2), last measured [m]."""

    def take(self, t_ns: int, regions: Sequence[Region]) -> None:
        """Update the contacts with all regions at `t_ns`."""
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
        """Return the time (C,) since each contact was last at or above the threshold [ns]."""
        weak: NDArray[np.int64] = t_ns - self._held_ns
        return weak

    def _same(self, old: Region, felt: _Felt) -> Region | None:
        """Pop the region with the same id from `felt`; None if it is missing or too far away."""
        region = felt.get((old.sheet, old.number))
        if region is None or _way_m(old, region) > self._follow_m:
            return None
        return felt.pop((old.sheet, old.number))

    def _nearest(self, old: Region, felt: _Felt) -> Region | None:
        """Pop the nearest region of the sheet from `felt`; ties go to the lower id; None if too far away."""
        near = [(_way_m(old, region), key) for key, region in felt.items() if key[0] == old.sheet]
        way_m, key = min(near, default=(np.inf, ("", 0)))
        return felt.pop(key) if way_m <= self._follow_m else None


def _way_m(old: Region, new: Region) -> float:
    return float(np.hypot(new.xi_m[0] - old.xi_m[0], new.xi_m[1] - old.xi_m[1]))
