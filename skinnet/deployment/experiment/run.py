"""Run spec: duration, pace and fault tolerance."""

from typing import Literal

from skinnet.deployment.types import Name, Positive, Table

__all__ = ["RunSpec"]


class RunSpec(Table, frozen=True, kw_only=True):
    """Duration, pace and fault tolerance of a run."""

    max_s: Positive = 300.0
    """Simulated time after which the run ends at the latest."""
    pace: Literal["lockstep", "realtime"] = "lockstep"
    """Pace of simulated time: as fast as it is computed, or following the wall clock."""
    pin: bool = True
    """CPU affinity: bind each process to one core where the operating system supports it, which keeps its
    caches warm. Turn it off to share the computer with other work."""
    deadline_s: Positive = 10.0
    """Wall-clock timeout of an upstream process that sends no period end."""
    tolerated_losses: tuple[Name, ...] = ()
    """Processes whose loss does not end the run; "cells" stands for every cell process."""
