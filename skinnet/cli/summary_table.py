"""Summary table printed at the end of a run."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

__all__ = ["print_summary"]


def print_summary(console: Console, summary: dict[str, Any], folder: Path) -> None:
    """Print the summary of a run.

    The wall time includes the start of the processes and the compilation; the real-time factor is that of
    the loop alone.
    """
    table = Table(
        title=f"{summary['deployment']}, seed {summary['seed']}: {summary['outcome']}", show_header=False
    )
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_row("simulated time", f"{summary['sim_s']:.1f} s")
    table.add_row("wall time", f"{summary['wall_s']:.1f} s")
    table.add_row("real-time factor (loop)", f"{summary['rtf']:.2f}")
    if summary["pace"] == "realtime":
        table.add_row("deadline misses", str(summary["deadline_misses"]))
    table.add_section()
    for name, value in summary["metrics"].items():
        table.add_row(name, _format_value(value))
    table.add_section()
    for process in summary["processes"]:
        usage = f"{process['cpu_s']:.1f} s CPU, {process['peak_mb']:.0f} MB"
        table.add_row(f"{process['name']} ({process['pid']})", usage)
    for failure in summary["process_failures"]:
        table.add_row(failure["process"], failure["cause"])
    console.print(table)
    console.print(f"log SHA-256 {summary['log_sha256']}", highlight=False)
    console.print(f"results in {folder}", highlight=False, soft_wrap=True)


def _format_value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)
