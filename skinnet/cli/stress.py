"""Command `skinnet stress`: load sweep of network, computer and controller."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_args

import typer

from skinnet.cli.console import (
    DeploymentArgument,
    JsonOption,
    OutOption,
    PlotsOption,
    SettingsOption,
    console,
    examples,
    line_printer,
    write_report,
)
from skinnet.errors import DeploymentError, SkinnetError, UsageError
from skinnet.suggestions import did_you_mean

if TYPE_CHECKING:
    from skinnet.deployment import Deployment
    from skinnet.deployment.experiment.stress import StressSpec
    from skinnet.tools.stress.sweep import PointResult

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet stress deployments/h1_1260.toml --quick",
    "skinnet stress deployments/h1_1260.toml --cells 250,1260 --encodings periodic,send_on_delta",
    "skinnet stress deployments/h1_1260.toml --stimulated 0,0.1 --gateways 1,2 --out runs/sweep",
    "skinnet stress deployments/h1_1260.toml --resume --out runs/sweep",
)
_QUICK_SETTINGS = {"duration_s": 1.0, "warm_up_s": 0.5, "delta_noise_ratios": ()}
T = TypeVar("T")


def register(app: typer.Typer) -> None:
    """Register the command `stress`."""
    app.command(epilog=_EXAMPLES)(stress)


def stress(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    cells: Annotated[
        str | None, typer.Option(metavar="N,…", help="Numbers of cells, rounded up to whole patches.")
    ] = None,
    encodings: Annotated[
        str | None,
        typer.Option(metavar="periodic,send_on_delta,level_crossing", help="Encodings of the cells."),
    ] = None,
    stimulated: Annotated[
        str | None, typer.Option(metavar="F,…", help="Fractions of stimulated cells, 0 to 1.")
    ] = None,
    gateways: Annotated[
        str | None, typer.Option(metavar="N,…", help="Numbers of gateways of each patch.")
    ] = None,
    sigmas: Annotated[
        str | None,
        typer.Option(metavar="K,…", help="Thresholds of send-on-delta, in multiples of the noise."),
    ] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration-s", help="Simulated time that is measured at each point [s].")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Measures one second at each point, and sweeps no thresholds.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keeps the finished points of an earlier sweep in --out.")
    ] = False,
    out: OutOption = None,
    json: JsonOption = None,
    plots: PlotsOption = True,
) -> None:
    """Sweep the load of a deployment.

    Numbers of cells, encodings, stimulation and gateways vary; each point is a run in separate processes over
    Zenoh.
    """
    if resume and out is None:
        raise UsageError("--resume needs --out, the folder of the sweep to continue")
    from msgspec import to_builtins

    from skinnet.deployment import resolved_json
    from skinnet.files import write_bytes, write_json
    from skinnet.migration.summaries import FORMAT
    from skinnet.output_folder import new_folder, own_folder
    from skinnet.run.environment import environment
    from skinnet.run.prepare import RunOptions, prepare_run
    from skinnet.tools.stress.points import derive_points
    from skinnet.tools.stress.sweep import SWEEP_FILES, run_sweep
    from skinnet.tools.stress.sweep_metrics import print_table, sweep_metrics

    deployment = prepare_run(RunOptions(file, tuple(settings or ()))).deployment
    if not deployment.patches:
        raise DeploymentError(f"{file}: patches: none; a stress test needs a network of cells")
    given: dict[str, Any] = dict(_QUICK_SETTINGS) if quick else {}
    for option, key, text, kind in (
        ("--cells", "cells", cells, int),
        ("--encodings", "encodings", encodings, str),
        ("--stimulated", "stimulated_fractions", stimulated, float),
        ("--gateways", "gateways", gateways, int),
        ("--sigmas", "delta_noise_ratios", sigmas, float),
    ):
        if text is not None:
            given[key] = _parse_list(option, text, kind)
    if duration_s is not None:
        given["duration_s"] = duration_s
    spec = _stress_spec(deployment, given)
    points = derive_points(deployment, spec)  # refuses what cannot be swept before anything is written
    stem = Path("runs") / f"stress-{file.stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    resolved = resolved_json(deployment)
    terminal = console(stderr=json == "-")
    print_line = line_printer(terminal)
    folder = new_folder(stem) if out is None else out
    with own_folder(folder, "skinnet stress", resolved, SWEEP_FILES) as owned:
        write_bytes(folder / "deployment.json", resolved)
        results = run_sweep(file, points, spec, folder, resume=resume, progress=print_line)
        report = {
            "format": FORMAT,
            "deployment": deployment.name,
            "run_id": owned.identity.run_id,
            "deployment_sha256": owned.identity.deployment_sha256,
            "stress": to_builtins(spec),
            "points": [result.point.name for result in results],
            "failed": {result.point.name: result.failure for result in results if result.failure is not None},
            "metrics": sweep_metrics(deployment, spec, results),
            "environment": environment(),
            "settings": list(settings or ()),
        }
        owned.require_ownership()
        write_json(folder / "stress.json", report)
        if plots:
            _draw(spec, deployment, results, folder)
    print_table(terminal, deployment, spec, results)
    print_line(f"results in {folder}")
    write_report(report, json)
    if report["failed"]:
        raise SkinnetError(f"{len(report['failed'])} of {len(results)} points failed")


def _parse_list(option: str, text: str, kind: Callable[[str], T]) -> tuple[T, ...]:
    """Parse the list "a,b,c" of an option.

    Raises:
        UsageError: an element is no number.
    """
    try:
        return tuple(kind(word.strip()) for word in text.split(","))
    except ValueError:
        raise UsageError(f"{option} {text}: must be numbers separated by commas") from None


def _stress_spec(deployment: "Deployment", given: dict[str, Any]) -> "StressSpec":
    """Build the sweep specification: that of the deployment, with the overrides of the command line."""
    from msgspec import ValidationError, convert, to_builtins

    from skinnet.deployment.experiment.stress import StressSpec
    from skinnet.deployment.types import Encoding
    from skinnet.schema_words import in_words

    try:
        return convert(to_builtins(deployment.stress) | given, StressSpec)
    except ValidationError as error:
        known = get_args(Encoding)
        unknown = next((name for name in given.get("encodings", ()) if name not in known), None)
        hint = f"; {did_you_mean(unknown, known)}allowed: {', '.join(known)}" if unknown is not None else ""
        raise DeploymentError(f"stress: {in_words(str(error))}{hint}") from None


def _draw(spec: "StressSpec", deployment: "Deployment", results: "list[PointResult]", folder: Path) -> None:
    from skinnet.tools.stress.plots import draw_plots  # matplotlib takes a second to import

    draw_plots(deployment, spec, results, folder)
