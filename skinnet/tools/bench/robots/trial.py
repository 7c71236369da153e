"""Trial of one robot as a user would go: init, cover, check, then a run, each a command with its report.

The run explores structure and map, presses cells with a known force while no reaction is on, and then touches
each of them again while the robot evades.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinnet.covering.covered_deployment import load_covered
from skinnet.errors import SkinnetError
from skinnet.files import write_bytes
from skinnet.migration.deployments import FORMAT
from skinnet.onboarding.touch_choice import TouchedCell, choose_touches
from skinnet.toml_values import toml_value
from skinnet.tools.bench.robots.robot_models import RobotModel

__all__ = ["TrialOptions", "run_trial"]

_FORCE_N = 0.5
"""Known force of a press (assumed)."""
_PRESS_S = 2.4
"""Time of a press: approach from 20 mm at 30 mm/s, hold, withdrawal."""
_START_S, _HOLD_S, _HOME_S = 0.2, 0.5, 0.5
"""Start of a touch within its stage, its hold, and the time from its end to that of the stage [s]: what is
still there when the robot goes home is run into with hundreds of newtons."""
_PRESS_APPROACH_M, _EVADE_APPROACH_M, _EVADE_DEPTH_M = 0.02, 0.01, 0.02
_MAX_SPEED_M_S = 0.03
_EVADED_READING = 0.08
"""Force reading at which a robot goes as fast as the finger that it evades (assumed): with unit gain it goes
by this reading times the evasion of the cell, and a finger faster than that goes through the foam."""
_PRESS = "press"
_CHECK_S = 0.5


@dataclass(frozen=True)
class TrialOptions:
    """Options of a trial.

    Attributes:
        n_touches: Cells that are touched.
        timeout_s: Longest time of one command [s].
    """

    n_touches: int = 20
    timeout_s: float = 3600.0


class _CommandError(Exception):
    """A command ended with an error; the text is its last line."""


def run_trial(
    robot: RobotModel, models: Path, folder: Path, options: TrialOptions, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Run the trial of a robot in `folder`; return its report, with `failed` if a step did not succeed.

    Args:
        robot: The robot.
        models: Folder of all models.
        folder: Folder for what the commands write.
        options: Options of the trial.
        progress: Called with the name of each step.
    """
    folder.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {"robot": robot.name, "lines": len(robot.more.splitlines())}
    file, step = folder / "robot.toml", "init"
    try:
        progress(step)
        said = _skinnet(
            "init", str(robot.path(models)), "--out", str(file), "--force", timeout_s=options.timeout_s
        )
        report |= {"init.cpu_s": said.cpu_s, "init.notes": said.lines[1:-1]}
        if robot.more:
            write_bytes(file, file.read_bytes() + b"\n" + robot.more.encode())
        step = "cover"
        progress(step)
        report |= _cover(file, folder, options)
        step = "check"
        progress(step)
        report |= _check(file, folder, options)
        step = "run"
        progress(step)
        report |= _run(file, folder, options)
    except (_CommandError, SkinnetError) as error:
        report["failed"] = f"{step}: {error}"
    return report


@dataclass(frozen=True)
class _Said:
    lines: list[str]
    cpu_s: float


def _skinnet(*arguments: str, timeout_s: float, findings: Path | None = None) -> _Said:
    """Run a command of skinnet; CPU time is that of all its processes.

    Args:
        *arguments: The command and its arguments.
        timeout_s: Longest time of the command [s].
        findings: File of the findings that it writes, among them errors, with which it ends as if refused.

    Raises:
        _CommandError: it ended with an error, or not in time.
    """
    if findings is not None:
        findings.unlink(missing_ok=True)  # one of a trial before would pass for that of this one
    before = os.times()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "skinnet.cli", *arguments],
            capture_output=True,
            text=True,
            check=False,
            timeout=timeout_s,
        )
    except subprocess.TimeoutExpired:
        raise _CommandError(f"not done within {timeout_s:g} s") from None
    after = os.times()
    if done.returncode and not (findings is not None and findings.exists()):
        raise _CommandError((done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1])
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return _Said(done.stdout.splitlines(), round(cpu_s, 2))


