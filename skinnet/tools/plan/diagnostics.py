"""Diagnostics of a plan in words: overload, full queues, brown-outs, limits that are breached."""

import numpy as np

from skinnet.tools.plan.plan import Plan

__all__ = ["diagnose"]

_LIMITS = {
    "latency_ms": ("worst-case latency", "ms"),
    "utilisation": ("utilisation", ""),
    "voltage_v": ("lowest voltage", "V"),
}


def diagnose(plan: Plan) -> list[str]:
    """Diagnostics of a plan, one line for each problem; empty if there is none."""
    return [
        *_overload(plan),
        *_full_queues(plan),
        *_brown_out(plan),
        *_limits(plan),
        *_infeasible_limits(plan),
    ]


def _overload(plan: Plan) -> list[str]:
    over = np.flatnonzero(plan.budget.utilisation > 1.0 + 1e-9)
    if not len(over):
        return []
    worst = int(over[plan.budget.utilisation[over].argmax()])
    load = float(plan.budget.utilisation[worst])
    patches = len(np.unique(plan.skin.patch_of_cell[over]))
    return [
        f"packets will be dropped: {len(over)} links of {patches} patches are overloaded; the worst is "
        f"{plan.link_name(worst)} with {load:.2f} times its capacity ({1 - 1 / load:.0%} lost there)"
    ]


def _full_queues(plan: Plan) -> list[str]:
    room = plan.deployment.network.queue_packets
    backlog = np.where(plan.budget.utilisation > 1.0 + 1e-9, 0.0, plan.budget.worst_backlog_packets)
    if room < 0 or backlog.max() <= room:
        return []
    worst = int(backlog.argmax())
    return [
        f"packets may be dropped for some sampling phases: up to {backlog[worst]:.0f} would wait at "
        f"{plan.link_name(worst)}, and a queue holds {room}"
    ]


def _brown_out(plan: Plan) -> list[str]:
    power = plan.budget.power
    if power is None or not power.browned_out.any():
        return []
    gone = np.flatnonzero(power.browned_out)
    dark = int((power.voltage_v[gone] == 0.0).sum())
    names = ", ".join(plan.skin.cell_name(int(cell)) for cell in gone[:3])
    return [
        f"{len(gone)} cells brown out ({names}{', …' if len(gone) > 3 else ''}"
        f"{f'; {dark} of them have no wire to a feed' if dark else ''})"
    ]


def _limits(plan: Plan) -> list[str]:
    found = plan.breaches
    if plan.limits.utilisation >= 1.0:
        found.pop("utilisation", None)  # reported by _overload
    asked = _requested_limits(plan)
    return [
        f"{_LIMITS[key][0]} is {_format_limit(key, value)}; {_format_limit(key, asked[key])} required"
        for key, value in found.items()
        if not (key == "voltage_v" and value >= asked[key])
    ]


def _infeasible_limits(plan: Plan) -> list[str]:
    """Limits that no number of gateways keeps; patches with equal messages share a line."""
    asked = _requested_limits(plan)
    names: dict[str, list[str]] = {}
    for group, search in zip(plan.groups, plan.searches, strict=True):
        if search.breaches:
            limits = " and ".join(
                f"{_LIMITS[key][0]} "
                f"(at best {_format_limit(key, value)}, required {_format_limit(key, asked[key])})"
                for key, value in search.breaches.items()
            )
            count = len(search.gateways)
            line = f"even {count} gateways, one at every cell at the edge, do not keep {limits}"
            patches = np.unique(plan.skin.patch_of_cell[group.cells])
            names.setdefault(line, []).append(" + ".join(plan.skin.patches[p].name for p in patches))
    return [f"{', '.join(patches)}: {line}" for line, patches in names.items()]


def _requested_limits(plan: Plan) -> dict[str, float]:
    limits = plan.limits
    return {
        "latency_ms": limits.latency_ns * 1e-6,
        "utilisation": limits.utilisation,
        "voltage_v": limits.voltage_v,
    }


def _format_limit(key: str, value: float) -> str:
    return f"{value:.3g} {_LIMITS[key][1]}".strip() if key != "voltage_v" else f"{value:.2f} V"
