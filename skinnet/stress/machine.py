"""Who else uses the machine while something is measured."""

import os
import time

import psutil

__all__ = ["Others"]


class Others:
    """Watches from its creation on what CPU time goes to anybody but this process and its children."""

    def __init__(self) -> None:
        self._start = self._now()

    @staticmethod
    def _now() -> tuple[float, float, float]:
        """CPU time [s] of the whole machine, of this process with the children that have ended, wall time."""
        times = psutil.cpu_times()._asdict()
        idle = ("idle", "iowait", "guest", "guest_nice")  # guests are in the user time already
        busy_s = sum(value for name, value in times.items() if name not in idle)
        return busy_s, sum(os.times()[:4]), time.monotonic()

    @property
    def cores(self) -> float:
        """Cores that others have kept busy, on average."""
        busy_s, own_s, wall_s = (now - then for now, then in zip(self._now(), self._start, strict=True))
        return max(0.0, busy_s - own_s) / wall_s if wall_s > 0.0 else 0.0
