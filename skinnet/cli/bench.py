"""Command `skinnet bench network`: benchmark of the packet kernel against other simulators."""

from typing import Annotated, Any

import typer
from rich.table import Table

from skinnet.cli.console import JsonOption, console, write_report
from skinnet.tools.bench.kernel_benchmark import run_benchmarks

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="Measures this machine's speed, and others beside it.")


@app.callback()
def _group() -> None:
    """Benchmark the simulator on this computer."""


@app.command(name="network")
def _network(
    quick: Annotated[bool, typer.Option("--quick", help="Fewer packets and rounds, for a look.")] = False,
    json: JsonOption = None,
) -> None:
    """Benchmark the packet kernel against SimPy, an event heap and, if installed, ns-3, in CPU time."""
    progress = console(stderr=True)
    with progress.status("starting") as status:
        figures = run_benchmarks(quick=quick, progress=status.update)
    console(stderr=json == "-").print(_table(figures))
    write_report({"metrics": figures}, json)


def _table(metrics: dict[str, Any]) -> Table:
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
