"""Collection of the results of an ended run: from processes in memory, or from the files of separate ones."""

import os
from dataclasses import dataclass

from skinnet.errors import RunFolderError
from skinnet.output_folder import OwnedFolder
from skinnet.run.process_list import ProcessSpec
from skinnet.runtime.loop import LogicalProcess
from skinnet.runtime.outcome import Outcome, OutcomeKind, ProcessFailure, ProcessReport
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.worker import EXIT_STOPPED, result_of

__all__ = ["RESULT_FOLDER", "EndedInProcess", "EndedProcess", "EndedProcesses", "collect"]

RESULT_FOLDER = "parts"
"""Folder of process results in a run folder."""


@dataclass(frozen=True)
class EndedProcess:
    """Separate process that has ended: specification, process ID, exit code."""

    spec: ProcessSpec
    pid: int
    exit_code: int | None


@dataclass(frozen=True)
class EndedProcesses:
    """Separate processes of a run that have ended, and the failures that the deployment tolerates."""

    processes: tuple[EndedProcess, ...]
    failures: tuple[ProcessFailure, ...] = ()


@dataclass(frozen=True)
class EndedInProcess:
    """Logical processes of a run in one process that have ended, and the tolerated failures."""

    processes: tuple[LogicalProcess, ...]
    failures: tuple[ProcessFailure, ...] = ()


def collect(ended: EndedInProcess | EndedProcesses, folder: OwnedFolder) -> Outcome:
    """Collect the results of a run from its folder; a process that failed has none.

    Raises:
        RunFolderError: a result is missing, or of another run.
    """
    if isinstance(ended, EndedInProcess):
        return _collect_logical_processes(ended)
    return _collect_files(ended, folder)


def _collect_logical_processes(ended: EndedInProcess) -> Outcome:
    lost = {failure.process for failure in ended.failures}
    results = tuple(result_of(process) for process in ended.processes if process.name not in lost)
    facts = results[0].facts
    report = ProcessReport("all", "in_process", os.getpid(), facts["cpu_s"], facts["peak_mb"], 0)
    return Outcome(_kind(ended.failures), results, (report,), ended.failures)


def _collect_files(ended: EndedProcesses, folder: OwnedFolder) -> Outcome:
    results, reports = [], []
    for process in ended.processes:
        name, role = process.spec.name, process.spec.role.value
        try:
            result = ProcessResult.load(folder.path / RESULT_FOLDER, name, folder.identity)
        except FileNotFoundError:
            if process.exit_code == 0:
                raise RunFolderError(
                    f"folder {folder.path}: {RESULT_FOLDER}/{name}.json is gone, which {name} wrote; "
                    f"something else removed it: run it again, in a folder of its own"
                ) from None
            result = ProcessResult(name, role)
        else:
            results.append(result)
        cpu_s, peak_mb = result.facts.get("cpu_s", 0.0), result.facts.get("peak_mb", 0.0)
        reports.append(ProcessReport(role, name, process.pid, cpu_s, peak_mb, process.exit_code))
    stopped = any(process.exit_code == EXIT_STOPPED for process in ended.processes)
    kind = OutcomeKind.INTERRUPTED if stopped else _kind(ended.failures)
    return Outcome(kind, tuple(results), tuple(reports), ended.failures)


def _kind(failures: tuple[ProcessFailure, ...]) -> OutcomeKind:
    return OutcomeKind.COMPLETED_WITH_LOSSES if failures else OutcomeKind.COMPLETED
