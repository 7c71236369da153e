"""Program `skinnet`: commands, error messages and exit codes."""

import contextlib
import io
import signal
import sys
from typing import Annotated

import typer

from skinnet import __version__
from skinnet.cli import (
    bench,
    bridge,
    check,
    cover,
    init,
    memory,
    migrate,
    network,
    plan,
    preview,
    replay,
    report,
    request,
    run,
    schema,
    stress,
    view,
)
from skinnet.cli.console import BAD_INPUT, examples
from skinnet.errors import (
    DeploymentError,
    FormatError,
    MemoryFileError,
    ModelError,
    PortInUseError,
    RecordingError,
    RunFolderError,
    SkinnetError,
    UnreachableError,
    UsageError,
)
from skinnet.toml_values import plain_line

__all__ = ["app", "main"]

FAILED, INTERRUPTED = 1, 130
_BAD_INPUT_ERRORS = (
    DeploymentError,
    FormatError,
    MemoryFileError,
    ModelError,
    PortInUseError,
    RecordingError,
    RunFolderError,
    UnreachableError,
    UsageError,
)
_COMMANDS = (
    run,
    init,
    check,
    cover,
    preview,
    plan,
    stress,
    report,
    memory,
    request,
    view,
    replay,
    schema,
    migrate,
    schema,
    network,
    bench,
    bridge,
)
"""Modules of the commands, in the order of the help."""

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Simulator of whole-body robot skin: contact, cell-to-cell network, Zenoh, controller, MuJoCo body.",
    epilog=examples(
        "skinnet check deployments/hrp2_touch.toml",
        "skinnet run deployments/hrp2_touch.toml",
        "skinnet report runs/hrp2_touch-20260101-120000",
        "skinnet run --help",
    ),
)
for _command in _COMMANDS:
    _command.register(app)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"skinnet {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Parse the options of the program as a whole."""


def main() -> None:
    """Run the program: one line on standard error for any user error, and an exit code by its kind."""
    code: object = 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # SIGTERM as Ctrl-C
    for stream in (sys.stdout, sys.stderr):  # a locale without umlauts or box lines is no reason to fail
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        app(prog_name="skinnet")
    except _BAD_INPUT_ERRORS as error:
        sys.stderr.write(f"skinnet: {plain_line(str(error))}\n")  # names of a model may have line breaks
        code = BAD_INPUT
    except SkinnetError as error:
        sys.stderr.write(f"skinnet: {error}\n")
        code = FAILED
    except OSError as error:
        sys.stderr.write(f"skinnet: {error.filename or 'output'}: {error.strerror}\n")
        code = FAILED
    except KeyboardInterrupt:
        sys.stderr.write("skinnet: stopped\n")
        code = INTERRUPTED
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.flush()
    sys.exit(code)  # type: ignore[arg-type]
