"""Console output, common options, examples and result files of the commands.

Modules of commands import little, since the help of one command loads all of them; what a command needs is
imported when it runs.
"""

import importlib.util
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skinnet.cli.completion import complete_deployment, complete_setting
from skinnet.errors import SkinnetError, UsageError
from skinnet.toml_values import plain_line

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "BAD_INPUT",
    "BaseOption",
    "DeploymentArgument",
    "JsonOption",
    "OutOption",
    "PlotsOption",
    "SettingsOption",
    "console",
    "examples",
    "line_printer",
    "require_extra",
    "seed_range",
    "write_report",
]

BAD_INPUT = 2
"""Exit code of input that a command cannot use, or finds in error."""
_PLAIN_WIDTH = 120

DeploymentArgument = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="Deployment file (TOML).", autocompletion=complete_deployment),
]
SettingsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Overrides one key of the deployment; VALUE is TOML. May be repeated.",
        autocompletion=complete_setting,
    ),
]
JsonOption = Annotated[
    str | None, typer.Option("--json", metavar="FILE|-", help="Writes the result as JSON; - to the output.")
]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder of the results; runs/NAME-TIME unless given.")
]
BaseOption = Annotated[
    Path | None,
    typer.Option(help="Base folder of the model's path; that of the run unless given."),
]
PlotsOption = Annotated[bool, typer.Option("--plots/--no-plots", help="Draws plots and pictures.")]


def console(stderr: bool = False) -> "Console":
    """Return the console, which prints texts as they are; output that is no terminal has 120 columns.

    Names of a model, paths and errors may look like markup or emoji.
    """
    from rich.console import Console

    plain = partial(Console, stderr=stderr, markup=False, emoji=False)
    terminal = plain()
    return terminal if terminal.is_terminal else plain(width=_PLAIN_WIDTH)


def line_printer(terminal: "Console") -> Callable[[str], None]:
    """Return a function that prints a text as one line; names of a model may have line breaks."""
    return lambda line: terminal.print(plain_line(line), highlight=False, soft_wrap=True)


def examples(*lines: str) -> str:
    """Format examples of a command as the epilog of its help; they are not wrapped."""
    return "\b\n" + "\n".join(["Examples:", *(f"  {line}" for line in lines)])


def require_extra(extra: str, *modules: str) -> None:
    """Require the modules of a package extra.

    Raises:
        SkinnetError: names the module that is missing, and the extra.
    """
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise SkinnetError(
                f"module {module} is not installed; install the extra: pip install 'skinnet[{extra}]'"
            )


def write_report(report: dict[str, Any], target: str | None) -> None:
    """Write `report` as JSON to a file, to standard output for "-", not at all for None."""
    import msgspec

    from skinnet.files import write_json

    if target == "-":
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n")
    elif target is not None:
        write_json(Path(target), report)


def seed_range(text: str) -> range:
    """Parse a range of seeds "A-B".

    Raises:
        UsageError: the text has another form, or A is above B.
    """
    first, dash, last = text.partition("-")
    if not (dash and first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
        raise UsageError(f"--seeds {text}: must be A-B with A ≤ B, for example 1-20")
    return range(int(first), int(last) + 1)
