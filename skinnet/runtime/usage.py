"""Resource usage of a process (CPU time, bytes) over simulated time; never part of a log."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["USAGE_ROW", "UsageTrace"]

_SAMPLE_PERIOD_NS = 50_000_000

USAGE_ROW = np.dtype(
    [
        ("t_ns", np.int64),
        ("cpu_s", np.float64),
        ("wall_s", np.float64),
        ("received_bytes", np.int64),
        ("sent_bytes", np.int64),
    ]
)
"""Usage sample when `t_ns` had been computed: totals since process start (`wall_s`: monotonic clock)."""


class UsageTrace:
    """Usage samples of a process, one every 50 ms of simulated time.

    Args:
        traffic: Returns the bytes received and sent up to now.
    """

    def __init__(self, traffic: Callable[[], tuple[int, int]]) -> None:
        self._traffic = traffic
        self._next_ns = 0
        self._rows: list[tuple[int, float, float, int, int]] = []

    def sample(self, t_ns: int) -> None:
        """Take a sample after the period that ends at `t_ns`, if one is due."""
        if t_ns >= self._next_ns:
            self._next_ns = t_ns - t_ns % _SAMPLE_PERIOD_NS + _SAMPLE_PERIOD_NS
            self._rows.append((t_ns, time.process_time(), time.monotonic(), *self._traffic()))

    @property
    def rows(self) -> NDArray[np.void]:
        """Usage samples, (n,) `USAGE_ROW`."""
        return np.array(self._rows, dtype=USAGE_ROW)
