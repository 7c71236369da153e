"""Summary table printed at the end of a run."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

__all__ = ["print_summary"]


def print_summary(console: Console, summary: dict[str, Any], folder: Path) -> None:
    """Print the summary of a run."""
    table = Table(
        title=f"{summary['deployment']}, seed {summary['seed']}: {summary['outcome']}", show_header=False
    )
    table.add_column(style="bold")
    table.add_column(justify="right")
    table.add_row("simulated", f"{summary['sim_s']:.1f} s")
    table.add_row("wall", f"{summary['wall_s']:.1f} s, {summary['rtf']:.2f} × real time")
    if summary["pace"] == "realtime":
        table.add_row("late frames", str(summary["deadline_misses"]))
    table.add_section()
    for name, value in summary["metrics"].items():
        table.add_row(name, _format_value(value))
    table.add_section()
    for process in summary["processes"]:
        what = f"{process['cpu_s']:.1f} s CPU, {process['peak_mb']:.0f} MB"
        table.add_row(f"{process['name']} ({process['pid']})", what)
    for fault in summary["process_failures"]:
        table.add_row(fault["process"], fault["cause"])
    console.print(table)
    console.print(f"log {summary['log_sha256']}", highlight=False)
    console.print(f"everything is in {folder}", highlight=False)


def _format_value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)
