"""Gateway search: fewest gateways, and their places, that keep latency, utilisation and voltage limits."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.network import NetworkSpec, PowerSpec
from skinnet.skin.gateway_placement import MAX_GATEWAY_PORTS, choose_gateway_ports, free_ports
from skinnet.skin.wire_graph import wire_components
from skinnet.tools.plan.link_budget import LinkBudget, compute_budget
from skinnet.tools.plan.traffic import Traffic

__all__ = ["Limits", "PatchGroup", "SearchResult", "breaches", "search_fewest_gateways"]


class Limits(NamedTuple):
    """Limits that a plan must keep.

    Attributes:
        latency_ns: Largest worst-case latency [ns]; inf for no limit.
        utilisation: Largest fraction of time that a link may transmit.
        voltage_v: Lowest voltage of a cell [V]; 0 for no limit.
    """

    latency_ns: float
    utilisation: float
    voltage_v: float


class PatchGroup(NamedTuple):
    """Group of patches joined by bridges.

    Attributes:
        cells: (n,) indices of its cells in the whole skin; the other arrays number them from 0.
        wires: (m, 4) rows of (cell, port, cell, port).
        gateways: (g, 2) rows of (cell, port).
        feeds: (f,) fed cells; None if the gateways' cells are fed.
    """

    cells: NDArray[np.int64]
    wires: NDArray[np.int64]
    gateways: NDArray[np.int64]
    feeds: NDArray[np.int64] | None


@dataclass(frozen=True)
class SearchResult:
    """Result of a gateway search.

    Attributes:
        gateways: (k, 2) rows of (cell, port) of the group; if no number suffices, as many as one gateway
            has ports where more would do, else as many as there are places.
        lower_bound: Lower bound on the number of gateways that can carry the load, at any places.
        breaches: Limits that even these gateways breach, with the value reached; empty if all are kept.
        budget: Link budget with these gateways.
    """

    gateways: NDArray[np.int64]
    lower_bound: int
    breaches: dict[str, float]
    budget: LinkBudget


def breaches(budget: LinkBudget, limits: Limits) -> dict[str, float]:
    """Limits that `budget` breaches, each with its worst value."""
    found = {}
    worst_ns, load = float(budget.worst_latency_ns.max()), float(budget.utilisation.max())
    if worst_ns > limits.latency_ns:
        found["latency_ms"] = worst_ns * 1e-6
    if load > limits.utilisation + 1e-9:
        found["utilisation"] = load
    if budget.power is not None:
        lowest_v = float(budget.power.voltage_v.min())
        if lowest_v < limits.voltage_v - 1e-9 or budget.power.browned_out.any():
            found["voltage_v"] = lowest_v
    return found


def search_fewest_gateways(
    group: PatchGroup, limits: Limits, traffic: Traffic, network: NetworkSpec, power: PowerSpec | None
) -> SearchResult:
    """Search for the fewest gateways of `group` that breach none of `limits`, at evenly spread places.

    Tries one number after the other, from the lower bound to all cells with a free port, or to the ports of
    one gateway. Places are heuristic.
    """
    n_cells = len(group.cells)
    ports = free_ports(n_cells, group.wires)
    most = len(np.unique(ports[:, 0]))
    at_least = min(
        max(_load_lower_bound(n_cells, limits, traffic), len(wire_components(n_cells, group.wires))), most
    )

    def evaluate(gateways: NDArray[np.int64]) -> SearchResult:
        feeds = gateways[:, 0] if group.feeds is None else group.feeds
        budget = compute_budget(n_cells, group.wires, gateways, feeds, traffic, network, power)
        return SearchResult(gateways, at_least, breaches(budget, limits), budget)

    def at_spread_places(k: int) -> SearchResult:
        found = evaluate(choose_gateway_ports(n_cells, group.wires, ports, k))
        if found.breaches and k == len(group.gateways):  # the deployment's places may be better
            own = evaluate(group.gateways)
            return found if own.breaches else own
        return found

    best = evaluate(choose_gateway_ports(n_cells, group.wires, ports, most))
    if best.breaches:
        return best
    enough = min(most, MAX_GATEWAY_PORTS)
    if enough < most:
        best = at_spread_places(enough)
        if best.breaches:
            return best
    for k in range(at_least, enough):
        found = at_spread_places(k)
        if not found.breaches:
            return found
    return best


def _load_lower_bound(n_cells: int, limits: Limits, traffic: Traffic) -> int:
    """Lower bound on gateways: with fewer, some link exceeds its limit for any assignment of cells."""
    per_gateway = n_cells
    while per_gateway > 1 and traffic.utilisation_of(per_gateway) > limits.utilisation + 1e-9:
        per_gateway -= 1
    return math.ceil(n_cells / per_gateway)
