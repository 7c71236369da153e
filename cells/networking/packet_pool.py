"""Packet pool: payloads of packets in flight, one array row per packet; the kernel knows row numbers only."""

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["PACKET_ROW", "PacketKind", "PacketPool"]

PACKET_ROW = np.dtype(
    [
        ("t_sampled_ns", np.int64),
        ("cell", np.int32),
        ("kind", np.uint8),
        ("modality", np.uint8),
        ("channel", np.uint8),
        ("event_kind", np.uint8),
        ("level", np.uint8),
        ("value", np.float32),
        ("values", np.float32, 8),
    ]
)


class PacketKind(IntEnum):
    """Kind of a packet."""

    EVENT = 0
    READING = 1
    CONFIG = 2
    FORMATION = 3


class PacketPool:
    """Pool of `PACKET_ROW` rows, allocated when packets enter the network and freed when they end.

    Configuration and formation packets are few; their contents are Python objects, kept by row.
    """

    def __init__(self, capacity: int = 1024) -> None:
        self.rows: NDArray[Any] = np.zeros(capacity, dtype=PACKET_ROW)
        self.objects: dict[int, Any] = {}
        self._free: NDArray[np.int64] = np.arange(capacity, dtype=np.int64)
        self._n_free = capacity

    def allocate(self, n_rows: int) -> NDArray[np.int64]:
        """Allocate `n_rows` rows; return their numbers. The pool doubles when it is exhausted."""
        while n_rows > self._n_free:
            size = self.rows.size
            self.rows = np.concatenate([self.rows, np.zeros(size, dtype=PACKET_ROW)])
            free = np.empty(2 * size, dtype=np.int64)
            free[: self._n_free] = self._free[: self._n_free]
            free[self._n_free : self._n_free + size] = np.arange(size, 2 * size)
            self._free, self._n_free = free, self._n_free + size
        self._n_free -= n_rows
        return self._free[self._n_free : self._n_free + n_rows].copy()

    def allocate_object(self, kind: PacketKind, cell: int, content: Any) -> int:
        """Allocate the row of a packet that carries a Python object; return its number."""
        row = int(self.allocate(1)[0])
        self.rows[row]["kind"] = kind
        self.rows[row]["cell"] = cell
        self.objects[row] = content
        return row

    def free(self, rows: NDArray[np.int64]) -> None:
        """Free rows and discard their contents."""
        self._free[self._n_free : self._n_free + rows.size] = rows
        self._n_free += rows.size
        if self.objects:
            for row in rows.tolist():
                self.objects.pop(row, None)