def _cover(file: Path, folder: Path, options: TrialOptions) -> dict[str, Any]:
    """Metrics of the covering, made anew: of all links together, and of each."""
    target = folder / "cover.json"
    _skinnet("cover", str(file), "--no-cache", "--json", str(target), timeout_s=options.timeout_s)
    report = _read(target)
    return {f"cover.{name}": value for name, value in report["cover"].items()} | {
        "cover.cpu_s": report["cpu_s"],
        "cover.links": report["links"],
        "cover.bare": report["bare"],
    }


def _check(file: Path, folder: Path, options: TrialOptions) -> dict[str, Any]:
    """Numbers of findings, and joints that the exploration cannot tell."""
    target = folder / "check.json"
    said = _skinnet(
        "check",
        str(file),
        "--settle",
        str(_CHECK_S),
        "--json",
        str(target),
        findings=target,
        timeout_s=options.timeout_s,
    )
    findings = _read(target)["findings"]
    counts = {
        f"check.{severity}s": sum(each["severity"] == severity for each in findings)
        for severity in ("error", "warning", "remark")
    }
    return counts | {"check.findings": findings, "check.cpu_s": said.cpu_s}


def _run(file: Path, folder: Path, options: TrialOptions) -> dict[str, Any]:
    """Metrics of a run that explores, presses, and touches again."""
    deployment = load_covered(file)
    touches = choose_touches(deployment, file.parent, deployment.patches, options.n_touches)
    more, out = folder / "touched.toml", folder / "run"
    write_bytes(more, _touched_toml(file.name, touches).encode())
    said = _skinnet(
        "run", str(more), "--in-process", "--no-plots", "--out", str(out), timeout_s=options.timeout_s
    )
    summary = _read(out / "summary.json")
    metrics: dict[str, Any] = summary["metrics"]
    return metrics | {
        "run.cpu_s": said.cpu_s,
        "run.rtf": summary["rtf"],
        "touches": len(touches),
    }


def _touched_toml(robot_file: str, touches: list[TouchedCell]) -> str:
    """Deployment that extends that of the robot by presses with a known force, and touches that it evades."""
    stages = {f"evade_{i}": touch for i, touch in enumerate(touches)}
    program = ["structure", "map", _PRESS, *(name for stage in stages for name in (stage, "home"))]
    lines = [
        f"extends = {toml_value(robot_file)}",
        f"format = {FORMAT}",
        'name = "touched"',
        "[run]",
        "max_s = 3600.0",
        "[controller]",
        f"program = {toml_value(program)}",
        "[controller.stages]",
        f'{_PRESS} = {{ kind = "guide", duration_s = {_PRESS_S * len(touches) + 1.0:g} }}',
        'home = { kind = "posture" }',
    ]
    for stage, touch in stages.items():
        way_s = (_EVADE_APPROACH_M + _EVADE_DEPTH_M) / _speed_m_s(touch)
        duration_s = _START_S + 2.0 * way_s + _HOLD_S + _HOME_S
        lines.append(
            f'{stage} = {{ kind = "guide", duration_s = {duration_s:.3f}, force_gain = 1.0, '
            "force_threshold = 0.05 }"
        )
    for i, touch in enumerate(touches):
        goal = {"force_n": _FORCE_N, "approach_m": _PRESS_APPROACH_M, "speed_m_s": _MAX_SPEED_M_S}
        lines += _touch_lines(touch, _PRESS, _START_S + _PRESS_S * i, goal)
    for stage, touch in stages.items():
        goal = {"depth_m": _EVADE_DEPTH_M, "approach_m": _EVADE_APPROACH_M, "speed_m_s": _speed_m_s(touch)}
        lines += _touch_lines(touch, stage, _START_S, goal | {"hold_s": _HOLD_S})
    return "\n".join(lines) + "\n"


def _speed_m_s(touch: TouchedCell) -> float:
    """Speed of a finger that a cell can evade [m/s]."""
    return round(min(_MAX_SPEED_M_S, _EVADED_READING * touch.evasion_m), 4)


def _touch_lines(touch: TouchedCell, stage: str, start_s: float, goal: dict[str, float]) -> list[str]:
    return [
        "[[teacher.touches]]",
        f"cell = {toml_value(touch.cell)}",
        f'stage = "{stage}"',
        f"start_s = {start_s:g}",
        *(f"{key} = {value:g}" for key, value in goal.items()),
    ]


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
