"""Fault intervals of the cells of a process, with a cached query of the active ones."""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.network.faults.fault_schedule import FaultSpan

__all__ = ["FaultIntervals"]


class FaultIntervals:
    """Fault intervals as columns: cell (index within the process), begin and end [ns].

    Args:
        spans: Faults of cells.
        first_cell: Index within the process of the first cell of each patch.
    """

    def __init__(self, spans: Sequence[FaultSpan], first_cell: Mapping[str, int]) -> None:
        cells = [first_cell[str(span.location.patch)] + (span.location.cell or 0) for span in spans]
        self.cell = np.array(cells, dtype=np.int64)
        self.begin_ns = np.array([span.t_ns for span in spans], dtype=np.int64)
        self.end_ns = np.array([span.until_ns for span in spans], dtype=np.int64)
        self._boundaries_ns = sorted({*self.begin_ns.tolist(), *self.end_ns.tolist()})
        self._cached_interval = (0, 0)
        self._cached_overlapping = np.empty(0, dtype=np.int64)

    def overlapping(self, start_ns: int, end_ns: int) -> NDArray[np.int64]:
        """Return the ascending indices of the faults that overlap [start_ns, end_ns)."""
        between = bisect_right(self._boundaries_ns, start_ns), bisect_left(self._boundaries_ns, end_ns)
        if between != self._cached_interval:
            self._cached_interval = between
            self._cached_overlapping = np.flatnonzero((self.begin_ns < end_ns) & (self.end_ns > start_ns))
        return self._cached_overlapping
