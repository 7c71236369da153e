"""Simulated time in integer nanoseconds: period arithmetic, and pacing by the wall clock."""

import time
from dataclasses import dataclass

__all__ = ["NS_PER_MS", "NS_PER_S", "WallClockPace", "next_multiple"]

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000


def next_multiple(t_ns: int, period_ns: int, offset_ns: int = 0) -> int:
    """Return the first time after `t_ns` of the form offset + k × period [ns]."""
    return t_ns + period_ns - (t_ns - offset_ns) % period_ns


@dataclass
class WallClockPace:
    """Wall-clock pacing of simulated time from its first use on, for `pace = "realtime"`."""

    start_wall_ns: int | None = None

    def wait_s(self, t_ns: int) -> float:
        """Return the wall time [s] left until simulated time `t_ns`; negative when late."""
        now_ns = time.monotonic_ns()
        if self.start_wall_ns is None:
            self.start_wall_ns = now_ns
        return (self.start_wall_ns + t_ns - now_ns) / NS_PER_S
