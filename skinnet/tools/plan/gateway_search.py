"""Gateway search: fewest gateways, and their places, that keep latency, utilisation and voltage limits."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from skinnet.deployment.network import NetworkSpec, PowerSpec
from skinnet.skin.gateway_placement import MAX_GATEWAY_PORTS, choose_gateway_ports, free_ports
from skinnet.tools.plan.link_budget import LinkBudget, compute_budget
from skinnet.tools.plan.traffic import Traffic

__all__ = ["Limits", "PatchGroup", "SearchResult", "breaches", "search_fewest_gateways"]

_SINGLE_STEPS = 32
"""Numbers of gateways that are tried one after the other before the steps double."""


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

    Tries one number after the other from the lower bound on. After some it takes steps that double, up to all
    cells at the edge or the ports of one gateway, and then halves the interval between what suffices and what
    does not. Places are heuristic.
    """
    n_cells = len(group.cells)
    ports = free_ports(n_cells, group.wires)
    most = len(np.unique(ports[:, 0]))
    at_least = min(
        max(_load_lower_bound(n_cells, limits, traffic), _connected_components(n_cells, group.wires)), most
    )

    def evaluate(gateways: NDArray[np.int64]) -> SearchResult:
        feeds = gateways[:, 0] if group.feeds is None else group.feeds
        budget = compute_budget(n_cells, group.wires, gateways, feeds, traffic, network, power)
        return SearchResult(gateways, at_least, breaches(budget, limits), budget)

    best = evaluate(choose_gateway_ports(n_cells, group.wires, ports, most))
    if best.breaches:
        return best

    def suffices(k: int) -> SearchResult | None:
        tries = [choose_gateway_ports(n_cells, group.wires, ports, k)]
        if k == len(group.gateways):
            tries.append(group.gateways)  # the deployment's places may be better
        return next((found for found in map(evaluate, tries) if not found.breaches), None)

    too_few, enough, step = min(at_least, MAX_GATEWAY_PORTS) - 1, min(most, MAX_GATEWAY_PORTS), 1
    if enough < most:
        if (found := suffices(enough)) is None:
            return evaluate(choose_gateway_ports(n_cells, group.wires, ports, enough))
        best = found
    while too_few + step < enough:
        if (found := suffices(too_few + step)) is not None:
            best, enough = found, too_few + step
            break
        too_few += step
        step = 1 if too_few - at_least < _SINGLE_STEPS else 2 * step
    while enough - too_few > 1:
        middle = (too_few + enough) // 2
        if (found := suffices(middle)) is not None:
            best, enough = found, middle
        else:
            too_few = middle
    return best


def _connected_components(n_cells: int, wires: NDArray[np.int64]) -> int:
    ones = np.ones(len(wires), dtype=np.int8)
    graph = coo_array((ones, (wires[:, 0], wires[:, 2])), shape=(n_cells, n_cells))
    return int(connected_components(graph, directed=False)[0])


def _load_lower_bound(n_cells: int, limits: Limits, traffic: Traffic) -> int:
    """Lower bound on gateways: with fewer, some link exceeds its limit for any assignment of cells."""
    per_gateway = n_cells
    while per_gateway > 1 and traffic.utilisation_of(per_gateway) > limits.utilisation + 1e-9:
        per_gateway -= 1
    return math.ceil(n_cells / per_gateway)
