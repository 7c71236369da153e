"""Sweep of a stress test: runs its points in sequence and keeps the finished ones."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console

from skinnet import __version__
from skinnet.deployment import Deployment, resolved_json
from skinnet.deployment.experiment.stress import StressSpec
from skinnet.errors import SkinnetError
from skinnet.files import write_json
from skinnet.output_folder import add_output_file, identity_of
from skinnet.run.arithmetic import arithmetic, compare_arithmetic, used_parts
from skinnet.run.pipeline import run_once
from skinnet.run.prepare import PreparedRun, RunOptions
from skinnet.run.process_list import process_list
from skinnet.run.progress import ProgressDisplay
from skinnet.tools.stress.measurement import measure_point
from skinnet.tools.stress.other_load import OtherLoad
from skinnet.tools.stress.points import Point

__all__ = ["SWEEP_FILES", "PointResult", "run_sweep"]

SWEEP_FILES = (
    *("deployment.json", "stress.json", "report.html"),
    *(f"{name}.png" for name in ("rates", "latency", "cpu", "event_driven", "thresholds")),
)
"""Files of the folder of a sweep, apart from the folders of its points."""
_RESULT = "point.json"


@dataclass
class PointResult:
    """Result of a point: its metrics, or the reason of its failure."""

    point: Point
    metrics: dict[str, Any] = field(default_factory=dict)
    failure: str | None = None


def run_sweep(
    file: Path,
    points: Sequence[tuple[Point, Deployment]],
    spec: StressSpec,
    out: Path,
    *,
    resume: bool,
    progress: Callable[[str], None],
) -> list[PointResult]:
    """Run every point in a folder of its own below `out`; a failed point does not end the sweep.

    Args:
        file: The deployment's file; paths in it start from its folder.
        points: Points and their deployments (`derive_points`).
        spec: Sweep that they belong to.
        out: Folder of the sweep, which the caller owns.
        resume: Keep the points in `out` that are finished and were made from the same deployment.
        progress: Callback for progress, one line at a time.
    """
    results = []
    for number, (point, what) in enumerate(points, start=1):
        head = f"{number}/{len(points)} {point.name}"
        folder, mark = out / point.name, _fingerprint(what, file)
        result = _load_finished(folder, mark, point) if resume else None
        if resume and result is None and (reason := _other_arithmetic(folder, what)):
            progress(f"{head}: not kept, {reason}")
        if result is not None:
            progress(f"{head}: kept, {_result_line(result)}")
        else:
            result = _run_point(file, what, spec, point, folder)
            if result.failure is None:
                add_output_file(folder, _RESULT)
                made = {"mark": mark, "run_id": _run_id(folder), "arithmetic": arithmetic(used_parts(what))}
                write_json(folder / _RESULT, made | asdict(result))
            progress(f"{head}: {_result_line(result)}")
        results.append(result)
    return results


def _fingerprint(deployment: Deployment, file: Path) -> str:
    """Fingerprint of a result's inputs: deployment, folder of its paths, program version, arithmetic."""
    where = f"{file.resolve().parent} {__version__} {arithmetic(used_parts(deployment))['all']}"
    what = resolved_json(deployment) + where.encode()
    return hashlib.sha256(what).hexdigest()


def _load_finished(folder: Path, mark: str, point: Point) -> PointResult | None:
    try:
        saved = msgspec.json.decode((folder / _RESULT).read_bytes())
    except (FileNotFoundError, msgspec.DecodeError):
        return None
    marks = saved.get("mark"), saved.get("run_id")
    return PointResult(point, saved["metrics"]) if marks == (mark, _run_id(folder)) else None


def _other_arithmetic(folder: Path, deployment: Deployment) -> str:
    """Return why a finished result cannot be compared with one of this computer; empty if it can."""
    try:
        saved = msgspec.json.decode((folder / _RESULT).read_bytes())
    except (FileNotFoundError, msgspec.DecodeError):
        return ""
    return compare_arithmetic({"arithmetic": arithmetic(used_parts(deployment))}, saved)


def _run_id(folder: Path) -> str | None:
    """Id of the run whose results are in a point's folder."""
    identity = identity_of(folder)
    return None if identity is None else identity.run_id


def _run_point(
    file: Path, deployment: Deployment, spec: StressSpec, point: Point, folder: Path
) -> PointResult:
    quiet = ProgressDisplay(Console(stderr=True), quiet=True)
    others = OtherLoad()
    try:
        options = RunOptions(file, plots=False)
        run_once(PreparedRun(options, deployment, file.parent.resolve()), folder, quiet)
        busy = {"others_cores": others.cores}
        names = [process.name for process in process_list(deployment)]
        return PointResult(point, measure_point(deployment, spec, folder, names) | busy)
    except SkinnetError as error:
        return PointResult(point, failure=_one_line(error))


def _one_line(error: SkinnetError) -> str:
    """Error message in one line: its first and its last line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if len(lines) < 2 else f"{lines[0]} {lines[-1]}"


def _result_line(result: PointResult) -> str:
    if result.failure is not None:
        return f"failed: {result.failure}"
    metrics = result.metrics
    return (
        f"{metrics['packets_per_s']:.0f} packets/s, "
        f"{100 * metrics['fraction.packets']:.1f} % of clock-driven, "
        f"controller {metrics['cpu.controller']:.2f} CPU-s/s, {metrics['rtf']:.2f} × real time"
    )
