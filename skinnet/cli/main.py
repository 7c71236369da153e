"""Program `skinnet`: commands, error messages and exit codes."""

import contextlib
import signal
import sys
from typing import Annotated

import typer

from skinnet import __version__
from skinnet.cli import bench, bridge, memory, network, report, run
from skinnet.cli.migrate import EXAMPLES as MIGRATE_EXAMPLES
from skinnet.cli.migrate import migrate
from skinnet.cli.plan import EXAMPLES, plan
from skinnet.cli.replay import EXAMPLES as REPLAY_EXAMPLES
from skinnet.cli.replay import replay
from skinnet.cli.request import EXAMPLES as REQUEST_EXAMPLES
from skinnet.cli.request import request
from skinnet.cli.stress import stress
from skinnet.cli.view import EXAMPLES as VIEW_EXAMPLES
from skinnet.cli.view import view
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
)

__all__ = ["app", "main"]

BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130
_BAD_INPUT_ERRORS = (
    DeploymentError,
    FormatError,
    MemoryFileError,
    ModelError,
    PortInUseError,
    RecordingError,
    RunFolderError,
    UnreachableError,
)

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Simulates whole-body robot skin: contact, cell-to-cell network, Zenoh, controller, MuJoCo body.",
    epilog=run.EXAMPLES,
)
app.command(epilog=run.EXAMPLES)(run.run)
app.command()(run.check)
app.command(epilog=EXAMPLES)(plan)
app.command()(stress)
app.command(epilog=report.EXAMPLES)(report.report)
app.add_typer(memory.app, name="memory")
app.command(epilog=REQUEST_EXAMPLES)(request)
app.command(epilog=VIEW_EXAMPLES)(view)
app.command(epilog=REPLAY_EXAMPLES)(replay)
app.command(epilog=MIGRATE_EXAMPLES)(migrate)
app.add_typer(network.app, name="network")
app.add_typer(bench.app, name="bench")
app.add_typer(bridge.app, name="bridge")


def _version(value: bool) -> None:
    if value:
        typer.echo(f"skinnet {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Prints the version.")
    ] = False,
) -> None:
    """Parse the options of the program as a whole."""


def main() -> None:
    """Run the program: one line on standard error for any user error, and an exit code by its kind."""
    code: object = 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # SIGTERM as Ctrl-C
    try:
        app()
    except _BAD_INPUT_ERRORS as error:
        sys.stderr.write(f"skinnet: {error}\n")
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
