"""Packet pool: payloads of packets in flight, one array row per packet; the kernel knows row numbers only."""

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["PAYLOAD", "PacketKind", "PacketPool"]

PAYLOAD = np.dtype(
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
    """Pool of `PAYLOAD` rows, allocated when packets enter the network and freed when they end.

    Configuration and formation packets are few; their contents are Python objects, kept by row.
    """

    def __init__(self, capacity: int = 1024) -> None:
        self.rows: NDArray[Any] = np.zeros(capacity, dtype=PAYLOAD)
        self.contents: dict[int, Any] = {}
        self._free: NDArray[np.int64] = np.arange(capacity, dtype=np.int64)
        self._n_free = capacity

    def take(self, n: int) -> NDArray[np.int64]:
        """Allocate `n` rows; return their numbers. The pool doubles when it is exhausted."""
        while n > self._n_free:
            size = self.rows.size
            self.rows = np.concatenate([self.rows, np.zeros(size, dtype=PAYLOAD)])
            free = np.empty(2 * size, dtype=np.int64)
            free[: self._n_free] = self._free[: self._n_free]
            free[self._n_free : self._n_free + size] = np.arange(size, 2 * size)
            self._free, self._n_free = free, self._n_free + size
        self._n_free -= n
        return self._free[self._n_free : self._n_free + n].copy()

    def put_content(self, kind: PacketKind, cell: int, content: Any) -> int:
        """Allocate the row of a packet that carries a Python object; return its number."""
        row = int(self.take(1)[0])
        self.rows[row]["kind"] = kind
        self.rows[row]["cell"] = cell
        self.contents[row] = content
        return row

    def free(self, rows: NDArray[np.int64]) -> None:
        """Free rows and discard their contents."""
        self._free[self._n_free : self._n_free + rows.size] = rows
        self._n_free += rows.size
        if self.contents:
            for row in rows.tolist():
                self.contents.pop(row, None)
