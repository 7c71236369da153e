"""Command `skinnet view`: web page of a live run or of a recording."""

import os
from typing import Annotated

import typer

from skinnet.cli.console import BaseOption, console, examples, line_printer, require_extra

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet run deployments/hrp2_touch.toml --pace realtime --view",
    "skinnet view tcp/127.0.0.1:7447 --control",
    "skinnet view runs/touch/run.mcap --port 8080",
    "skinnet view tcp/127.0.0.1:7447 --host 0.0.0.0 --token a-word-that-nobody-guesses",
)
_NICE_INCREMENT = 10
"""Scheduling priority increment of the page, below the processes of the run."""


def register(app: typer.Typer) -> None:
    """Register the command `view`."""
    app.command(epilog=_EXAMPLES)(view)


def view(
    source: Annotated[
        str,
        typer.Argument(metavar="ENDPOINT|FILE", help="Observer endpoint, which a run prints, or run.mcap."),
    ],
    host: Annotated[
        str, typer.Option(help="Address to serve the page at; one beyond loopback needs a token.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to serve the page at; 0 for a free one.")
    ] = 0,
    token: Annotated[
        str | None,
        typer.Option(help="Token that visitors must know; made and printed if needed and not given."),
    ] = None,
    control: Annotated[
        bool, typer.Option("--control", help="Adds buttons for the requests of the controller.")
    ] = False,
    keep: Annotated[bool, typer.Option("--keep", help="Keeps the page after the end of the run.")] = False,
    base: BaseOption = None,
) -> None:
    """Serve a web page of a run or recording.

    The page shows body, skin, network and controller.
    """
    if hasattr(os, "nice"):
        os.nice(_NICE_INCREMENT)
    require_extra("view", "mcap", "zstandard")
    from skinnet.view.page.page_service import ViewOptions, serve_page

    serve_page(ViewOptions(source, host, port, token, control, keep, base), line_printer(console()))
