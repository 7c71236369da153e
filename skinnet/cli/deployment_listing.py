"""Deployment listing that `skinnet check` prints: processes, cells, channels, periods."""

from rich.console import Console
from rich.table import Table

from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.protocol.channels import CHANNELS, Keys, Role
from skinnet.run.process_list import process_list

__all__ = ["print_deployment"]


def print_deployment(console: Console, deployment: Deployment) -> None:
    """Print the processes, cells, channels, periods and program of a deployment."""
    console.print(f"{deployment.name}: robot {deployment.robot}, seed {deployment.seed}", highlight=False)
    for table in (_processes(deployment), _patches(deployment), _channels(deployment), _periods(deployment)):
        console.print(table)
    console.print(f"program: {' → '.join(deployment.controller.program)}", highlight=False)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    for i, column in enumerate(columns):
        table.add_column(column, no_wrap=i < 2)
    return table


def _processes(deployment: Deployment) -> Table:
    table = _table("processes", "name", "role", "runs", "may be lost")
    hosts = deployment.patches_by_process() | {
        BOARD_PROCESS: tuple(sheet.name for sheet in deployment.sheets)
    }
    for spec in process_list(deployment):
        table.add_row(
            spec.name,
            spec.role.value,
            ", ".join(hosts.get(spec.name, ())),
            "yes" if spec.loss_tolerated else "",
        )
    return table


def _patches(deployment: Deployment) -> Table:
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


def _channels(deployment: Deployment) -> Table:
    prefix = Keys(deployment.robot).prefix
    table = _table(f"channels, keys below {prefix}", "key", "message", "from", "to", "period", "watchers")
    for row in CHANNELS:
        to = ", ".join(role.value for role in row.receivers)
        table.add_row(
            row.pattern,
            row.message.__name__,
            row.sender_name,
            to,
            row.period,
            "yes" if row.public else "",
        )
    table.add_row(
        "alive/<role>/<name>",
        "liveliness",
        ", ".join(r.value for r in Role if r is not Role.LAUNCHER),
        "all",
        "on change",
    )
    return table


def _periods(deployment: Deployment) -> Table:
    table = _table("periods", "what", "ms")
    body, control = deployment.body, deployment.controller
    for what, value_ms in (
        ("physics", body.timestep_ms),
        ("stimulus frame, cells", body.stimulus_period_ms),
        ("joint feedback, control", control.period_ms),
        ("command delay", control.command_delay_ns / 1e6),
    ):
        table.add_row(what, f"{value_ms:g}")
    return table
