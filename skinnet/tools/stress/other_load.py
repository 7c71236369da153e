"""CPU load by other programs during a measurement."""

import os
import time

import psutil

__all__ = ["OtherLoad"]


class OtherLoad:
    """CPU meter of other programs: all but this process and its children, since its creation."""

    def __init__(self) -> None:
        self._start = self._now()

    @staticmethod
    def _now() -> tuple[float, float, float]:
        """CPU time [s] of the whole computer, of this process and its ended children, and wall time [s]."""
        times = psutil.cpu_times()._asdict()
        idle = ("idle", "iowait", "guest", "guest_nice")  # guests are in the user time already
        busy_s = sum(value for name, value in times.items() if name not in idle)
        return busy_s, sum(os.times()[:4]), time.monotonic()

    @property
    def cores(self) -> float:
        """Mean number of cores kept busy by other programs."""
        busy_s, own_s, wall_s = (now - then for now, then in zip(self._now(), self._start, strict=True))
        return max(0.0, busy_s - own_s) / wall_s if wall_s > 0.0 else 0.0
