"""JSON report of a plan: flat metrics, diagnostics, and every patch, gateway and link."""

import math
from typing import Any

import numpy as np

from skinnet.tools.plan.diagnostics import diagnose
from skinnet.tools.plan.plan import Plan
from skinnet.tools.plan.routing_forest import UNREACHED

__all__ = ["plan_report"]


def plan_report(plan: Plan) -> dict[str, Any]:
    """JSON-ready report of `plan`; unbounded values are None."""
    return {
        "deployment": plan.deployment.name,
        "load": _load(plan),
        "limits": {
            "latency_ms": _finite(plan.limits.latency_ns, 1e-6),
            "utilisation": plan.limits.utilisation,
            "voltage_v": plan.limits.voltage_v if plan.deployment.power is not None else None,
        },
        "problems": diagnose(plan),
        "metrics": _metrics(plan),
        "patches": [_patch(plan, index) for index in range(len(plan.skin.patches))],
        "gateways": [_gateway(plan, index) for index in range(len(plan.skin.gateways))],
        "fewest": [_fewest(plan, index) for index in range(len(plan.groups))],
        "links": [_link(plan, cell) for cell in range(plan.skin.n_cells)],
    }


def _finite(value: float, scale: float = 1.0) -> float | None:
    return float(value) * scale if math.isfinite(value) else None


def _load(plan: Plan) -> dict[str, Any]:
    traffic, spec = plan.traffic, plan.deployment.plan
    load: dict[str, Any] = {"encoding": traffic.encoding, "why": traffic.reason}
    if traffic.encoding != "periodic":
        load |= {
            "stimulated": spec.stimulated_fraction,
            "events_hz": spec.event_rate_hz,
            "idle_events_hz": spec.idle_event_rate_hz,
            "streams_when_touched": spec.stream_when_touched,
        }
    return load


def _metrics(plan: Plan) -> dict[str, Any]:
    budget, skin = plan.budget, plan.skin
    impossible = any(search.breaches for search in plan.searches)
    metrics = {
        "plan.cells": skin.n_cells,
        "plan.patches": len(skin.patches),
        "plan.gateways": len(skin.gateways),
        "plan.fewest_gateways": None if impossible else sum(len(s.gateways) for s in plan.searches),
        "plan.packets_per_s": plan.traffic.packets_per_s * skin.n_cells,
        "plan.dropped_per_s": float(budget.dropped_per_s.sum()),
        "plan.utilisation": float(budget.utilisation.max()),
        "plan.depth": int(budget.forest.depth.max()),
        "plan.latency_ms.worst": _finite(budget.worst_latency_ns.max(), 1e-6),
        "plan.latency_ms.expected": _finite(budget.mean_latency_ns.mean(), 1e-6),
        "plan.backlog_packets": _finite(budget.worst_backlog_packets.max()),
        "plan.unreached_cells": int((budget.forest.parent == UNREACHED).sum()),
    }
    if budget.power is not None and plan.deployment.power is not None:
        metrics |= {
            "plan.min_voltage_v": float(budget.power.voltage_v.min()),
            "plan.browned_out_cells": int(budget.power.browned_out.sum()),
            "plan.power_w": plan.deployment.power.supply_v * float(budget.power.feed_current_a.sum()),
        }
    return metrics


def _patch(plan: Plan, index: int) -> dict[str, Any]:
    budget = plan.budget
    cells = np.arange(plan.skin.first_cell[index], plan.skin.first_cell[index + 1])
    busiest = int(cells[budget.utilisation[cells].argmax()])
    entry = {
        "name": plan.skin.patches[index].name,
        "cells": len(cells),
        "gateways": len(plan.skin.patches[index].interfaces),
        "depth": int(budget.forest.depth[cells].max()),
        "utilisation": float(budget.utilisation[busiest]),
        "busiest_link": plan.link_name(busiest),
        "latency_ms": {
            "worst": _finite(budget.worst_latency_ns[cells].max(), 1e-6),
            "expected": _finite(budget.mean_latency_ns[cells].mean(), 1e-6),
        },
        "backlog_packets": _finite(budget.worst_backlog_packets[cells].max()),
    }
    if budget.power is not None:
        lowest = int(cells[budget.power.voltage_v[cells].argmin()])
        entry["lowest_v"] = float(budget.power.voltage_v[lowest])
        entry["lowest_cell"] = plan.skin.cell_name(lowest)
        entry["browned_out"] = int(budget.power.browned_out[cells].sum())
    return entry


def _gateway(plan: Plan, index: int) -> dict[str, Any]:
    cell, port = plan.skin.gateways[index].tolist()
    mine = plan.budget.forest.gateway == index
    return {
        "at": f"{plan.skin.cell_name(cell)}:{port}",
        "cells": int(mine.sum()),
        "utilisation": float(plan.budget.utilisation[cell]) if mine.any() else 0.0,
        "packets_per_s": plan.traffic.packets_per_s * int(mine.sum()),
    }


def _fewest(plan: Plan, index: int) -> dict[str, Any]:
    group, search = plan.groups[index], plan.searches[index]
    patches = np.unique(plan.skin.patch_of_cell[group.cells])
    return {
        "patches": [plan.skin.patches[patch].name for patch in patches],
        "now": len(group.gateways),
        "possible": not search.breaches,
        "gateways": len(search.gateways),
        "at_least": search.lower_bound,
        "at": plan.gateway_places(index),
        "not_kept": search.breaches,
    }


def _link(plan: Plan, cell: int) -> dict[str, Any]:
    budget = plan.budget
    return {
        "link": plan.link_name(cell),
        "cells": int(budget.forest.subtree_size[cell]),
        "depth": int(budget.forest.depth[cell]),
        "utilisation": float(budget.utilisation[cell]),
        "worst_ms": _finite(budget.worst_latency_ns[cell], 1e-6),
        "expected_ms": _finite(budget.mean_latency_ns[cell], 1e-6),
        "backlog_packets": _finite(budget.worst_backlog_packets[cell]),
        "dropped_per_s": float(budget.dropped_per_s[cell]),
        "voltage_v": None if budget.power is None else float(budget.power.voltage_v[cell]),
    }
