"""What a process has used of its machine and of the wire, over simulated time; never part of a log."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["USAGE_ROW", "UsageTrace"]

_EVERY_NS = 50_000_000

USAGE_ROW = np.dtype(
    [
        ("t_ns", np.int64),
        ("cpu_s", np.float64),
        ("wall_s", np.float64),
        ("received_bytes", np.int64),
        ("sent_bytes", np.int64),
    ]
)
"""Totals since the process began (`wall_s`: of the monotonic clock), when `t_ns` had been computed."""


class UsageTrace:
    """Notes the totals every 50 ms of simulated time.

    Args:
        traffic: Gives the bytes received and sent so far.
    """

    def __init__(self, traffic: Callable[[], tuple[int, int]]) -> None:
        self._traffic = traffic
        self._next_ns = 0
        self._rows: list[tuple[int, float, float, int, int]] = []

    def note(self, t_ns: int) -> None:
        """The period that ends at `t_ns` is computed."""
        if t_ns >= self._next_ns:
            self._next_ns = t_ns - t_ns % _EVERY_NS + _EVERY_NS
            self._rows.append((t_ns, time.process_time(), time.monotonic(), *self._traffic()))

    @property
    def rows(self) -> NDArray[np.void]:
        """(n,) `USAGE_ROW`."""
        return np.array(self._rows, dtype=USAGE_ROW)
