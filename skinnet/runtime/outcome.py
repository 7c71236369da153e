"""Outcome of a run: results, resource use and failures of its processes."""

from dataclasses import dataclass, field

from skinnet.runtime.process_result import ProcessResult

__all__ = ["Outcome", "ProcessFailure", "ProcessReport"]


@dataclass(frozen=True)
class ProcessReport:
    """Process entry of the summary: CPU time, peak memory, exit code."""

    role: str
    name: str
    pid: int
    cpu_s: float
    peak_mb: float
    exit_code: int | None


@dataclass(frozen=True)
class ProcessFailure:
    """Process failure: name, cause, last log lines."""

    process: str
    cause: str
    last_lines: tuple[str, ...] = ()


@dataclass
class Outcome:
    """Run outcome: results of the processes that finished, failures of the others.

    `kind` is "completed", "completed_with_losses", "failed" or "interrupted".
    """

    kind: str = "completed"
    results: list[ProcessResult] = field(default_factory=list)
    processes: list[ProcessReport] = field(default_factory=list)
    failures: list[ProcessFailure] = field(default_factory=list)
