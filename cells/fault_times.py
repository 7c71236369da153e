"""Fault intervals of the cells of a process, with a cached query of the active ones."""

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.network.faults import FaultSpan

__all__ = ["FaultTimes"]


class FaultTimes:
    """Fault intervals as columns: cell (index within the process), begin and end [ns].

    Args:
        spans: Faults of cells.
        first_cell: Index within the process of the first cell of each patch.
    """

    def __init__(self, spans: Sequence[FaultSpan], first_cell: Mapping[str, int]) -> None:
        cells = [first_cell[str(span.place.patch)] + (span.place.cell or 0) for span in spans]
        self.cell = np.array(cells, dtype=np.int64)
        self.t_ns = np.array([span.t_ns for span in spans], dtype=np.int64)
        self.until_ns = np.array([span.until_ns for span in spans], dtype=np.int64)
        self._changes_ns = sorted({*self.t_ns.tolist(), *self.until_ns.tolist()})
        self._between = (0, 0)
        self._active = np.empty(0, dtype=np.int64)

    def active(self, start_ns: int, end_ns: int) -> NDArray[np.int64]:
        """Return the ascending indices of the faults that overlap [start_ns, end_ns)."""
        between = bisect_right(self._changes_ns, start_ns), bisect_left(self._changes_ns, end_ns)
        if between != self._between:
            self._between = between
            self._active = np.flatnonzero((self.t_ns < end_ns) & (self.until_ns > start_ns))
        return self._active
