"""The command line."""

import contextlib
import signal
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console

from skinnet import __version__
from skinnet.errors import DeploymentError, ModelError, PortInUseError, SkinnetError
from skinnet.files import write_json
from skinnet.run.explain import explain
from skinnet.run.launch import Order, prepare, run_once
from skinnet.run.progress import Progress
from skinnet.run.table import print_summary

__all__ = ["app", "main"]

_PLAIN_WIDTH = 120
BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130
_EXAMPLES = """
Examples:

  skinnet run deployments/hrp2_touch.toml

  skinnet run deployments/hrp2_touch.toml --set controller.reactions.enabled=false --seed 3

  skinnet run deployments/hrp2_touch.toml --seeds 1-20 --set 'controller.program=["structure"]' --json -

  skinnet run deployments/hrp2_touch.toml --set hosts=per_patch --out runs/seven_hosts

  skinnet check my_robot.toml
"""

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Simulates whole-body robot skin: contact, cell-to-cell network, Zenoh, controller, MuJoCo body.",
    epilog=_EXAMPLES,
)
_File = Annotated[Path, typer.Argument(metavar="FILE", help="Deployment, a TOML file.")]
_Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Overrides a setting; may be repeated. Values are TOML."),
]


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
    """Options of the program as a whole."""


@app.command(epilog=_EXAMPLES)
def run(
    file: _File,
    settings: _Set = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed, instead of the deployment's.")] = None,
    seeds: Annotated[str | None, typer.Option(metavar="A-B", help="Runs every seed from A to B.")] = None,
    in_process: Annotated[
        bool, typer.Option("--in-process", help="Everything in one process, without Zenoh.")
    ] = False,
    pace: Annotated[
        str | None, typer.Option(metavar="lockstep|realtime", help="Instead of the deployment's.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Run folder; runs/NAME-TIME unless given.")] = None,
    json: Annotated[str | None, typer.Option(metavar="FILE|-", help="Writes the summary there too.")] = None,
    listen: Annotated[
        str | None,
        typer.Option(metavar="ENDPOINT", help="Where watchers join, e.g. tcp/127.0.0.1:7447."),
    ] = None,
    plots: Annotated[bool, typer.Option("--plots/--no-plots", help="Draw plots and a picture.")] = True,
) -> None:
    """Runs a deployment."""
    overrides = (*(settings or ()), *((f"run.pace={pace}",) if pace is not None else ()))
    order = Order(file, overrides, in_process, listen, plots)
    console = _console(stderr=json == "-")
    folder = out or Path("runs") / f"{file.stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    if seeds is None:
        report = _run_seed(order, seed, folder, console)
        print_summary(console, report, folder)
    else:
        if seed is not None:
            raise DeploymentError("--seed and --seeds: give one of them")
        reports = [
            _run_seed(order, number, folder / f"seed-{number}", console) for number in _seed_range(seeds)
        ]
        for number, single in zip(_seed_range(seeds), reports, strict=True):
            print_summary(console, single, folder / f"seed-{number}")
        report = {"runs": reports}
        write_json(folder / "summary.json", report)
    _write(report, json)


def _console(stderr: bool = False) -> Console:
    """The terminal; what is not one gets lines that are wide enough."""
    console = Console(stderr=stderr)
    return console if console.is_terminal else Console(stderr=stderr, width=_PLAIN_WIDTH)


def _run_seed(order: Order, seed: int | None, folder: Path, console: Console) -> dict[str, Any]:
    deployment = prepare(order, seed)
    return run_once(order, deployment, folder, Progress(console))


def _seed_range(text: str) -> range:
    first, dash, last = text.partition("-")
    if not (dash and first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
        raise DeploymentError(f"--seeds {text}: write it as A-B with A not above B, for example 1-20")
    return range(int(first), int(last) + 1)


def _write(report: dict[str, Any], target: str | None) -> None:
    if target == "-":
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n")
    elif target is not None:
        write_json(Path(target), report)


@app.command()
def check(file: _File, settings: _Set = None) -> None:
    """Validates a deployment; prints its processes, channels, cells and periods."""
    order = Order(file, tuple(settings or ()))
    explain(_console(), prepare(order))


def main() -> None:
    """Entry point: one clear line for whatever a user can cause, and an exit code that tells."""
    code: object = 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # told to stop, by whatever key
    try:
        app()
    except (DeploymentError, ModelError, PortInUseError) as error:
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


if __name__ == "__main__":
    main()
