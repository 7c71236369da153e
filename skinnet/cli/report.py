"""Command `skinnet report`: HTML report of a run folder."""

from pathlib import Path
from typing import Annotated

import typer

from skinnet.cli.console import console, examples, line_printer
from skinnet.errors import UsageError

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet report runs/hrp2_touch",
    "skinnet report runs/stress-h1_1260 --out h1_1260.html",
)


def register(app: typer.Typer) -> None:
    """Register the command `report`."""
    app.command(epilog=_EXAMPLES)(report)


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder of skinnet run or skinnet stress.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", help="HTML file to write; Output file; by default RUN/report.html."
        ),
    ] = None,
) -> None:
    """Write a run as one HTML page.

    The page has summary, plots, metrics beside the paper's, deployment and versions.
    """
    from skinnet.analysis.report.html import render_html
    from skinnet.analysis.report.run_folder import read_run_folder
    from skinnet.files import write_bytes
    from skinnet.output_folder import add_output_file

    page = render_html(read_run_folder(run))
    target = out or run / "report.html"
    if target.is_dir():
        raise UsageError(f"--out {target}: is a folder; give a file")
    if out is None:
        add_output_file(run, target.name)
    write_bytes(target, page.encode("utf-8", "replace"))
    line_printer(console())(f"report: {target}")
