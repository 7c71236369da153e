"""Process statistics of a run: cores, memory and real-time factor of each process."""

from dataclasses import dataclass

from skinnet.protocol.telemetry_messages import ProcessLoad

__all__ = ["ProcessStats", "ProcessUsage"]

_SILENT_S = 3.0
"""Silence [s] after which a process's rate is unknown."""


@dataclass
class ProcessUsage:
    """Process statistics.

    Attributes:
        name: Name of the process.
        pid: Process id, 0 if unknown.
        cores: Number of busy cores; None if unknown.
        memory_mb: Memory [MB]; 0 if the process has ended; None if unknown.
        real_time_factor: Real-time factor: simulated seconds per second of wall time; None if unknown.
    """

    name: str
    pid: int = 0
    cores: float | None = None
    memory_mb: float | None = None
    real_time_factor: float | None = None


class ProcessStats:
    """Process statistics of all known processes, by name."""

    def __init__(self) -> None:
        self.processes: dict[str, ProcessUsage] = {}
        self._marks: dict[str, tuple[int, float]] = {}
        self._newest: dict[str, tuple[int, float]] = {}

    def apply_load(self, load: ProcessLoad) -> None:
        """Apply the process loads published by the launcher."""
        for name, pid, cores, memory_mb in zip(load.name, load.pid, load.cores, load.memory_mb, strict=True):
            process = self._process(name)
            process.pid, process.cores, process.memory_mb = pid, cores, memory_mb

    def on_message(self, name: str, t_ns: int, now_s: float) -> None:
        """Note a process's message of simulated time `t_ns` [ns], received at wall time `now_s` [s]."""
        self._newest[name] = t_ns, now_s

    def update_rates(self, now_s: float) -> None:
        """Update the real-time factors since the last call."""
        for name, (t_ns, at_s) in self._newest.items():
            process = self._process(name)
            before = self._marks.get(name)
            if before is None or t_ns < before[0]:
                process.real_time_factor = None
            elif at_s > before[1]:
                process.real_time_factor = (t_ns - before[0]) * 1e-9 / (at_s - before[1])
            elif now_s - at_s > _SILENT_S:
                process.real_time_factor = None
            self._marks[name] = t_ns, at_s

    def _process(self, name: str) -> ProcessUsage:
        return self.processes.setdefault(name, ProcessUsage(name))
