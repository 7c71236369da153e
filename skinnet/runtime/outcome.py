"""Outcome of a run: results, resource use and failures of its processes."""

from dataclasses import dataclass
from enum import Enum

from skinnet.runtime.process_result import ProcessResult

__all__ = ["Outcome", "OutcomeKind", "ProcessFailure", "ProcessReport"]


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


class OutcomeKind(Enum):
    """Kind of outcome, by its text in the summary; a run that fails has no summary."""

    COMPLETED = "completed"
    COMPLETED_WITH_LOSSES = "completed_with_losses"
    INTERRUPTED = "interrupted"
    """A process whose loss is tolerated was stopped from outside."""


@dataclass(frozen=True)
class Outcome:
    """Run outcome: results of the processes that finished, reports of all, failures of the others."""

    kind: OutcomeKind
    results: tuple[ProcessResult, ...]
    processes: tuple[ProcessReport, ...]
    failures: tuple[ProcessFailure, ...]
