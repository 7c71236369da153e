"""How a run ended, whichever way it was run."""

from dataclasses import dataclass, field

from skinnet.part import Part

__all__ = ["Fault", "Outcome", "ProcessReport"]


@dataclass(frozen=True)
class ProcessReport:
    """What the summary says of a process."""

    role: str
    name: str
    pid: int
    cpu_s: float
    peak_mb: float
    exit_code: int | None


@dataclass(frozen=True)
class Fault:
    """Something that was lost on the way: which process, how, and its last lines."""

    process: str
    what: str
    last_lines: tuple[str, ...] = ()


@dataclass
class Outcome:
    """Parts of the processes that finished, and what happened to the others.

    `kind` is "completed", "completed_with_losses", "failed" or "interrupted".
    """

    kind: str = "completed"
    parts: list[Part] = field(default_factory=list)
    processes: list[ProcessReport] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
