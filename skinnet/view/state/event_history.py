"""Event history for the raster, and time series of latency and loss for the charts."""

from array import array
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["FULL_READING_KIND", "EventHistory", "TrafficSeries", "TrafficStatistics"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FULL_READING_KIND = 100
"""Kind of a full reading, which a streaming cell sends."""
_MAX_EVENTS = 150_000
"""Maximum number of kept events, which bounds the page's memory."""
_LATENCY_EDGES_MS = 10.0 ** np.linspace(-2, 3, 101)
"""Latency histogram edges [ms], in steps of 12 %, from 10 µs to 1 s."""


class EventHistory:
    """Event history: time, raster row and kind (modality and level) of the newest events.

    Args:
        window_ns: Length of the history [ns].
    """

    def __init__(self, window_ns: int) -> None:
        self.window_ns = window_ns
        self.n_events = 0
        self._newest_ns = 0
        self._t_ns, self._row, self._kind = array("q"), array("i"), array("b")

    def add(self, t_ns: Sequence[int], rows: Sequence[int], kinds: Sequence[int]) -> None:
        """Add events: times [ns], raster rows and kinds (8 × modality + level, level 7 for none)."""
        if not len(t_ns):
            return
        self._t_ns.extend(t_ns)
        self._row.extend(rows)
        self._kind.extend(kinds)
        self.n_events += len(t_ns)
        self._newest_ns = max(self._newest_ns, t_ns[-1])
        if len(self._t_ns) > 2 * _MAX_EVENTS:
            self._drop_first(len(self._t_ns) - _MAX_EVENTS)

    def since(self, t_ns: int) -> tuple[Ints, Ints, Ints]:
        """Events from `t_ns` on: times [ns], rows and kinds."""
        times = np.array(self._t_ns, dtype=np.int64)
        late = times >= t_ns
        return times[late], np.array(self._row)[late].astype(np.int64), np.array(self._kind)[late].astype(int)

    def drop_old(self) -> None:
        """Drop events older than the window; the order is approximate between patches."""
        times = np.array(self._t_ns, dtype=np.int64)
        recent = np.flatnonzero(times >= self._newest_ns - self.window_ns)
        self._drop_first(int(recent[0]) if len(recent) else len(times))

    def clear(self) -> None:
        """Drop all events."""
        self._newest_ns = 0
        self._drop_first(len(self._t_ns))

    def _drop_first(self, count: int) -> None:
        for column in (self._t_ns, self._row, self._kind):
            del column[:count]


class TrafficSeries(NamedTuple):
    """Time series of network traffic, one value per bin, oldest first.

    Attributes:
        t_s: End of each bin, simulated time [s].
        median_ms: Latency from a cell's sample to its delivery; NaN where nothing was delivered.
        p95_ms: Its 95th percentile.
        max_ms: Its maximum.
        delivered: Rate of packets delivered from cells [1/s].
        dropped: Rate of packets lost on links [1/s].
        missed: Rate of messages lost between run and page [1/s].
    """

    t_s: Floats
    median_ms: Floats
    p95_ms: Floats
    max_ms: Floats
    delivered: Floats
    dropped: Floats
    missed: Floats


class TrafficStatistics:
    """Traffic statistics in a ring of bins of simulated time.

    Args:
        bin_ns: Width of a bin [ns].
        n_bins: Number of bins.
    """

    def __init__(self, bin_ns: int, n_bins: int) -> None:
        self._bin_ns, self._bins = bin_ns, n_bins
        self._latency = np.zeros((n_bins, len(_LATENCY_EDGES_MS) + 1), dtype=np.int64)
        self._max_ns = np.zeros(n_bins, dtype=np.int64)
        self._counts = np.zeros((3, n_bins), dtype=np.int64)
        self._last = -1

    def clear(self) -> None:
        """Reset all counts."""
        self._latency[:], self._max_ns[:], self._counts[:] = 0, 0, 0
        self._last = -1

    def add_delivered(self, t_sampled_ns: Ints, t_delivered_ns: Ints) -> None:
        """Count delivered packets by their sampling and delivery times [ns]."""
        if not len(t_delivered_ns):
            return
        column = self._columns(t_delivered_ns)
        late_ns = t_delivered_ns - t_sampled_ns
        np.add.at(self._latency, (column, np.searchsorted(_LATENCY_EDGES_MS, late_ns * 1e-6)), 1)
        np.maximum.at(self._max_ns, column, late_ns)
        np.add.at(self._counts[0], column, 1)

    def add_dropped(self, t_ns: int, packets: int) -> None:
        """Count packets lost on links."""
        self._counts[1, self._columns(np.array([t_ns]))] += packets

    def add_missed(self, t_ns: int, messages: int) -> None:
        """Count messages lost between run and page."""
        self._counts[2, self._columns(np.array([t_ns]))] += messages

    def series(self) -> TrafficSeries:
        """Time series of the completed bins."""
        n = max(min(self._last, self._bins - 1), 0)  # without the newest bin, which is incomplete
        number = np.arange(self._last - n, self._last)
        column = number % self._bins
        up_to = np.cumsum(self._latency[column], axis=1)
        of = up_to[:, -1] if n else np.zeros(0)
        nothing = of == 0
        edges_ms = np.append(_LATENCY_EDGES_MS, _LATENCY_EDGES_MS[-1])
        max_ms = np.where(nothing, np.nan, self._max_ns[column] * 1e-6)
        median_ms, p95_ms = (
            np.where(nothing, np.nan, np.minimum(edges_ms[(up_to < q * of[:, None]).sum(axis=1)], max_ms))
            for q in (0.5, 0.95)
        )
        delivered, dropped, missed = self._counts[:, column] / (self._bin_ns * 1e-9)
        t_s = (number + 1).astype(np.float64) * self._bin_ns * 1e-9
        return TrafficSeries(t_s, median_ms, p95_ms, max_ms, delivered, dropped, missed)

    def _columns(self, t_ns: Ints) -> Ints:
        """Bin columns of times; clears new bins, and maps times that are too old to the oldest bin."""
        number = np.maximum(t_ns // self._bin_ns, 0)
        newest = int(number.max())
        if newest > self._last:
            if self._last < 0:
                self._last = newest - 1
            fresh = np.arange(max(self._last + 1, newest - self._bins + 1), newest + 1) % self._bins
            self._latency[fresh], self._max_ns[fresh], self._counts[:, fresh] = 0, 0, 0
            self._last = newest
        columns: Ints = np.maximum(number, self._last - self._bins + 1) % self._bins
        return columns
