"""Run folder: owned by its run, `deployment.json` before the run, `summary.json` after it."""

import contextlib
from pathlib import Path
from typing import Any

from skinnet.deployment import Deployment, resolved_json
from skinnet.files import write_bytes, write_json
from skinnet.output_folder import OwnedFolder, check_output_folder, own_folder
from skinnet.run.child_process import LOG_FOLDER
from skinnet.run.collect import RESULT_FOLDER
from skinnet.run.prepare import PreparedRun
from skinnet.run.process_list import process_list

__all__ = ["check_run_folder", "own_run_folder", "own_seeds_folder", "write_deployment", "write_summary"]

_PROGRAM = "skinnet run"
_SUMMARY, _DEPLOYMENT = "summary.json", "deployment.json"
_MEMORY = "memory.sqlite"
_PICTURES = (
    *("body", "activity_matrix", "kinematic_tree", "sensory_motor_map", "touch", "reactions", "latency"),
    *("grasp", "deviations", "feedback", "object", "patterns"),
)
_FILES = (
    *(_DEPLOYMENT, _SUMMARY, "run.mcap", "report.html", "point.json"),
    *(_MEMORY + suffix for suffix in ("", "-journal", "-wal", "-shm")),
    *(f"{name}.png" for name in _PICTURES),
)
"""Files of a run folder, apart from logs and results of processes."""
_RESULT_SUFFIXES = ".json", ".npz", ".lost.json"


def check_run_folder(out: Path) -> None:
    """Refuse a run folder that is in use by others, before anything costs time.

    Raises:
        RunFolderError: as `skinnet.output_folder.check_output_folder`.
    """
    check_output_folder(out, _PROGRAM)


def own_run_folder(prepared: PreparedRun, out: Path) -> contextlib.AbstractContextManager[OwnedFolder]:
    """Own run folder `out`, for the processes of `prepared`; results of an earlier run in it are removed.

    Raises:
        RunFolderError: as `skinnet.output_folder.own_folder`.
    """
    deployment = prepared.deployment
    return own_folder(out, _PROGRAM, resolved_json(deployment), (*_FILES, *_process_files(deployment)))


def own_seeds_folder(out: Path, deployment: Deployment) -> contextlib.AbstractContextManager[OwnedFolder]:
    """Own the folder `out` above the run folders of several seeds of `deployment`; raises as above."""
    return own_folder(out, _PROGRAM, resolved_json(deployment), (_SUMMARY, "report.html"))


def _process_files(deployment: Deployment) -> list[str]:
    names = [process.name for process in process_list(deployment, record=True)]
    results = (f"{RESULT_FOLDER}/{name}{suffix}" for name in names for suffix in _RESULT_SUFFIXES)
    return [*(f"{LOG_FOLDER}/{name}.log" for name in names), *results]


def write_deployment(prepared: PreparedRun, out: Path) -> None:
    """Write the resolved deployment into run folder `out`."""
    write_bytes(out / _DEPLOYMENT, resolved_json(prepared.deployment))


def write_summary(summary: dict[str, Any], folder: OwnedFolder) -> None:
    """Write `summary.json` of a run, or of the runs with several seeds.

    Raises:
        RunFolderError: the folder is no longer that of this run.
    """
    folder.require_ownership()
    write_json(folder.path / _SUMMARY, summary)
