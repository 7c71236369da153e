"""Command `skinnet memory`: show, export and import long-term memory files."""

import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from skinnet.body.model import load_model
from skinnet.cli.console import console
from skinnet.deployment import load
from skinnet.deployment.checks.checks import check
from skinnet.deployment.memory_loading import check_compatible, read_memory_json
from skinnet.errors import DeploymentError, MemoryFileError
from skinnet.files import write_bytes
from skinnet.memory.contents import MemoryContents
from skinnet.memory.json_export import to_json
from skinnet.memory.sqlite_store import read_memory, write_memory

__all__ = ["app"]

_SHOW_EXAMPLES = """
Examples:

  skinnet memory show runs/teach/memory.sqlite
"""
_EXPORT_EXAMPLES = """
Examples:

  skinnet memory export runs/teach/memory.sqlite

  skinnet memory export runs/teach/memory.sqlite --out taught.json
"""
_IMPORT_EXAMPLES = """
Examples:

  skinnet memory import taught.json taught.sqlite

  skinnet memory import taught.json taught.sqlite --deployment deployments/hrp2_touch.toml --force
"""

app = typer.Typer(
    no_args_is_help=True,
    help="What a robot remembers.",
    epilog=_SHOW_EXAMPLES + _EXPORT_EXAMPLES.replace("Examples:\n", ""),
)

MemoryFileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Memory file, SQLite.")]


@app.callback()
def _group() -> None:
    """Show, export and import the long-term memory of a robot."""


@app.command(name="show", epilog=_SHOW_EXAMPLES)
def _show(memory_file: MemoryFileArgument) -> None:
    """Print the robot, structure, key poses, touch areas and parameters of a memory file."""
    memory = read_memory(memory_file)
    terminal = console()
    for table in (_robot_table(memory), _pose_table(memory), _area_table(memory), _parameter_table(memory)):
        if table.row_count:
            terminal.print(table)


@app.command(name="export", epilog=_EXPORT_EXAMPLES)
def _export(
    memory_file: MemoryFileArgument,
    out: Annotated[str, typer.Option(metavar="JSON|-", help="File to write; - for standard output.")] = "-",
) -> None:
    """Export a memory file as JSON, exact to the last bit."""
    content = to_json(read_memory(memory_file))
    if out == "-":
        sys.stdout.write(content.decode())
    else:
        write_bytes(Path(out), content)


@app.command(name="import", epilog=_IMPORT_EXAMPLES)
def _import(
    source: Annotated[Path, typer.Argument(metavar="JSON", help="What `export` wrote.")],
    memory_file: Annotated[Path, typer.Argument(metavar="FILE", help="Memory file to write.")],
    deployment: Annotated[
        Path | None,
        typer.Option(
            metavar="TOML", help="Refuses what does not fit its robot and the limits of its joints."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replaces FILE if it exists.")] = False,
) -> None:
    """Import a memory file from JSON; nothing is written unless all of it is valid."""
    memory = read_memory_json(source)
    if deployment is not None:
        try:
            _require_fit(memory, deployment)
        except MemoryFileError as error:
            raise MemoryFileError(f"{source}: {error}") from None
    if memory_file.exists() and not force:
        raise MemoryFileError(f"{memory_file}: exists already; give --force to replace it")
    write_memory(memory_file, memory)


def _require_fit(memory: MemoryContents, file: Path) -> None:
    deployment = load(file)
    try:
        check(deployment)
        body = load_model(deployment, file.parent, with_environment=False)
    except DeploymentError as error:
        raise DeploymentError(f"{file}: {error}") from None
    check_compatible(memory, deployment, body.range_rad)


def _robot_table(memory: MemoryContents) -> Table:
    """Build the table of the robot and its explored structure."""
    robot = memory.robot
    table = Table(title=f"memory of {robot.name}", show_header=False)
    table.add_column(style="bold")
    table.add_column()
    table.add_row(f"{len(robot.joints)} joints", escape(", ".join(robot.joints)))
    sizes = ", ".join(f"{patch} {cells}" for patch, cells in robot.patches.items())
    table.add_row(f"{robot.n_cells} cells", sizes)
    if memory.activity is None:
        table.add_row("structure", "not explored")
    else:
        moved = np.count_nonzero(memory.activity.any(axis=1))
        entries = np.count_nonzero(memory.activity)
        table.add_row("structure", f"{moved} cells move, {entries} of {memory.activity.size} entries active")
        if len(memory.unmeasured):
            table.add_row("not measured", _counts_by_patch(memory, memory.unmeasured))
    return table


def _pose_table(memory: MemoryContents) -> Table:
    """Build the table of key poses: joint positions [rad]."""
    table = Table(title="key poses [rad]")
    table.add_column("joint", style="bold")
    for name in memory.poses:
        table.add_column(name, justify="right")
    if memory.poses:
        poses = memory.poses.values()
        for joint, *positions in zip(memory.robot.joints, *(p.position_rad for p in poses), strict=True):
            table.add_row(escape(joint), *(f"{position:.3f}" for position in positions))
        table.add_section()
        table.add_row("map", *("no" if pose.weights is None else "yes" for pose in poses))
    return table


def _area_table(memory: MemoryContents) -> Table:
    table = Table("area", "cells", "of each patch", title="touch areas")
    for label, cells in memory.areas.items():
        table.add_row(label, str(len(cells)), _counts_by_patch(memory, cells))
    return table


def _parameter_table(memory: MemoryContents) -> Table:
    table = Table("parameter", "value", title="parameters")
    for name, value in memory.parameters.items():
        table.add_row(name, f"{value:g}")
    return table


def _counts_by_patch(memory: MemoryContents, cells: np.typing.NDArray[np.int64]) -> str:
    places = memory.robot.cells()
    counts = Counter(places[cell][0] for cell in cells)
    return ", ".join(f"{patch} {count}" for patch, count in counts.items())
