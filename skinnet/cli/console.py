"""Console output, common options and result files of the commands."""

import importlib.util
import sys
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console

from skinnet.errors import DeploymentError
from skinnet.files import write_json

__all__ = [
    "DeploymentArgument",
    "JsonOption",
    "OutOption",
    "SettingsOption",
    "console",
    "require_extra",
    "seed_range",
    "write_report",
]

_PLAIN_WIDTH = 120

DeploymentArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Deployment, a TOML file.")]
SettingsOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Overrides a setting; may be repeated. Values are TOML."),
]
JsonOption = Annotated[
    str | None, typer.Option("--json", metavar="FILE|-", help="Writes the result as JSON.")
]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder for results; runs/NAME-TIME unless given.")
]


def console(stderr: bool = False) -> Console:
    """Return the console; output that is no terminal has 120 columns."""
    terminal = Console(stderr=stderr)
    return terminal if terminal.is_terminal else Console(stderr=stderr, width=_PLAIN_WIDTH)


def require_extra(extra: str, *modules: str) -> None:
    """Require the modules of a package extra.

    Raises:
        DeploymentError: names the module that is missing, and the extra.
    """
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise DeploymentError(f"no module {module}: install the extra, pip install 'skinnet[{extra}]'")


def write_report(report: dict[str, Any], target: str | None) -> None:
    """Write `report` as JSON to a file, to standard output for "-", not at all for None."""
    if target == "-":
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n")
    elif target is not None:
        write_json(Path(target), report)


def seed_range(text: str) -> range:
    """Parse a range of seeds "A-B".

    Raises:
        DeploymentError: the text has another form, or A is above B.
    """
    first, dash, last = text.partition("-")
    if not (dash and first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
        raise DeploymentError(f"--seeds {text}: write it as A-B with A not above B, for example 1-20")
    return range(int(first), int(last) + 1)
