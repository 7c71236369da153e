"""Command `skinnet memory`: show, export and import long-term memory files."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skinnet.cli.completion import complete_deployment
from skinnet.cli.console import console, examples
from skinnet.errors import DeploymentError, MemoryFileError

if TYPE_CHECKING:
    from skinnet.memory.contents import MemoryContents

__all__ = ["register"]

_SHOW = ("skinnet memory show runs/teach/memory.sqlite",)
_EXPORT = (
    "skinnet memory export runs/teach/memory.sqlite",
    "skinnet memory export runs/teach/memory.sqlite --out taught.json",
)
_IMPORT = (
    "skinnet memory import taught.json taught.sqlite",
    "skinnet memory import taught.json taught.sqlite --deployment deployments/hrp2_touch.toml --force",
)

_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Show, export and import long-term memory.",
)

MemoryFileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Memory file (SQLite).")]


def register(app: typer.Typer) -> None:
    """Register the command group `memory`."""
    app.add_typer(_app, name="memory", epilog=examples(*_SHOW, *_EXPORT, *_IMPORT))


@_app.callback()
def _group() -> None:
    """Show, export and import the long-term memory of a robot."""


@_app.command(name="show", epilog=examples(*_SHOW))
def _show(memory_file: MemoryFileArgument) -> None:
    """Print a memory file.

    Robot, structure, key poses, touch areas and parameters are listed.
    """
    from skinnet.cli.memory_tables import print_memory
    from skinnet.memory.sqlite_store import read_memory

    print_memory(console(), read_memory(memory_file))


@_app.command(name="export", epilog=examples(*_EXPORT))
def _export(
    memory_file: MemoryFileArgument,
    out: Annotated[
        str, typer.Option(metavar="JSON|-", help="JSON file to write; - for standard output.")
    ] = "-",
) -> None:
    """Export a memory file as exact JSON."""
    from skinnet.files import write_bytes
    from skinnet.memory.json_export import to_json
    from skinnet.memory.sqlite_store import read_memory

    content = to_json(read_memory(memory_file))
    if out == "-":
        sys.stdout.write(content.decode())
    else:
        write_bytes(Path(out), content)


@_app.command(name="import", epilog=examples(*_IMPORT))
def _import(
    source: Annotated[Path, typer.Argument(metavar="JSON", help="JSON file that `export` wrote.")],
    memory_file: Annotated[Path, typer.Argument(metavar="FILE", help="Memory file to write.")],
    deployment: Annotated[
        Path | None,
        typer.Option(
            metavar="TOML",
            help="Deployment that the memory must fit: its robot and the limits of its joints.",
            autocompletion=complete_deployment,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace FILE if it exists.")] = False,
) -> None:
    """Import a memory file from JSON.

    Nothing is written unless all of it is valid.
    """
    from skinnet.deployment.memory_loading import read_memory_json
    from skinnet.memory.sqlite_store import write_memory

    memory = read_memory_json(source)
    if deployment is not None:
        try:
            _require_fit(memory, deployment)
        except MemoryFileError as error:
            raise MemoryFileError(f"{source}: {error}") from None
    if memory_file.exists() and not force:
        raise MemoryFileError(f"{memory_file}: already exists; give --force to replace it")
    write_memory(memory_file, memory)


def _require_fit(memory: "MemoryContents", file: Path) -> None:
    from skinnet.body.model import load_model
    from skinnet.deployment import load
    from skinnet.deployment.checks import check
    from skinnet.deployment.memory_loading import check_compatible

    deployment = load(file)
    try:
        check(deployment)
        body = load_model(deployment, file.parent, with_environment=False)
    except DeploymentError as error:
        raise DeploymentError(f"{file}: {error}") from None
    check_compatible(memory, deployment, body.range_rad)
