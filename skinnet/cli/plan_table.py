"""Terminal table of a plan: diagnostics first, then every patch."""

from typing import Any

from rich.console import Console
from rich.table import Table

__all__ = ["print_plan"]


def print_plan(console: Console, report: dict[str, Any]) -> None:
    """Print a plan's `report`."""
    for problem in report["problems"]:
        console.print(f"! {problem}", style="bold red", highlight=False)
    if not report["problems"]:
        console.print("keeps all limits", style="bold green", highlight=False)
    console.print(_load_lines(report), highlight=False)
    console.print(_patch_table(report))
    for places, names in _changed_places(report).items():
        console.print(f"{', '.join(names)}: gateways at {places}", highlight=False)


def _changed_places(report: dict[str, Any]) -> dict[str, list[str]]:
    """Gateway places of patches whose gateway count should change; patches with equal places together."""
    found: dict[str, list[str]] = {}
    for entry in report["fewest"]:
        if entry["possible"] and entry["gateways"] != entry["now"]:
            patches = entry["patches"]
            at = [
                place.removeprefix(f"{patches[0]}/") if len(patches) == 1 else place for place in entry["at"]
            ]
            found.setdefault(", ".join(at), []).append(" + ".join(patches))
    return found


def _load_lines(report: dict[str, Any]) -> str:
    load, limits, metrics = report["load"], report["limits"], report["metrics"]
    parts = [f"load: {load['encoding']} ({load['why']})"]
    if "stimulated" in load:
        streams = " and periodic readings" if load["streams_when_touched"] else ""
        parts.append(
            f"{load['stimulated']:.0%} of the cells touched: {load['events_hz']:g} events/s each{streams}, "
            f"others {load['idle_events_hz']:g}/s"
        )
    parts.append(f"{metrics['plan.packets_per_s']:.0f} packets/s in all")
    asked = [f"utilisation ≤ {limits['utilisation']:g}"]
    if limits["latency_ms"] is not None:
        asked.append(f"worst-case latency ≤ {limits['latency_ms']:g} ms")
    if limits["voltage_v"]:
        asked.append(f"voltage ≥ {limits['voltage_v']:g} V")
    return "; ".join(parts) + f"\nlimits: {', '.join(asked)}"


def _patch_table(report: dict[str, Any]) -> Table:
    powered = "plan.min_voltage_v" in report["metrics"]
    table = Table(title=f"{report['deployment']}: link budget", title_justify="left")
    table.add_column("patch", no_wrap=True)
    for column in (
        "cells",
        "gate-\nways",
        "few-\nest",
        "depth",
        "load",
        "worst\nms",
        "mean\nms",
        "back-\nlog",
    ):
        table.add_column(column, justify="right", no_wrap=True)
    if powered:
        table.add_column("lowest\nV, cell", justify="right", no_wrap=True)
    table.add_column("busiest link", no_wrap=True)
    fewest = _fewest_by_patch(report)
    for patch in report["patches"]:
        voltage = (
            [f"{patch['lowest_v']:.2f}  {patch['lowest_cell'].rpartition('/')[2]:>3}"] if powered else []
        )
        table.add_row(
            patch["name"],
            str(patch["cells"]),
            str(patch["gateways"]),
            fewest[patch["name"]],
            str(patch["depth"]),
            f"{patch['utilisation']:.1%}",
            _format_ms(patch["latency_ms"]["worst"]),
            _format_ms(patch["latency_ms"]["expected"]),
            "∞" if patch["backlog_packets"] is None else f"{patch['backlog_packets']:.0f}",
            *voltage,
            patch["busiest_link"].replace(f"{patch['name']}/", ""),
            style="red" if patch["utilisation"] > 1.0 else None,
        )
    table.add_section()
    metrics = report["metrics"]
    total = metrics["plan.fewest_gateways"]
    table.add_row(
        "all",
        str(metrics["plan.cells"]),
        str(metrics["plan.gateways"]),
        "–" if total is None else str(total),
        str(metrics["plan.depth"]),
        f"{metrics['plan.utilisation']:.1%}",
        _format_ms(metrics["plan.latency_ms.worst"]),
        _format_ms(metrics["plan.latency_ms.expected"]),
        "∞" if metrics["plan.backlog_packets"] is None else f"{metrics['plan.backlog_packets']:.0f}",
        *([f"{metrics['plan.min_voltage_v']:.2f}     "] if powered else []),
        f"{metrics['plan.power_w']:.1f} W" if powered else "",
    )
    return table


def _fewest_by_patch(report: dict[str, Any]) -> dict[str, str]:
    """Fewest gateways of each patch as text; bridged patches refer to the first of their group."""
    shown = {}
    for entry in report["fewest"]:
        first, *others = entry["patches"]
        shown[first] = str(entry["gateways"]) if entry["possible"] else "none"
        shown |= dict.fromkeys(others, f"↑ {first}")
    return shown


def _format_ms(value_ms: float | None) -> str:
    return "∞" if value_ms is None else f"{value_ms:.2f}"
