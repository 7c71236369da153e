"""Run folder of `skinnet run` or `skinnet stress`, read into one frozen structure.

Files of earlier formats are read under the present names, with one remark for the folder.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import msgspec

from skinnet.analysis.report.claims import ClaimComparison, evaluate_claim
from skinnet.analysis.report.deployment_metrics import deployment_metrics
from skinnet.analysis.report.papers import CLAIMS
from skinnet.analysis.report.pictures import Picture, read_pictures
from skinnet.deployment import Deployment
from skinnet.errors import FormatError, RunFolderError
from skinnet.migration import deployments
from skinnet.migration.renaming import remark_old_format
from skinnet.migration.summaries import FORMAT, translate_summary
from skinnet.output_folder import identity_of
from skinnet.runtime.outcome import ProcessFailure, ProcessReport

__all__ = [
    "Results",
    "RunFiles",
    "RunResults",
    "SeedResults",
    "StressResults",
    "StressSummary",
    "Summary",
    "evaluate_claims",
    "read_run_folder",
]

T = TypeVar("T")
_REMARK = "run folder"


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """`summary.json` of one run; unknown keys are kept apart."""

    outcome: str
    deployment: str
    version: str
    seed: int
    log_sha256: str
    pace: str
    sim_s: float
    wall_s: float
    loop_s: float
    rtf: float
    deadline_misses: int
    processes: tuple[ProcessReport, ...]
    process_failures: tuple[ProcessFailure, ...]
    counters: dict[str, dict[str, Any]]
    metrics: dict[str, Any]
    environment: dict[str, Any] = {}
    arithmetic: dict[str, str] = {}
    settings: tuple[str, ...] = ()
    run_id: str = ""
    deployment_sha256: str = ""
    format: int = FORMAT


class StressSummary(msgspec.Struct, frozen=True, kw_only=True):
    """`stress.json` of a sweep."""

    deployment: str
    stress: dict[str, Any]
    points: tuple[str, ...]
    failed: dict[str, str]
    metrics: dict[str, Any]
    environment: dict[str, Any] = {}
    settings: tuple[str, ...] = ()
    run_id: str = ""
    deployment_sha256: str = ""
    format: int = FORMAT


@dataclass(frozen=True)
class RunFiles:
    """Deployment and pictures beside a summary in its folder.

    Attributes:
        deployment: Deployment as it was run; None if absent, or of a version with other keys.
        deployment_keys: Deployment as plain data; empty if absent.
        run_id: Id of the run that wrote the folder, by its marker; empty without one.
        pictures: Readable pictures.
        damaged_files: Names of PNG files that are not valid.
    """

    deployment: Deployment | None = None
    deployment_keys: dict[str, Any] = field(default_factory=dict)
    pictures: tuple[Picture, ...] = ()
    damaged_files: tuple[str, ...] = ()
    run_id: str = ""

    def require_run(self, run_id: str, source: Path) -> None:
        """Require that the files are of the run that a summary names, if both name one.

        Raises:
            RunFolderError: they are not; `source` is the summary.
        """
        if run_id and self.run_id not in ("", run_id):
            raise RunFolderError(
                f"{source}: of another run than the files beside it, or in the folder of its seed; "
                f"run it again, in a folder of its own"
            )


@dataclass(frozen=True)
class RunResults:
    """Results of one run: summary, unknown summary keys, all metrics, files, and comparison with papers."""

    name: str
    summary: Summary
    unknown_keys: dict[str, Any]
    metrics: dict[str, Any]
    files: RunFiles
    comparisons: tuple[ClaimComparison, ...]


@dataclass(frozen=True)
class SeedResults:
    """Results of several seeds of one deployment."""

    name: str
    runs: tuple[RunResults, ...]


@dataclass(frozen=True)
class StressResults:
    """Results of a sweep of `skinnet stress`."""

    name: str
    summary: StressSummary
    metrics: dict[str, Any]
    files: RunFiles
    comparisons: tuple[ClaimComparison, ...]


Results: TypeAlias = RunResults | SeedResults | StressResults


def read_run_folder(folder: Path) -> Results:
    """Read the results in a run folder.

    Raises:
        RunFolderError: `folder` is no run folder, its run is not finished, or its summary is damaged.
    """
    if not folder.is_dir():
        raise RunFolderError(f"{folder}: there is no such folder; give one that skinnet run or stress wrote")
    name = folder.resolve().name
    if (folder / "stress.json").exists():
        return _read_stress(folder, name)
    if not (folder / "summary.json").exists():
        raise RunFolderError(f"{folder}: {_unfinished_reason(folder)}")
    source = folder / "summary.json"
    raw = _read_summary(source)
    if "runs" not in raw:
        return _read_run(name, source, raw, _read_files(folder))
    rows = raw["runs"]
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise RunFolderError(f"{source}: damaged: runs must be a list of summaries")
    names = [f"seed-{row.get('seed')}" for row in rows]
    return SeedResults(
        name,
        tuple(
            _read_run(one, source, row, _read_files(folder / one))
            for one, row in zip(names, rows, strict=True)
        ),
    )


def _unfinished_reason(folder: Path) -> str:
    if (folder / "deployment.json").exists():
        logs = f"; {folder / 'logs'} has the logs" if (folder / "logs").is_dir() else ""
        return f"there is no summary.json: the run failed, was stopped, or is still going on{logs}"
    if any(folder.glob("*/point.json")):
        return "there is no stress.json: the sweep is not finished; continue it with skinnet stress --resume"
    if any(folder.glob("seed-*/deployment.json")):
        return "there is no summary.json: not all seeds are finished; each seed's own folder can be reported"
    return "not a run folder: neither summary.json nor stress.json is in it"


def _read_run(name: str, source: Path, raw: dict[str, Any], files: RunFiles) -> RunResults:
    summary = _convert(raw, Summary, source)
    files.require_run(summary.run_id, source)
    others = {key: value for key, value in raw.items() if key not in Summary.__struct_fields__}
    metrics = deployment_metrics(files.deployment) | summary.metrics
    return RunResults(
        name,
        summary,
        others,
        metrics,
        files,
        evaluate_claims(summary.deployment, metrics, files.deployment_keys),
    )


def _read_stress(folder: Path, name: str) -> StressResults:
    source = folder / "stress.json"
    summary = _convert(_read_summary(source), StressSummary, source)
    made = _read_files(folder)
    made.require_run(summary.run_id, source)
    metrics = deployment_metrics(made.deployment) | summary.metrics
    return StressResults(
        name, summary, metrics, made, evaluate_claims(summary.deployment, metrics, made.deployment_keys)
    )


def _read_files(folder: Path) -> RunFiles:
    pictures, damaged = read_pictures(folder)
    source = folder / "deployment.json"
    if not source.exists():
        return RunFiles(None, {}, tuple(pictures), tuple(damaged))
    raw = _read(source)
    try:
        keys, n_renamed = deployments.translate(raw, str(source))
    except FormatError as error:
        raise RunFolderError(str(error)) from None
    if n_renamed:
        remark_old_format(folder, _REMARK)
    try:
        deployment = msgspec.convert(keys, Deployment)
    except msgspec.ValidationError:
        deployment = None
    identity = identity_of(folder)
    run_id = "" if identity is None else identity.run_id
    return RunFiles(deployment, keys, tuple(pictures), tuple(damaged), run_id)


def evaluate_claims(
    name: str, metrics: dict[str, Any], deployment_keys: dict[str, Any]
) -> tuple[ClaimComparison, ...]:
    """Compare the papers' claims on deployment `name` with a run's metrics and its `deployment_keys`."""
    found = (evaluate_claim(claim, metrics, deployment_keys) for claim in CLAIMS.get(name, ()))
    return tuple(compared for compared in found if compared is not None)


def _read(path: Path) -> dict[str, Any]:
    try:
        raw = msgspec.json.decode(path.read_bytes())
    except msgspec.DecodeError as error:
        raise RunFolderError(f"{path}: damaged: {error}") from None
    if not isinstance(raw, dict):
        raise RunFolderError(f"{path}: damaged: it must be a JSON object")
    return raw


def _read_summary(path: Path) -> dict[str, Any]:
    """Read `summary.json` or `stress.json` of any known format, under the present names."""
    try:
        summary, n_renamed = translate_summary(_read(path), str(path))
    except FormatError as error:
        raise RunFolderError(str(error)) from None
    if n_renamed is not None:
        remark_old_format(path.parent, _REMARK)
    return summary


def _convert(raw: dict[str, Any], kind: type[T], source: Path) -> T:
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        raise RunFolderError(f"{source}: damaged: {error}") from None
