"""Contact tracking: recorded contacts matched to the tactile regions of every period."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts.contact_frames import Region
from skinnet import pinned_math

__all__ = ["ContactTracker"]

Floats = NDArray[np.float64]
_RegionsById = dict[tuple[str, int], Region]


class ContactTracker:
    """Tracked force and centre of pressure of C contacts, and the time since each was above threshold.

    A contact is matched to the region with its id. If that id no longer exists, because regions merged or the
    contact broke briefly, it is matched to the nearest unassigned region of its sheet. A region further than
    `association_distance_m` from the contact's last position is never matched, whatever its id.
    """

    def __init__(
        self, regions: Sequence[Region], t_ns: int, contact_threshold_n: float, association_distance_m: float
    ) -> None:
        """Start from the contacts recorded at `t_ns`.

        Args:
            regions: The contacts.
            t_ns: Current time [ns].
            contact_threshold_n: Contact threshold [N].
            association_distance_m: Greatest displacement of a contact along its sheet per period [m].
        """
        self._regions = list(regions)
        self._contact_threshold_n, self._association_distance_m = contact_threshold_n, association_distance_m
        self._last_contact_ns = np.full(len(regions), t_ns)
        self.force_n: Floats = np.array([region.force_n for region in regions])
        """Contact forces f_c (C,) [N]; zero where no region matches the contact."""
        self.xi_m: Floats = np.array([region.xi_m for region in regions])
        """Centres of pressure ξ_c (C, 2), last measured [m]."""

    def update(self, t_ns: int, regions: Sequence[Region]) -> None:
        """Update the contacts with all regions at `t_ns`."""
        felt = {(region.sheet, region.region_id): region for region in regions}
        found = [self._pop_by_id(old, felt) for old in self._regions]
        for c, old in enumerate(self._regions):
            region = found[c] or self._pop_nearest(old, felt)
            self.force_n[c] = 0.0
            if region is None:
                continue
            self._regions[c] = region
            self.force_n[c], self.xi_m[c] = region.force_n, region.xi_m
            if region.force_n >= self._contact_threshold_n:
                self._last_contact_ns[c] = t_ns

    def time_below_threshold_ns(self, t_ns: int) -> NDArray[np.int64]:
        """Return the time (C,) since each contact was last at or above the threshold [ns]."""
        weak: NDArray[np.int64] = t_ns - self._last_contact_ns
        return weak

    def _pop_by_id(self, previous: Region, unmatched: _RegionsById) -> Region | None:
        """Pop the region with the same id from `unmatched`; None if it is missing or too far away."""
        region = unmatched.get((previous.sheet, previous.region_id))
        if region is None or _distance_m(previous, region) > self._association_distance_m:
            return None
        return unmatched.pop((previous.sheet, previous.region_id))

    def _pop_nearest(self, previous: Region, unmatched: _RegionsById) -> Region | None:
        """Pop the sheet's nearest region from `unmatched`; the lower id on ties; None if too far away."""
        near = [
            (_distance_m(previous, region), key)
            for key, region in unmatched.items()
            if key[0] == previous.sheet
        ]
        way_m, key = min(near, default=(np.inf, ("", 0)))
        return unmatched.pop(key) if way_m <= self._association_distance_m else None


def _distance_m(a: Region, b: Region) -> float:
    return float(pinned_math.hypot(b.xi_m[0] - a.xi_m[0], b.xi_m[1] - a.xi_m[1]))
