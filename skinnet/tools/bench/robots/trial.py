"""Trial of one robot as a user would go: init, cover, check, then a run, each a command with its report.

The run explores structure and map, presses cells with a known force while no reaction is on, and then touches
each of them again while the robot evades.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinnet.covering.covered_deployment import load_covered
from skinnet.files import write_bytes
from skinnet.onboarding.touch_choice import TouchedCell, choose_touches
from skinnet.tools.bench.robots.robot_models import RobotModel

__all__ = ["TrialOptions", "run_trial"]

_FORCE_N = 0.5
"""Known force of a press (assumed)."""
_PRESS_S = 2.4
"""Time of a press: approach from 20 mm at 30 mm/s, hold, withdrawal."""
_EVADE_S = 3.5
"""Duration of a stage in which the robot evades one touch."""
_PRESS = "press"
_CHECK_S = 0.5


@dataclass(frozen=True)
class TrialOptions:
    """Options of a trial.

    Attributes:
        n_touches: Cells that are touched.
        timeout_s: Longest time of one command [s].
        seed: Seed of the run.
    """

    n_touches: int = 20
    timeout_s: float = 3600.0
    seed: int = 1


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
        said = _skinnet("init", str(robot.path(models)), "--out", str(file), "--force", **_limits(options))
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
    except _CommandError as error:
        report["failed"] = f"{step}: {error}"
    return report


@dataclass(frozen=True)
class _Said:
    lines: list[str]
    cpu_s: float
    wall_s: float


def _limits(options: TrialOptions) -> dict[str, float]:
    return {"timeout_s": options.timeout_s}


def _skinnet(*arguments: str, timeout_s: float, allowed: tuple[int, ...] = (0,)) -> _Said:
    """Run a command of skinnet; CPU time is that of all its processes.

    Raises:
        _CommandError: it ended with an error, or not in time.
    """
    before, start_s = os.times(), time.monotonic()
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
    if done.returncode not in allowed:
        raise _CommandError((done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1])
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return _Said(done.stdout.splitlines(), round(cpu_s, 2), round(time.monotonic() - start_s, 2))


def _cover(file: Path, folder: Path, options: TrialOptions) -> dict[str, Any]:
    """Metrics of the covering, made anew, of all links and the worst of single ones."""
    target = folder / "cover.json"
    _skinnet("cover", str(file), "--no-cache", "--json", str(target), **_limits(options))
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
        allowed=(0, 2),
        **_limits(options),
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
        "run", str(more), "--in-process", "--no-plots", "--seed", str(options.seed), "--out", str(out),
        **_limits(options),
    )  # fmt: skip
    summary = _read(out / "summary.json")
    return summary["metrics"] | {
        "run.cpu_s": said.cpu_s,
        "run.rtf": summary["rtf"],
        "touches": len(touches),
    }


def _touched_toml(robot_file: str, touches: list[TouchedCell]) -> str:
    """Deployment that extends that of the robot by presses with a known force, and touches that it evades."""
    stages = [f"evade_{i}" for i in range(len(touches))]
    program = ["structure", "map", _PRESS, *(name for stage in stages for name in (stage, "home"))]
    lines = [
        f'extends = "{robot_file}"',
        "format = 2",
        'name = "touched"',
        "[run]",
        "max_s = 3600.0",
        "[controller]",
        f"program = {json.dumps(program)}",
        "[controller.stages]",
        f'{_PRESS} = {{ kind = "guide", duration_s = {_PRESS_S * len(touches) + 1.0:g} }}',
        'home = { kind = "posture" }',
    ]
    evade = f'{{ kind = "guide", duration_s = {_EVADE_S}, force_gain = 1.0, force_threshold = 0.05 }}'
    lines += [f"{stage} = {evade}" for stage in stages]
    for i, touch in enumerate(touches):
        lines += _touch_lines(touch, _PRESS, 0.2 + _PRESS_S * i, f"force_n = {_FORCE_N}")
    for stage, touch in zip(stages, touches, strict=True):
        lines += _touch_lines(touch, stage, 0.2, "depth_m = 0.03")
    return "\n".join(lines) + "\n"


def _touch_lines(touch: TouchedCell, stage: str, start_s: float, goal: str) -> list[str]:
    return [
        "[[teacher.touches]]",
        f"cell = {json.dumps(touch.cell)}",
        f'stage = "{stage}"',
        f"start_s = {start_s:g}",
        "approach_m = 0.02",
        goal,
    ]


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
