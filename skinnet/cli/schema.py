"""Command `skinnet schema`: JSON Schema of deployment files."""

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from skinnet.cli.console import console
from skinnet.errors import DeploymentError
from skinnet.files import write_bytes

__all__ = ["register", "schema"]

_EXAMPLES = """
Examples:

  skinnet schema --out skinnet.schema.json
"""


def register(app: typer.Typer) -> None:
    """Register the command `schema`."""
    app.command(epilog=_EXAMPLES)(schema)


def schema(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="File; standard output unless given.")
    ] = None,
) -> None:
    """Write the JSON Schema of deployment files, with which editors complete and check them."""
    from skinnet.deployment.json_schema import deployment_schema

    text = msgspec.json.format(msgspec.json.encode(deployment_schema()), indent=1) + b"\n"
    if out is None:
        typer.echo(text.decode(), nl=False)
        return
    if out.is_dir():
        raise DeploymentError(f"--out {out}: that is a folder; give a file in it")
    write_bytes(out, text)
    console().print(f"the schema is {out}", highlight=False, markup=False, soft_wrap=True)
