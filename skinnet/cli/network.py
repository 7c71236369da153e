"""Command `skinnet network simulate`: packet simulation of a topology from CSV files."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skinnet.cli.console import JsonOption, console, examples, write_report

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet network simulate --links links.csv --packets packets.csv \\",
    "    --until-ns 1000000000 --out delivered.csv",
    "skinnet network simulate --links links.csv --packets packets.csv.gz --routes routes.csv \\",
    "    --until-ns 1000000000 --out delivered.csv.gz --drops drops.csv --seed 3 --json -",
)

_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Simulate the packet network alone.")


def register(app: typer.Typer) -> None:
    """Register the command group `network`."""
    app.add_typer(_app, name="network", epilog=_EXAMPLES)


@_app.callback()
def _group() -> None:
    """Simulate the packet network alone."""


@_app.command(name="simulate", epilog=_EXAMPLES)
def _simulate(
    links: Annotated[
        Path,
        typer.Option(
            help="Input, directed links: src,src_port,dst,dst_port,bits_per_s,bits_per_byte,delay_ns,"
            "queue_packets (empty or -1: unbounded); loss_probability,jitter_ns,bit_error_rate are optional."
        ),
    ],
    packets: Annotated[
        Path, typer.Option(help="Input, packets in order of time: id,t_ns,node,dest,size_bytes.")
    ],
    until_ns: Annotated[int, typer.Option(min=0, max=2**61, help="End of the simulation [ns].")],
    out: Annotated[
        Path, typer.Option(help="File to write: id,t_delivered_ns, by time, node and order there.")
    ],
    routes: Annotated[
        Path | None,
        typer.Option(help="Input, routes: node,dest,src_port; by default those with the fewest hops."),
    ] = None,
    drops: Annotated[Path | None, typer.Option(help="File to write: id,t_ns,node,cause.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of loss, jitter and bit errors.")] = 0,
    json: JsonOption = None,
) -> None:
    """Simulate packets through directed links.

    Every file may be gzipped: NAME.csv.gz.
    """
    from skinnet.network.csv.csv_simulation import SimulationFiles, simulate_csv

    with _progress_bar() as bar:
        task = bar.add_task("packets", total=1.0)
        metrics = simulate_csv(
            SimulationFiles(links, packets, out, routes, drops),
            until_ns,
            seed=seed,
            progress=lambda fraction: bar.update(task, completed=fraction),
        )
    console(stderr=json == "-").print(_table(metrics))
    write_report({"seed": seed, "metrics": metrics}, json)


def _progress_bar() -> "Progress":
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    terminal = console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,
    )


def _table(metrics: dict[str, Any]) -> "Table":
    """Build the table of packets: enqueued, delivered, dropped, in flight."""
    from rich.table import Table

    prefix = "packets.dropped."
    causes = {name.removeprefix(prefix): n for name, n in metrics.items() if name.startswith(prefix)}
    table = Table(
        title=f"{metrics['nodes']} nodes, {metrics['links']} links, {metrics['until_ns'] / 1e6:g} ms",
        show_header=False,
    )
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_row("offered", str(metrics["packets.offered"]))
    table.add_row("delivered", str(metrics["packets.delivered"]))
    for cause, n in causes.items():
        if n:
            table.add_row(f"dropped: {cause.replace('_', ' ')}", str(n))
    if not metrics["packets.dropped"]:
        table.add_row("dropped", "0")
    table.add_row("in flight at the end", str(metrics["packets.in_flight"]))
    table.add_row(
        "offered = delivered + dropped + in flight", "yes" if metrics["packets.conserved"] else "NO"
    )
    if metrics["packets.not_before_until"]:
        table.add_row("not simulated: at or after --until-ns", str(metrics["packets.not_before_until"]))
    table.add_section()
    for name, value in metrics.items():
        if name.startswith(("latency.", "links.")) and value is not None:
            table.add_row(name, f"{value:.6g}")
    return table
