"""Command `skinnet view`: web page of a live run or of a recording."""

import os
from pathlib import Path
from typing import Annotated

import typer

from skinnet.cli.console import console, require_extra

__all__ = ["EXAMPLES", "view"]

EXAMPLES = """
Examples:

  skinnet run deployments/hrp2_touch.toml --pace realtime --view

  skinnet view tcp/127.0.0.1:7447 --control

  skinnet view runs/touch/run.mcap --port 8080

  skinnet view tcp/127.0.0.1:7447 --host 0.0.0.0 --token a-word-that-nobody-guesses
"""
_NICE_INCREMENT = 10
"""Scheduling priority increment of the page, below the processes of the run."""


def view(
    source: Annotated[
        str, typer.Argument(metavar="ENDPOINT|FILE", help="Watch endpoint that a run prints, or run.mcap.")
    ],
    host: Annotated[
        str, typer.Option(help="Address of the page; others than loopback need a token.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 for any that is free.")
    ] = 0,
    token: Annotated[
        str | None, typer.Option(help="What visitors must know; made up and printed if there must be one.")
    ] = None,
    control: Annotated[
        bool, typer.Option("--control", help="Offer the controller's requests as buttons.")
    ] = False,
    keep: Annotated[bool, typer.Option("--keep", help="Stay when the run is over.")] = False,
    base: Annotated[
        Path | None, typer.Option(help="Folder with the model; the one that the run names unless given.")
    ] = None,
) -> None:
    """Serve a web page of body, skin, network and controller, of a live run or of a recording."""
    if hasattr(os, "nice"):
        os.nice(_NICE_INCREMENT)
    require_extra("view", "viser", "mcap", "zstandard")
    from skinnet.view.page.page_service import ViewOptions, serve_page

    terminal = console()

    def say(line: str) -> None:
        terminal.print(line, highlight=False, markup=False, soft_wrap=True)

    serve_page(ViewOptions(source, host, port, token, control, keep, base), say)
