"""Queueing delay on a routing tree: worst case and mean.

All links have the same rate and serve first come, first served. A tree of such links delivers packets at the
times at which a single link would, if every packet arrived at it after its undelayed route (Modiano,
Wieselthier, Ephremides, 1996; for packets of one size). So results for one queue hold for the tree:

- A packet leaves before the busy period ends in which it arrived. The longest busy period follows from burst
  sizes and long-run rates; it bounds the waiting time on the whole route, for any phases. For periodic
  packets this is the bound of Chlamtac, Farago, Zhang and Fumagalli (1998): each other cell delays a packet
  at most once. It is reached when the undelayed routes of all end at the same moment.
- The mean over all packets of a tree is that of one queue: nD/D/1 for cells that send periodically at random
  phases, M/D/1 or M/G/1 for random events (Pollaczek-Khinchine).
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.tools.plan.routing_forest import RoutingForest
from skinnet.tools.plan.traffic import Traffic

__all__ = ["mean_wait_ns", "mean_waits_ns", "worst_backlog"]


def mean_wait_ns(traffic: Traffic, n_cells: int) -> NDArray[np.float64]:
    """Mean waiting time at a link behind 0, 1, …, `n_cells` cells, (n_cells + 1,) [ns]; inf on overload.

    nD/D/1, for n packets of a period of D slots at random phases: S(n) / 2 slots with S(1) = 0 and
    S(n) = (n − 1) / D × (1 + S(n − 1)). M/G/1, for random events: Pollaczek-Khinchine.
    """
    n = np.arange(n_cells + 1)
    load = n * traffic.utilisation_per_cell
    if not traffic.utilisation_per_cell:
        return np.zeros(n_cells + 1)
    if all(source.periodic and source.burst_packets == 1 for source, _ in traffic.sources):
        slots = traffic.period_ns / traffic.max_transmission_ns
        mean = np.zeros(n_cells + 1)
        for cells in range(2, n_cells + 1):
            mean[cells] = (cells - 1) / slots * (1.0 + mean[cells - 1])
        return np.where(load > 1.0 + 1e-9, np.inf, 0.5 * traffic.max_transmission_ns * mean)
    squares = sum(
        source.packets_per_s * share * 1e-9 * source.transmission_ns**2 for source, share in traffic.sources
    )
    with np.errstate(divide="ignore"):
        return np.where(load >= 1.0, np.inf, 0.5 * n * squares / np.maximum(1.0 - load, 0.0))


def mean_waits_ns(forest: RoutingForest, traffic: Traffic) -> NDArray[np.float64]:
    """Mean waiting time at every cell's link, (n,) [ns]; inf for an overloaded link.

    The total wait in a whole tree is known; that at its top link is the total less the wait in its branches.
    """
    n_cells = len(forest.parent)
    mean = mean_wait_ns(traffic, int(forest.subtree_size.max(initial=0)))
    total = forest.subtree_size * mean[forest.subtree_size]
    branches = np.zeros(n_cells)
    inner = np.flatnonzero(forest.parent >= 0)
    np.add.at(branches, forest.parent[inner], total[inner])
    overflows = ~np.isfinite(total)
    at_link = np.where(overflows, 0.0, total) - np.where(overflows, 0.0, branches)
    return np.where(overflows, np.inf, at_link / np.maximum(forest.subtree_size, 1))


def worst_backlog(forest: RoutingForest, traffic: Traffic, jitter_ns: int = 0) -> NDArray[np.float64]:
    """Worst-case backlog behind the packet in transmission on each cell's link, (n,); inf if unbounded.

    Each branch delivers one packet at a time, so a queue grows only while several branches send at once: in
    ℓ consecutive slots, branch c delivers at most min(ℓ, its packets in that time), and ℓ are sent. Jitter,
    up to `jitter_ns` a link, lets packets of a branch come closer together.
    """
    spread_ns = jitter_ns * int(forest.depth.max(initial=0))
    worst = np.zeros(len(forest.parent))
    if not traffic.min_transmission_ns:
        return worst
    inner = np.flatnonzero(forest.parent >= 0)
    branches: list[list[int]] = [[] for _ in forest.parent]
    for cell in inner.tolist():
        branches[forest.parent[cell]].append(int(forest.subtree_size[cell]))
    busy_ns: dict[int, float] = {}
    for cell in np.flatnonzero(forest.depth).tolist():
        below = int(forest.subtree_size[cell])
        if below not in busy_ns:
            busy_ns[below] = traffic.busy_period_ns(below, spread_ns)
        worst[cell] = _worst_link_backlog(branches[cell], traffic, busy_ns, below, (jitter_ns, spread_ns))
    return worst


def _worst_link_backlog(
    branches: list[int], traffic: Traffic, busy_ns: dict[int, float], below: int, jitters_ns: tuple[int, int]
) -> float:
    jitter_ns, spread_ns = jitters_ns
    if not np.isfinite(busy_ns[below]):
        return np.inf
    most = int(busy_ns[below] // traffic.min_transmission_ns)  # packets in one busy period
    slots = np.arange(1, 2 + most)
    arrived = 1.0 + (slots * traffic.max_transmission_ns - 1 + jitter_ns) // traffic.min_transmission_ns
    window_ns = slots * traffic.max_transmission_ns + spread_ns
    came = traffic.burst_packets(1) * (1.0 + window_ns // traffic.period_ns)
    for cells in branches:
        # packets delayed in the branch may arrive together with later ones
        late_ns = busy_ns[cells] if cells in busy_ns else traffic.busy_period_ns(cells, spread_ns)
        samples = 1.0 + (window_ns + late_ns) // traffic.period_ns
        came += np.minimum(arrived, traffic.burst_packets(cells) * samples)
    return float(max((np.minimum(came, most) - slots).max(), 0.0))
