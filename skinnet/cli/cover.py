"""Command `skinnet cover`: cells or tactile sheets laid over the links that a deployment's covers name."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skinnet.cli.console import (
    DeploymentArgument,
    JsonOption,
    SettingsOption,
    console,
    examples,
    line_printer,
    write_report,
)
from skinnet.errors import DeploymentError, UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from skinnet.covering.covered_links import Covering
    from skinnet.deployment import Deployment

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet cover arm.toml",
    "skinnet cover arm.toml --write arm_cells.toml",
    "skinnet cover arm.toml --set cover.arm.margin_m=0.005 --json -",
)
_COLUMNS = {
    "cells": "cells",
    "thick mm": "thickness_mm",
    "covered": "within_0_6_pitch",
    "gap mm": "gap_mm_p95",
    "seen mm": "visual_gap_mm_p95",
    "wired": "wired",
    "pieces": "components",
    "groups": "groups",
    "gateways": "gateways",
}
"""Headers of the table, short enough for a line, and their metrics."""
_FAULTS = ("overlaps", "piercing", "buried", "unreached")


def register(app: typer.Typer) -> None:
    """Register the command `cover`."""
    app.command(epilog=_EXAMPLES)(cover)


def cover(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT",
            help="Writes a deployment that extends FILE, with the cells one by one, for editing.",
        ),
    ] = None,
    json: JsonOption = None,
    cache: Annotated[
        bool, typer.Option("--cache/--no-cache", help="Takes coverings from the cache, if they are there.")
    ] = True,
) -> None:
    """Cover links with cells or tactile sheets as the deployment's covers ask.

    Lists of each link: cells or elements, its thickness, share of the asked surface within 0.6 pitch of a
    cell, gaps to the felt and to the seen surface (95 % are below), share of neighbours that are wired,
    pieces that wires form, groups that bridges make of them, gateways, and faults: cells that overlap, pierce
    others, are buried, or that no gateway reaches. --json has all metrics.
    """
    from skinnet.covering.covered_deployment import cover_deployment, with_covering
    from skinnet.deployment import load

    if write is not None and write.exists() and write.resolve() == file.resolve():
        raise UsageError(f"--write {write}: would overwrite the deployment that it extends; name another")
    deployment = load(file, tuple(settings or ()))
    if not deployment.cover:
        raise DeploymentError(f"{file}: cover: none; give at least one [[cover]] with name and body")
    try:
        covering = cover_deployment(deployment, file.parent, cached=cache)
    except DeploymentError as error:
        raise DeploymentError(f"{file}: {error}") from None
    terminal = console(stderr=json == "-")
    _print(terminal, covering)
    report = {
        "deployment": deployment.name,
        "cover": covering.total,
        "cpu_s": covering.cpu_s,
        "links": covering.links,
        "bare": covering.bare,
    }
    write_report(report, json)
    if write is not None:
        _write(write, file, tuple(settings or ()), with_covering(deployment, covering))
        line_printer(terminal)(f"deployment in {write}")


def _print(terminal: "Console", covering: "Covering") -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title="covering", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("cover", overflow="fold", min_width=8)
    table.add_column("body", overflow="fold", min_width=20)
    for header in (*_COLUMNS, "faults"):
        table.add_column(header, justify="right", no_wrap=True)
    for link in covering.links:
        table.add_row(link["cover"], link["body"], *_figures(link))
    table.add_section()
    table.add_row("all", "", *_figures(covering.total))
    terminal.print(table)
    say = line_printer(terminal)
    for link in covering.links:
        if faults := [f"{link[fault]} {fault}" for fault in _FAULTS if link[fault]]:
            say(f"faults: {link['cover']}: {link['body']}: {', '.join(faults)}")
    for line in covering.bare:
        say(f"bare: {line}")


def _figures(row: dict[str, Any]) -> list[str]:
    figures = [
        f"{row[name]:.3g}" if isinstance(row[name], float) else str(row[name]) for name in _COLUMNS.values()
    ]
    return [*figures, str(sum(row[fault] for fault in _FAULTS))]


def _write(path: Path, file: Path, settings: tuple[str, ...], covered: "Deployment") -> None:
    """Write a deployment that extends `file` by settings, with cells and sheets in place of its covers."""
    from skinnet.analysis.report.toml_listing import toml_tables
    from skinnet.files import write_bytes
    from skinnet.toml_values import toml_value

    base = os.path.relpath(file.resolve(), path.resolve().parent)
    skin = {
        "patches": covered.patches,
        "bridges": covered.bridges,
        "surfaces": covered.surfaces,
        "sheets": covered.sheets,
    }
    lines = [
        f"# Cells of {file.name}, made by `skinnet cover`.",
        f"extends = {toml_value(base)}",
        *(line for key, line in _setting_lines(file, settings) if key not in ("cover", *skin)),
        "cover = []",
        *(line for name, tables in skin.items() for line in toml_tables(name, tables)),
    ]
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def _setting_lines(file: Path, settings: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """First key and line of TOML of each `--set`; one for an entry of a list gives the whole list."""
    from skinnet.deployment.load import apply_override, read_document
    from skinnet.toml_values import toml_key, toml_value

    document = read_document(file)
    for setting in settings:
        apply_override(document, setting)
    values: dict[tuple[str, ...], Any] = {}
    for setting in settings:
        steps = tuple(step.strip() for step in setting.partition("=")[0].split("."))
        node, depth = document, 0
        while isinstance(node, dict) and depth < len(steps):
            node, depth = node[steps[depth]], depth + 1
        values[steps[:depth]] = node
    for steps, value in values.items():
        yield steps[0], f"{'.'.join(map(toml_key, steps))} = {toml_value(value)}"
