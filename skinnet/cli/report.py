"""Command `skinnet report`: HTML report of a run folder."""

from pathlib import Path
from typing import Annotated

import typer

from skinnet.cli.console import console
from skinnet.errors import RunFolderError
from skinnet.files import write_bytes

__all__ = ["EXAMPLES", "report"]

EXAMPLES = """
Examples:

  skinnet report runs/hrp2_touch

  skinnet report runs/stress-h1_1260 --out h1_1260.html
"""


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of skinnet run or skinnet stress.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="RUN/report.html unless given."),
    ] = None,
) -> None:
    """Write a run as one HTML page: summary, plots, metrics beside the paper's, deployment, versions."""
    from skinnet.analysis.report.html import render_html
    from skinnet.analysis.report.run_folder import read_run_folder

    page = render_html(read_run_folder(run))
    target = out or run / "report.html"
    if target.is_dir():
        raise RunFolderError(f"--out {target}: that is a folder; give a file in it")
    write_bytes(target, page.encode("utf-8", "replace"))
    console().print(f"the report is {target}", highlight=False, markup=False, soft_wrap=True)
