"""Command `skinnet network simulate`: packet simulation of a topology from CSV files."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from skinnet.cli.console import JsonOption, console, write_report
from skinnet.network.csv.csv_simulation import SimulationFiles, simulate_csv

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="The packet network by itself.")


@app.callback()
def _group() -> None:
    """Simulate the packet network alone."""


@app.command(name="simulate")
def _simulate(
    links: Annotated[
        Path,
        typer.Option(
            help="Directed links: src,src_port,dst,dst_port,bits_per_s,bits_per_byte,delay_ns,queue_packets "
            "(empty or -1: unbounded); may have loss_probability,jitter_ns,bit_error_rate."
        ),
    ],
    packets: Annotated[Path, typer.Option(help="Packets in order of time: id,t_ns,node,dest,size_bytes.")],
    until_ns: Annotated[int, typer.Option(min=0, max=2**61, help="Ends before this time [ns].")],
    out: Annotated[Path, typer.Option(help="Written: id,t_delivered_ns, by time, node and order there.")],
    routes: Annotated[
        Path | None, typer.Option(help="Routes: node,dest,src_port. Fewest hops unless given.")
    ] = None,
    drops: Annotated[Path | None, typer.Option(help="Written: id,t_ns,node,cause.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of loss, jitter and bit errors.")] = 0,
    json: JsonOption = None,
) -> None:
    """Simulate packets through a network of directed links. Every file may be gzipped: NAME.csv.gz."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=console(stderr=True),
        transient=True,
        disable=not console(stderr=True).is_terminal,
    )
    with bar:
        task = bar.add_task("packets", total=1.0)
        figures = simulate_csv(
            SimulationFiles(links, packets, out, routes, drops),
            until_ns,
            seed=seed,
            progress=lambda share: bar.update(task, completed=share),
        )
    console(stderr=json == "-").print(_table(figures))
    write_report({"seed": seed, "metrics": figures}, json)


def _table(metrics: dict[str, Any]) -> Table:
    """Build the table of packets: enqueued, delivered, dropped, in flight."""
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
        table.add_row("not offered: from --until-ns on", str(metrics["packets.not_before_until"]))
    table.add_section()
    for name, value in metrics.items():
        if name.startswith(("latency.", "links.")) and value is not None:
            table.add_row(name, f"{value:.6g}")
    return table
