"""Packet ids and entry times of packets in flight, and the set of ids already used."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["IdSet", "PacketSlots"]


class PacketSlots:
    """Packet slots of packets in flight; a slot is reused once its packet has ended."""

    def __init__(self) -> None:
        self._id = self._t_ns = self._free = np.empty(0, dtype=np.int64)

    def allocate(self, packet_ids: NDArray[np.int64], t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Allocate slots (n,) for packets with these ids (n,) and entry times (n,) [ns]."""
        if (missing := packet_ids.size - self._free.size) > 0:
            size = self._id.size
            more = max(missing, size)
            self._id, self._t_ns = (
                np.append(a, np.empty(more, dtype=np.int64)) for a in (self._id, self._t_ns)
            )
            self._free = np.append(self._free, np.arange(size, size + more))
        numbers, self._free = self._free[: packet_ids.size], self._free[packet_ids.size :]
        self._id[numbers], self._t_ns[numbers] = packet_ids, t_ns
        return numbers

    def release(self, slots: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Free the slots of packets that have ended; return their ids and entry times [ns], each (n,)."""
        self._free = np.append(slots, self._free)
        return self._id[slots], self._t_ns[slots]


class IdSet:
    """Set of ids as intervals of consecutive integers; ids without gaps need constant memory."""

    def __init__(self) -> None:
        self._start = self._stop = np.empty(0, dtype=np.int64)

    @property
    def n_intervals(self) -> int:
        """Number of intervals."""
        return self._start.size

    def add(self, ids: NDArray[np.int64]) -> int | None:
        """Add ids (n,); return the first position of a duplicate, or None."""
        order = np.argsort(ids, kind="stable")
        ordered = ids[order]
        again = np.concatenate(([False], ordered[1:] == ordered[:-1])) if ids.size else np.empty(0, np.bool_)
        run = np.searchsorted(self._start, ordered, side="right") - 1
        again |= (run >= 0) & (ordered <= self._stop[run]) if self._stop.size else False
        if again.any():
            return int(order[again].min())
        breaks = np.flatnonzero(ordered[1:] - 1 != ordered[:-1])
        start = np.concatenate((self._start, ordered[:1], ordered[breaks + 1]))
        stop = np.concatenate((self._stop, ordered[breaks], ordered[-1:]))
        order = np.argsort(start, kind="stable")
        start, stop = start[order], stop[order]
        apart = start[1:] - 1 != stop[:-1]
        self._start = start[np.concatenate(([True], apart))] if start.size else start
        self._stop = stop[np.concatenate((apart, [True]))] if stop.size else stop
        return None
