"""Run folder: `deployment.json` before the run, `summary.json` after it."""

from pathlib import Path
from typing import Any

from skinnet.deployment import resolved_json
from skinnet.files import write_bytes, write_json
from skinnet.run.prepare import PreparedRun

__all__ = ["write_deployment", "write_summary"]

_SUMMARY = "summary.json"


def write_deployment(prepared: PreparedRun, out: Path) -> None:
    """Make run folder `out` with the resolved deployment; the summary of an earlier run in it goes."""
    out.mkdir(parents=True, exist_ok=True)
    (out / _SUMMARY).unlink(missing_ok=True)
    write_bytes(out / "deployment.json", resolved_json(prepared.deployment))


def write_summary(summary: dict[str, Any], out: Path) -> None:
    """Write `summary.json` of a run, or of the runs with several seeds, into folder `out`."""
    write_json(out / _SUMMARY, summary)
