"""Command `skinnet bench network`: benchmark of the packet kernel against other simulators."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from skinnet.cli.console import JsonOption, console, examples, write_report

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["register"]

_EXAMPLES = examples("skinnet bench network", "skinnet bench network --quick --json bench.json")

_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Benchmark the simulator.")


def register(app: typer.Typer) -> None:
    """Register the command group `bench`."""
    app.add_typer(_app, name="bench", epilog=_EXAMPLES)


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
