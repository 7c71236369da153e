"""The processes of a run: what they use of the machine, and how fast they get on."""

from dataclasses import dataclass

from skinnet.watch_messages import ProcessLoad

__all__ = ["Machinery", "Process"]

_GONE_S = 3.0
"""A process that is silent for so long has no rate."""


@dataclass
class Process:
    """One process.

    Attributes:
        name: Its name.
        pid: Its number, 0 if it was not told.
        cores: How many cores it keeps busy; None if that was not told.
        memory_mb: Its memory; 0 if it is gone; None if that was not told.
        rate: Simulated seconds per second of the clock on the wall; None if unknown.
    """

    name: str
    pid: int = 0
    cores: float | None = None
    memory_mb: float | None = None
    rate: float | None = None


class Machinery:
    """All processes that were heard of."""

    def __init__(self) -> None:
        self.processes: dict[str, Process] = {}
        self._marks: dict[str, tuple[int, float]] = {}
        self._newest: dict[str, tuple[int, float]] = {}

    def take_load(self, load: ProcessLoad) -> None:
        """What the launcher tells of them."""
        for name, pid, cores, memory_mb in zip(load.name, load.pid, load.cores, load.memory_mb, strict=True):
            process = self._process(name)
            process.pid, process.cores, process.memory_mb = pid, cores, memory_mb

    def note(self, name: str, t_ns: int, now_s: float) -> None:
        """A message of a process, of simulated time `t_ns`, came at `now_s` of the wall's clock."""
        self._newest[name] = t_ns, now_s

    def measure(self, now_s: float) -> None:
        """Rates since the last call."""
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
