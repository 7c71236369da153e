"""Command `skinnet stress`: load sweep of network, computer and controller."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from msgspec import ValidationError, convert, to_builtins
from rich.console import Console

from skinnet.cli.console import (
    DeploymentArgument,
    JsonOption,
    OutOption,
    SettingsOption,
    console,
    write_report,
)
from skinnet.deployment import Deployment, resolved_json
from skinnet.deployment.experiment.stress import StressSpec
from skinnet.errors import DeploymentError, SkinnetError
from skinnet.files import write_bytes, write_json
from skinnet.run.environment import environment
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.tools.stress.sweep import PointResult, run_sweep
from skinnet.tools.stress.sweep_metrics import print_table, sweep_metrics

__all__ = ["stress"]

_QUICK_SETTINGS = {"duration_s": 1.0, "warm_up_s": 0.5, "delta_noise_ratios": ()}
_OPTIONS = {"delta_noise_ratios": "--sigmas", "stimulated_fractions": "--stimulated"}
"""Option of a key of `StressSpec`, where it is not called as the key."""
T = TypeVar("T")


def stress(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    cells: Annotated[
        str | None, typer.Option(metavar="N,…", help="Numbers of cells, by whole patches.")
    ] = None,
    encodings: Annotated[str | None, typer.Option(metavar="periodic,send_on_delta,level_crossing")] = None,
    stimulated: Annotated[
        str | None, typer.Option(metavar="SHARE,…", help="Shares of stimulated cells.")
    ] = None,
    gateways: Annotated[str | None, typer.Option(metavar="N,…", help="Gateways of each patch.")] = None,
    sigmas: Annotated[
        str | None,
        typer.Option(metavar="K,…", help="Also send-on-delta with deltas of so many times the noise."),
    ] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration-s", help="Simulated time measured in each point.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="One second a point, no sweep of thresholds.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the finished points of an earlier sweep in --out.")
    ] = False,
    out: OutOption = None,
    json: JsonOption = None,
    plots: Annotated[bool, typer.Option("--plots/--no-plots", help="Draw plots.")] = True,
) -> None:
    """Sweep cells, encodings, stimulation and gateways, with separate processes over Zenoh."""
    if resume and out is None:
        raise DeploymentError("--resume: say with --out which sweep to go on with")
    deployment = prepare_run(RunOptions(file, tuple(settings or ()))).deployment
    if not deployment.patches:
        raise DeploymentError(
            f"{file}: patches: there are none; a stress test is one of the network of cells"
        )
    given: dict[str, Any] = dict(_QUICK_SETTINGS) if quick else {}
    for name, text, kind in (
        ("cells", cells, int),
        ("encodings", encodings, str),
        ("stimulated_fractions", stimulated, float),
        ("gateways", gateways, int),
        ("delta_noise_ratios", sigmas, float),
    ):
        if text is not None:
            given[name] = _parse_list(name, text, kind)
    if duration_s is not None:
        given["duration_s"] = duration_s
    spec = _stress_spec(deployment, given)
    folder = out or Path("runs") / f"stress-{file.stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    terminal = console(stderr=json == "-")
    results = run_sweep(file, deployment, spec, folder, resume=resume, progress=_line_printer(terminal))
    report = {
        "deployment": deployment.name,
        "stress": to_builtins(spec),
        "points": [result.point.name for result in results],
        "failed": {result.point.name: result.failure for result in results if result.failure is not None},
        "metrics": sweep_metrics(deployment, spec, results),
        "environment": environment(),
        "settings": list(settings or ()),
    }
    write_bytes(folder / "deployment.json", resolved_json(deployment))
    write_json(folder / "stress.json", report)
    if plots:
        _draw(spec, deployment, results, folder)
    print_table(terminal, deployment, spec, results)
    terminal.print(f"everything is in {folder}", highlight=False, soft_wrap=True)
    write_report(report, json)
    if report["failed"]:
        raise SkinnetError(f"{len(report['failed'])} of {len(results)} points failed")


def _line_printer(terminal: Console) -> Callable[[str], None]:
    return lambda line: terminal.print(line, highlight=False, markup=False, soft_wrap=True)


def _parse_list(name: str, text: str, kind: Callable[[str], T]) -> tuple[T, ...]:
    """Parse the list "a,b,c" of option `name`.

    Raises:
        DeploymentError: an element is no number.
    """
    try:
        return tuple(kind(word.strip()) for word in text.split(","))
    except ValueError:
        option = _OPTIONS.get(name, f"--{name}")
        raise DeploymentError(f"{option} {text}: write numbers with commas between them") from None


def _stress_spec(deployment: Deployment, given: dict[str, Any]) -> StressSpec:
    """Build the sweep specification: that of the deployment, with the overrides of the command line."""
    try:
        return convert(to_builtins(deployment.stress) | given, StressSpec)
    except ValidationError as error:
        raise DeploymentError(f"stress: {error}") from None


def _draw(spec: StressSpec, deployment: Deployment, results: list[PointResult], folder: Path) -> None:
    from skinnet.tools.stress.plots import draw_plots  # matplotlib takes a second to import

    draw_plots(deployment, spec, results, folder)
