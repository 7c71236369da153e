"""Latency histogram of any number of packets in constant memory."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled
from skinnet.pinned_math import exp2, log2

__all__ = ["LatencyHistogram"]

_BINS_PER_OCTAVE = 128
_OCTAVES = 63


@compiled
def _bins(latency_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the bin of each latency: the logarithm of its upper edge to base 2, in 128ths."""
    bins = np.empty(latency_ns.size, dtype=np.int64)
    for i in range(latency_ns.size):
        bins[i] = math.ceil(log2(float(max(latency_ns[i], 1))) * _BINS_PER_OCTAVE)
    return bins


class LatencyHistogram:
    """Latency histogram of 128 bins per octave: exact mean and extremes, percentiles to half a percent."""

    def __init__(self) -> None:
        self._counts = np.zeros(_OCTAVES * _BINS_PER_OCTAVE + 2, dtype=np.int64)
        self._sum_ns, self._min_ns, self._max_ns = 0.0, 0, 0

    def add(self, latency_ns: NDArray[np.int64]) -> None:
        """Add latencies (n,) [ns]."""
        if latency_ns.size == 0:
            return
        first = self._counts.sum() == 0
        least_ns = int(latency_ns.min())
        self._min_ns = least_ns if first else min(self._min_ns, least_ns)
        self._max_ns = max(self._max_ns, int(latency_ns.max()))
        self._sum_ns += float(latency_ns.sum(dtype=np.float64))
        bins = _bins(latency_ns)
        self._counts += np.bincount(bins, minlength=self._counts.size)

    def metrics(self) -> dict[str, float | None]:
        """Return the metrics in milliseconds by flat name; None without packets."""
        n = int(self._counts.sum())
        if n == 0:
            return dict.fromkeys(
                (f"latency.{name}_ms" for name in ("least", "mean", "p50", "p99", "largest")), None
            )
        return {
            "latency.least_ms": self._min_ns / 1e6,
            "latency.mean_ms": self._sum_ns / n / 1e6,
            "latency.p50_ms": self._percentile_ns(0.50) / 1e6,
            "latency.p99_ms": self._percentile_ns(0.99) / 1e6,
            "latency.largest_ms": self._max_ns / 1e6,
        }

    def _percentile_ns(self, fraction: float) -> float:
        below = np.cumsum(self._counts)
        edge_ns = exp2(int(np.searchsorted(below, fraction * below[-1])) / _BINS_PER_OCTAVE)
        return float(np.clip(edge_ns, self._min_ns, self._max_ns))
