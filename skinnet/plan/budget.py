"""Link budget of a skin with given gateways: utilisation, latency, backlog and voltage of each cell."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.deployment.power import PowerSpec
from skinnet.deployment.schema import NetworkSpec
from skinnet.network.power import PowerGrid, PowerState
from skinnet.plan.forest import Forest, grow
from skinnet.plan.traffic import Traffic
from skinnet.plan.waiting import waits_ns, worst_backlog

__all__ = ["Budget", "draw_up"]


@dataclass(frozen=True)
class Budget:
    """Link budget of a skin; a link has the index of the cell that sends over it.

    Attributes:
        forest: Route of every cell to its gateway.
        utilisation: (n,) fraction of time that a cell's link transmits, with as many touched cells behind it
            as possible; above 1 it drops packets.
        worst_ns: (n,) worst-case latency from the sample to the gateway, any phases [ns]; inf if unbounded.
        expected_ns: (n,) mean latency, touched cells spread evenly, random phases [ns]; inf if unbounded.
        backlog: (n,) most packets that can wait behind the one in transmission on a cell's link.
        dropped_per_s: (n,) mean packet rate beyond the capacity of a link [1/s].
        power: Voltages [V] and currents [A]; None without power wires.
    """

    forest: Forest
    utilisation: NDArray[np.float64]
    worst_ns: NDArray[np.float64]
    expected_ns: NDArray[np.float64]
    backlog: NDArray[np.float64]
    dropped_per_s: NDArray[np.float64]
    power: PowerState | None


def draw_up(
    n_cells: int,
    wires: ArrayLike,
    gateways: ArrayLike,
    feeds: ArrayLike,
    traffic: Traffic,
    network: NetworkSpec,
    power: PowerSpec | None,
) -> Budget:
    """Compute the link budget of cells with `wires` (m, 4), `gateways` (g, 2) and fed cells `feeds` (f,)."""
    forest = grow(n_cells, wires, gateways)
    below = forest.below
    load = np.array([traffic.load_of(n) for n in range(int(below.max(initial=0)) + 1)])
    delay_ns, jitter_ns = round(network.hop_delay_us * 1e3), round(network.jitter_us * 1e3)
    spread_ns = int(forest.depth.max(initial=0)) * jitter_ns
    waiting = waits_ns(forest, traffic) + _mean_send_ns(traffic) + delay_ns + jitter_ns / 2
    reached = forest.depth > 0
    return Budget(
        forest,
        load[below],
        np.where(reached, _worst_ns(forest, traffic, network, spread_ns), np.inf),
        np.where(reached, forest.sum_down(waiting), np.inf),
        worst_backlog(forest, traffic, jitter_ns),
        _dropped(forest, traffic),
        None if power is None else PowerGrid(n_cells, wires, feeds, power).solve(),
    )


def _mean_send_ns(traffic: Traffic) -> float:
    if not traffic.per_s:
        return 0.0
    return sum(source.per_s * share * source.send_ns for source, share in traffic.sources) / traffic.per_s


def _worst_ns(forest: Forest, traffic: Traffic, network: NetworkSpec, spread_ns: int) -> NDArray[np.float64]:
    """Worst-case latency (n,) [ns]: hop delays and longest busy period, bounded by full queues.

    Behind a larger packet a small one waits again at every link: all but the last hop count as the largest.
    """
    sizes, index = np.unique(forest.tree, return_inverse=True)
    busy = [traffic.busy_ns(int(size), spread_ns) if size else 0.0 for size in sizes]
    busy_ns: NDArray[np.float64] = np.array(busy)[index]
    hop_ns = round(network.hop_delay_us * 1e3) + round(network.jitter_us * 1e3)
    worst_ns = busy_ns + (forest.depth * hop_ns + (forest.depth - 1) * traffic.longest_ns)
    if network.queue_packets >= 0:
        full_ns = forest.depth * (hop_ns + (network.queue_packets + 1) * traffic.longest_ns)
        worst_ns = np.minimum(worst_ns, full_ns)
    return worst_ns


def _dropped(forest: Forest, traffic: Traffic) -> NDArray[np.float64]:
    """Mean packet rate beyond the capacity of each link (n,) [1/s]."""
    if not traffic.load:
        return np.zeros(len(forest.parent))
    most = traffic.per_s / traffic.load
    carried, dropped = (np.zeros(len(forest.parent)) for _ in range(2))
    for level in reversed(forest.levels):
        offered = carried[level] + traffic.per_s
        carried[level] = np.minimum(offered, most)
        dropped[level] = offered - carried[level]
        inner = level[forest.parent[level] >= 0]
        np.add.at(carried, forest.parent[inner], carried[inner])
    return dropped
