"""Deployment listing that `skinnet check` prints: identity, processes, cells, program, periods; channels."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from skinnet.analysis.report.toml_listing import sections
from skinnet.cli.console import line_printer
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.diagnosis.finding import SEVERITIES, Finding
from skinnet.migration.deployments import FORMAT, FORMAT_KEY
from skinnet.protocol.channels import CHANNELS, Keys, Role
from skinnet.run.process_list import process_list

__all__ = ["print_channels", "print_deployment", "print_findings", "print_settling", "resolved_toml"]


def print_deployment(console: Console, deployment: Deployment, files: Sequence[Path]) -> None:
    """Print name, robot, seed, files, processes, cells, program and periods of a deployment.

    Args:
        console: Console to print to.
        deployment: Deployment to list.
        files: Its file, then that which this one extends, and so on.
    """
    say = line_printer(console)
    say(f"{deployment.name}: robot {deployment.robot}, seed {deployment.seed}")
    if len(files) > 1:
        say(" extends ".join(map(str, files)))
    console.print(_processes(deployment))
    console.print(_cells(deployment))
    say(f"program: {' → '.join(deployment.controller.program) or 'nursing'}")
    console.print(_periods(deployment))


def print_channels(console: Console, robot: str) -> None:
    """Print the channels of a run: key, message, sender, receivers, period, open to observers."""
    prefix = Keys(robot).prefix
    table = _table(f"channels, keys below {prefix}", "key", "message", "from", "to", "period", "observers")
    for row in CHANNELS:
        to = ", ".join(role.value for role in row.receivers)
        public = "yes" if row.public else ""
        table.add_row(row.pattern, row.message.__name__, row.sender_name, to, row.period, public)
    senders = ", ".join(role.value for role in Role if role is not Role.LAUNCHER)
    table.add_row("alive/<role>/<name>", "liveliness token", senders, "all", "on change")
    console.print(table)


def print_settling(console: Console, duration_s: float, metrics: dict[str, Any]) -> None:
    """Print the numbers of a body that settled for `duration_s` [s]; what is left out is listed before."""
    table = _table(f"settled for {duration_s:g} s at home", "metric", "value")
    for name, value in metrics.items():
        if not isinstance(value, list):
            table.add_row(name, f"{value:.4g}" if isinstance(value, float) else str(value))
    console.print(table)


def print_findings(console: Console, findings: Sequence[Finding]) -> None:
    """Print findings: severity, subject and observation in one line, its mend in the next."""
    say = line_printer(console)
    for finding in findings:
        say(f"{finding.severity}: {finding.subject}: {finding.text}")
        say(f"    → {finding.mend}")
    counts = Counter(finding.severity for finding in findings)
    said = [f"{counts[severity]} {severity}{'' if counts[severity] == 1 else 's'}" for severity in SEVERITIES]
    say(", ".join(said))


def resolved_toml(deployment: Deployment, file: Path) -> str:
    """Write a deployment with every default as TOML that `skinnet run` accepts; `file` is its origin."""
    head = (
        f"# {file}, resolved; relative paths start at {file.resolve().parent}",
        f"{FORMAT_KEY} = {FORMAT}",
    )
    parts = ["\n".join(head)]
    parts += ["\n".join(line.text for line in section.lines) for section in sections(deployment)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    for i, column in enumerate(columns):
        table.add_column(column, no_wrap=i < 2)
    return table


def _processes(deployment: Deployment) -> Table:
    table = _table("processes", "name", "role", "patches, sheets", "loss tolerated")
    hosted = deployment.patches_by_process() | {
        BOARD_PROCESS: tuple(sheet.name for sheet in deployment.sheets)
    }
    for spec in process_list(deployment):
        tolerated = "yes" if spec.loss_tolerated else ""
        table.add_row(spec.name, spec.role.value, ", ".join(hosted.get(spec.name, ())), tolerated)
    return table


def _cells(deployment: Deployment) -> Table:
    table = _table("cells", "patch", "body", "cells", "gateways")
    surfaces = {surface.name: surface.body for surface in deployment.surfaces}
    for sheet in deployment.sheets:
        table.add_row(sheet.name, surfaces[sheet.surface], f"{sheet.n_elements} elements", "board")
    for patch in deployment.patches:
        table.add_row(patch.name, patch.body, str(patch.n_cells), str(len(patch.interfaces)))
    table.add_section()
    total = sum(patch.n_cells for patch in deployment.patches)
    table.add_row("all", "", str(total), str(sum(len(p.interfaces) for p in deployment.patches)))
    return table


def _periods(deployment: Deployment) -> Table:
    table = _table("periods", "period", "ms")
    body, control = deployment.body, deployment.controller
    for name, value_ms in (
        ("timestep of the physics", body.timestep_ms),
        ("stimulus frame, cells", body.stimulus_period_ms),
        ("joint state, controller", control.period_ms),
        ("command delay", control.command_delay_ns / 1e6),
    ):
        table.add_row(name, f"{value_ms:g}")
    return table
