"""Link budget of a skin with given gateways: utilisation, latency, backlog and voltage of each cell."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.deployment.network import NetworkSpec, PowerSpec
from skinnet.network.power_grid import PowerGrid, PowerState
from skinnet.tools.plan.queueing import mean_waits_ns, worst_backlog
from skinnet.tools.plan.routing_forest import RoutingForest, compute_forest
from skinnet.tools.plan.traffic import Traffic

__all__ = ["LinkBudget", "compute_budget"]


@dataclass(frozen=True)
class LinkBudget:
    """Link budget of a skin; a link has the index of the cell that sends over it.

    Attributes:
        forest: Route of every cell to its gateway.
        utilisation: (n,) fraction of time that a cell's link transmits, with as many touched cells behind it
            as possible; above 1 it drops packets.
        worst_latency_ns: (n,) worst-case latency from sample to gateway, any phases [ns]; inf if unbounded.
        mean_latency_ns: (n,) mean latency, touched cells spread evenly, random phases [ns]; inf if unbounded.
        worst_backlog_packets: (n,) most packets that can wait behind the one in transmission on a link.
        dropped_per_s: (n,) mean packet rate beyond the capacity of a link [1/s].
        power: Voltages [V] and currents [A]; None without power wires.
    """

    forest: RoutingForest
    utilisation: NDArray[np.float64]
    worst_latency_ns: NDArray[np.float64]
    mean_latency_ns: NDArray[np.float64]
    worst_backlog_packets: NDArray[np.float64]
    dropped_per_s: NDArray[np.float64]
    power: PowerState | None


def compute_budget(
    n_cells: int,
    wires: ArrayLike,
    gateways: ArrayLike,
    feeds: ArrayLike,
    traffic: Traffic,
    network: NetworkSpec,
    power: PowerSpec | None,
) -> LinkBudget:
    """Compute the link budget of cells with `wires` (m, 4), `gateways` (g, 2) and fed cells `feeds` (f,)."""
    forest = compute_forest(n_cells, wires, gateways)
    below = forest.subtree_size
    load = np.array([traffic.utilisation_of(n) for n in range(int(below.max(initial=0)) + 1)])
    delay_ns, jitter_ns = round(network.hop_delay_us * 1e3), round(network.jitter_us * 1e3)
    spread_ns = int(forest.depth.max(initial=0)) * jitter_ns
    waiting = mean_waits_ns(forest, traffic) + _mean_transmission_ns(traffic) + delay_ns + jitter_ns / 2
    reached = forest.depth > 0
    return LinkBudget(
        forest,
        load[below],
        np.where(reached, _worst_latency_ns(forest, traffic, network, spread_ns), np.inf),
        np.where(reached, forest.route_sums(waiting), np.inf),
        worst_backlog(forest, traffic, jitter_ns),
        _dropped_per_s(forest, traffic),
        None if power is None else PowerGrid(n_cells, wires, feeds, power).solve(),
    )


def _mean_transmission_ns(traffic: Traffic) -> float:
    if not traffic.packets_per_s:
        return 0.0
    return (
        sum(source.packets_per_s * share * source.transmission_ns for source, share in traffic.sources)
        / traffic.packets_per_s
    )


def _worst_latency_ns(
    forest: RoutingForest, traffic: Traffic, network: NetworkSpec, accumulated_jitter_ns: int
) -> NDArray[np.float64]:
    """Worst-case latency (n,) [ns]: hop delays and longest busy period, bounded by full queues.

    Behind a larger packet a small one waits again at every link: all but the last hop count as the largest.
    """
    sizes, index = np.unique(forest.tree_size, return_inverse=True)
    busy = [traffic.busy_period_ns(int(size), accumulated_jitter_ns) if size else 0.0 for size in sizes]
    busy_ns: NDArray[np.float64] = np.array(busy)[index]
    hop_ns = round(network.hop_delay_us * 1e3) + round(network.jitter_us * 1e3)
    worst_ns = busy_ns + (forest.depth * hop_ns + (forest.depth - 1) * traffic.max_transmission_ns)
    if network.queue_packets >= 0:
        full_ns = forest.depth * (hop_ns + (network.queue_packets + 1) * traffic.max_transmission_ns)
        worst_ns = np.minimum(worst_ns, full_ns)
    return worst_ns


def _dropped_per_s(forest: RoutingForest, traffic: Traffic) -> NDArray[np.float64]:
    """Mean packet rate beyond the capacity of each link (n,) [1/s]."""
    if not traffic.utilisation_per_cell:
        return np.zeros(len(forest.parent))
    most = traffic.packets_per_s / traffic.utilisation_per_cell
    carried, dropped = (np.zeros(len(forest.parent)) for _ in range(2))
    for level in reversed(forest.cells_by_depth):
        offered = carried[level] + traffic.packets_per_s
        carried[level] = np.minimum(offered, most)
        dropped[level] = offered - carried[level]
        inner = level[forest.parent[level] >= 0]
        np.add.at(carried, forest.parent[inner], carried[inner])
    return dropped
