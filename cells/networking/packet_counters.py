"""Counters of packets by kind, and the histogram of their latency."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from skinnet.network.records import Outcome

__all__ = ["LatencyHistogram", "PacketCounters"]

_LATENCY_BINS = 100_001
"""Latency bins of 1 µs up to 0.1 s; the last bin holds all longer latencies."""


class PacketCounters:
    """Counters of packets by kind: offered to the network, and ended, by outcome.

    Packets in flight are not the difference of these: the network says which it still holds.

    Args:
        kinds: Kinds of packets, numbered from 0.
    """

    def __init__(self, kinds: type[IntEnum]) -> None:
        self._kinds = tuple(kinds)
        self._offered = np.zeros(len(self._kinds), dtype=np.int64)
        self._ended = np.zeros((len(self._kinds), len(Outcome)), dtype=np.int64)

    def count_offered(self, kind: IntEnum, n: int) -> None:
        """Count `n` packets of a kind that were offered to the network."""
        self._offered[kind] += n

    def count_ended(self, kind: NDArray[np.integer] | int, outcome: NDArray[np.integer]) -> None:
        """Count packets that have ended, by kind (n,), or one for all, and outcome (n,)."""
        np.add.at(self._ended, (np.broadcast_to(kind, outcome.shape), outcome), 1)

    def count_delivered(self, kind: IntEnum, n: int) -> None:
        """Count `n` packets of one kind that were all delivered."""
        self._ended[kind, Outcome.DELIVERED] += n

    def as_dict(self, pending_kind: NDArray[np.integer]) -> dict[str, dict[str, int]]:
        """Counts by kind: offered, in flight, delivered, dropped by cause.

        Args:
            pending_kind: Kinds of the packets that the network holds now, (n,).
        """
        in_flight = np.bincount(pending_kind, minlength=len(self._kinds))
        result = {}
        for kind in self._kinds:
            ended = self._ended[kind]
            entry = {"offered": int(self._offered[kind]), "in_flight": int(in_flight[kind])}
            result[kind.name.lower()] = entry | {o.name.lower(): int(ended[o]) for o in Outcome}
        return result


class LatencyHistogram:
    """Histogram of latencies in bins of 1 µs, which processes can add up.

    Attributes:
        counts: Packets by latency [µs].
        max_ns: Maximum latency [ns].
    """

    def __init__(self) -> None:
        self.counts = np.zeros(_LATENCY_BINS, dtype=np.int64)
        self.max_ns = 0

    def add(self, latency_ns: NDArray[np.int64]) -> None:
        """Add latencies (n,) [ns]."""
        if len(latency_ns):
            np.add.at(self.counts, np.minimum(latency_ns // 1000, _LATENCY_BINS - 1), 1)
            self.max_ns = max(self.max_ns, int(latency_ns.max()))
