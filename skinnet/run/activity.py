"""Activity of the processes of a run: how long each has used no processor time.

A process that is stopped, or waits for what never comes, uses none; one that a busy computer slows down uses
some. So a start that takes long under load is told from one that hangs.
"""

from collections.abc import Mapping

import psutil

__all__ = ["ActivityMeter"]

_ACTIVE_CPU_S = 0.02
"""Processor time [s] that counts as activity; the threads of an idle Zenoh session use less in minutes."""


class ActivityMeter:
    """Activity meter of several processes.

    Args:
        pids: Process IDs by name.
        slice_s: Most time [s] that one check counts, however long ago the check before was: the processes may
            have been paused together with this one.
    """

    def __init__(self, pids: Mapping[str, int], slice_s: float) -> None:
        self._slice_s = slice_s
        self._checked_s: float | None = None
        self._processes = {name: _process(pid) for name, pid in pids.items()}
        self._active_cpu_s: dict[str, float] = {}
        self._idle_s = dict.fromkeys(pids, 0.0)

    def check(self, now_s: float) -> None:
        """Check all processes at the time `now_s` [s]."""
        passed_s = 0.0 if self._checked_s is None else min(now_s - self._checked_s, self._slice_s)
        self._checked_s = now_s
        for name, process in self._processes.items():
            cpu_s = _cpu_s(process)
            if cpu_s - self._active_cpu_s.get(name, -1.0) > _ACTIVE_CPU_S:
                self._active_cpu_s[name] = cpu_s
                self._idle_s[name] = 0.0
            else:
                self._idle_s[name] += passed_s

    def restart(self) -> None:
        """Count the idle time of all processes from now on."""
        self._idle_s = dict.fromkeys(self._idle_s, 0.0)

    def idle_s(self, name: str) -> float:
        """Time [s] without activity until the last check."""
        return self._idle_s[name]

    def state(self, name: str) -> str:
        """State of a process as a clause for a message; empty if nothing is to be said."""
        process = self._processes[name]
        try:
            stopped = process is not None and process.status() == psutil.STATUS_STOPPED
        except psutil.Error:
            stopped = False
        return ", stopped by a signal (SIGCONT continues it)" if stopped else ""


def _process(pid: int) -> psutil.Process | None:
    try:
        return psutil.Process(pid)
    except psutil.Error:
        return None


def _cpu_s(process: psutil.Process | None) -> float:
    """Processor time of a process [s]; 0 for one that has ended."""
    try:
        times = None if process is None else process.cpu_times()
    except psutil.Error:
        return 0.0
    return 0.0 if times is None else times.user + times.system
