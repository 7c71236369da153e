"""Process statistics of a run: cores, memory and real-time factor of each process."""

from dataclasses import dataclass

from skinnet.watch_messages import ProcessLoad

__all__ = ["Machinery", "Process"]

_GONE_S = 3.0
"""Silence [s] after which a process's rate is unknown."""


@dataclass
class Process:
    """Process statistics.

    Attributes:
        name: Name of the process.
        pid: Process id, 0 if unknown.
        cores: Number of busy cores; None if unknown.
        memory_mb: Memory [MB]; 0 if the process has ended; None if unknown.
        rate: Real-time factor: simulated seconds per second of wall time; None if unknown.
    """

    name: str
    pid: int = 0
    cores: float | None = None
    memory_mb: float | None = None
    rate: float | None = None


class Machinery:
    """Process statistics of all known processes, by name."""

    def __init__(self) -> None:
        self.processes: dict[str, Process] = {}
        self._marks: dict[str, tuple[int, float]] = {}
        self._newest: dict[str, tuple[int, float]] = {}

    def take_load(self, load: ProcessLoad) -> None:
        """Apply the process loads published by the launcher."""
        for name, pid, cores, memory_mb in zip(load.name, load.pid, load.cores, load.memory_mb, strict=True):
            process = self._process(name)
            process.pid, process.cores, process.memory_mb = pid, cores, memory_mb

    def note(self, name: str, t_ns: int, now_s: float) -> None:
        """Note a process's message of simulated time `t_ns` [ns], received at wall time `now_s` [s]."""
        self._newest[name] = t_ns, now_s

    def measure(self, now_s: float) -> None:
        """Update the real-time factors since the last call."""
        for name, (t_ns, at_s) in self._newest.items():
            process = self._process(name)
            before = self._marks.get(name)
            if before is None or t_ns < before[0]:
                process.rate = None
            elif at_s > before[1]:
                process.rate = (t_ns - before[0]) * 1e-9 / (at_s - before[1])
            elif now_s - at_s > _GONE_S:
                process.rate = None
            self._marks[name] = t_ns, at_s

    def _process(self, name: str) -> Process:
        return self.processes.setdefault(name, Process(name))
