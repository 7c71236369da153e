"""Benchmark of robots: a trial of each, resumable, with a report that grows by one robot at a time."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from skinnet.files import write_json
from skinnet.tools.bench.robots.robot_models import RobotModel
from skinnet.tools.bench.robots.trial import TrialOptions, run_trial

__all__ = ["run_benchmark"]

_REPORT = "report.json"


def run_benchmark(
    robots: list[RobotModel],
    models: Path,
    out: Path,
    options: TrialOptions,
    progress: Callable[[str], None],
    *,
    again: bool = False,
) -> dict[str, Any]:
    """Run the trials of `robots` that folder `out` has no report of; return all reports by robot.

    Args:
        robots: The robots.
        models: Folder of their models.
        out: Folder with one of each robot.
        options: Options of the trials.
        progress: Called with robot and step.
        again: Run all of them again.
    """
    reports = {}
    for number, robot in enumerate(robots, start=1):
        file = out / robot.name / _REPORT
        if again or not file.exists():
            said = f"{robot.name} ({number} of {len(robots)})"
            report = run_trial(robot, models, file.parent, options, _after(said, progress))
            write_json(file, report)
        reports[robot.name] = json.loads(file.read_text(encoding="utf-8"))
    return reports


def _after(said: str, progress: Callable[[str], None]) -> Callable[[str], None]:
    """Report steps after the text `said`."""
    return lambda step: progress(f"{said}: {step}")
