"""Command `skinnet schema`: JSON Schema of deployment files."""

from pathlib import Path
from typing import Annotated

import typer

from skinnet.cli.console import console, examples, line_printer
from skinnet.errors import UsageError

__all__ = ["register"]

_EXAMPLES = examples("skinnet schema", "skinnet schema --out skinnet.schema.json")


def register(app: typer.Typer) -> None:
    """Register the command `schema`."""
    app.command(epilog=_EXAMPLES)(schema)


def schema(
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="JSON file to write; standard output unless given."),
    ] = None,
) -> None:
    """Write the JSON Schema of deployments.

    Editors complete and check deployments by it.
    """
    import msgspec

    from skinnet.deployment.json_schema import deployment_schema
    from skinnet.files import write_bytes

    text = msgspec.json.format(msgspec.json.encode(deployment_schema()), indent=1) + b"\n"
    if out is None:
        typer.echo(text.decode(), nl=False)
        return
    if out.is_dir():
        raise UsageError(f"--out {out}: that is a folder; give a file in it")
    write_bytes(out, text)
    line_printer(console())(f"the schema is {out}")
