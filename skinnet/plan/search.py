"""The fewest gateways, and where, with which patches keep a latency, a utilisation and a voltage."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from skinnet.deployment.power import PowerSpec
from skinnet.deployment.schema import NetworkSpec
from skinnet.plan.budget import Budget, draw_up
from skinnet.plan.traffic import Traffic
from skinnet.skin.gateways import free_ports, spread_over

__all__ = ["Group", "Limits", "Search", "breaches", "fewest"]


class Limits(NamedTuple):
    """What a plan must keep.

    Attributes:
        latency_ns: Longest worst-case latency [ns]; inf for no limit.
        utilisation: Largest share of its time that a link may send.
        voltage_v: Lowest voltage of a cell [V]; 0 for no limit.
    """

    latency_ns: float
    utilisation: float
    voltage_v: float


class Group(NamedTuple):
    """Patches that bridges join, on their own.

    Attributes:
        cells: (n,) their cells in the whole skin; the other columns count from 0.
        wires: (m, 4) rows of (cell, port, cell, port).
        gateways: (g, 2) rows of (cell, port).
        feeds: (f,) fed cells; None if the gateways are.
    """

    cells: NDArray[np.int64]
    wires: NDArray[np.int64]
    gateways: NDArray[np.int64]
    feeds: NDArray[np.int64] | None


@dataclass(frozen=True)
class Search:
    """What a search has found.

    Attributes:
        gateways: (k, 2) rows of (cell, port) of the group; with the most that can be, if no number is enough.
        at_least: No number below this can carry the load, wherever they are.
        breaches: Limits that even these gateways do not keep, with the value reached; empty if all are kept.
        budget: The budget with these gateways.
    """

    gateways: NDArray[np.int64]
    at_least: int
    breaches: dict[str, float]
    budget: Budget


def breaches(budget: Budget, limits: Limits) -> dict[str, float]:
    """The limits that `budget` does not keep, each with its worst value."""
    found = {}
    worst_ns, load = float(budget.worst_ns.max()), float(budget.utilisation.max())
    if worst_ns > limits.latency_ns:
        found["latency_ms"] = worst_ns * 1e-6
    if load > limits.utilisation + 1e-9:
        found["utilisation"] = load
    if budget.power is not None:
        lowest_v = float(budget.power.voltage_v.min())
        if lowest_v < limits.voltage_v - 1e-9 or budget.power.browned_out.any():
            found["voltage_v"] = lowest_v
    return found


def fewest(
    group: Group, limits: Limits, traffic: Traffic, network: NetworkSpec, power: PowerSpec | None
) -> Search:
    """The fewest gateways of `group` with which nothing breaches `limits`, as far as good places are found.

    Tries one number after the other, from the least that could carry the load to all cells at the edge.
    """
    n_cells = len(group.cells)
    ports = free_ports(n_cells, group.wires)
    most = len(np.unique(ports[:, 0]))
    at_least = min(max(_at_least(n_cells, limits, traffic), _pieces(n_cells, group.wires)), most)

    def judge(gateways: NDArray[np.int64]) -> Search:
        feeds = gateways[:, 0] if group.feeds is None else group.feeds
        budget = draw_up(n_cells, group.wires, gateways, feeds, traffic, network, power)
        return Search(gateways, at_least, breaches(budget, limits), budget)

    best = judge(spread_over(n_cells, group.wires, ports, most))
    if best.breaches:
        return best
    for k in range(at_least, most):
        tries = [spread_over(n_cells, group.wires, ports, k)]
        if k == len(group.gateways):
            tries.append(group.gateways)  # somebody may have found better places
        for gateways in tries:
            if not (found := judge(gateways)).breaches:
                return found
    return best


def _pieces(n_cells: int, wires: NDArray[np.int64]) -> int:
    ones = np.ones(len(wires), dtype=np.int8)
    graph = coo_array((ones, (wires[:, 0], wires[:, 2])), shape=(n_cells, n_cells))
    return int(connected_components(graph, directed=False)[0])


def _at_least(n_cells: int, limits: Limits, traffic: Traffic) -> int:
    """Gateways without which, however the cells are shared out, some link has more than its limit."""
    per_gateway = n_cells
    while per_gateway > 1 and traffic.load_of(per_gateway) > limits.utilisation + 1e-9:
        per_gateway -= 1
    return math.ceil(n_cells / per_gateway)
