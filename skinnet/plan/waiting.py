"""How long packets wait on a tree of links: at most, and on average.

All links send equally fast, first come, first served. A tree of such links hands the computer its packets at
the very times at which one link alone would, if every packet came to it after its undisturbed way (Modiano,
Wieselthier, Ephremides, 1996; for packets of one size). So what is known of one queue holds for the tree:

- A packet leaves before the busy time ends in which it came. The longest busy time follows from how much can
  be sent at once and in the long run; it bounds the waiting on the whole way, however phases fall. For
  periodic packets this is the bound of Chlamtac, Farago, Zhang and Fumagalli (1998): each other cell delays
  a packet at most once. It is reached when the undisturbed ways of all end at the same moment.
- The mean over all packets of a tree is that of one queue: nD/D/1 for cells that send periodically at random
  phases, M/D/1 or M/G/1 for events at random (by Pollaczek and Khinchine).
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.plan.forest import Forest
from skinnet.plan.traffic import Traffic

__all__ = ["mean_wait_ns", "waits_ns", "worst_backlog"]


def mean_wait_ns(traffic: Traffic, n_cells: int) -> NDArray[np.float64]:
    """Mean wait before one link behind 0, 1, …, `n_cells` cells, (n_cells + 1,) [ns]; inf where it overflows.

    Of n periodic packets of D slots, at random phases: S(n) / 2 slots with S(1) = 0 and
    S(n) = (n − 1) / D × (1 + S(n − 1)).
    """
    n = np.arange(n_cells + 1)
    load = n * traffic.load
    if not traffic.load:
        return np.zeros(n_cells + 1)
    if all(source.periodic and source.at_once == 1 for source, _ in traffic.sources):
        slots = traffic.period_ns / traffic.longest_ns
        mean = np.zeros(n_cells + 1)
        for cells in range(2, n_cells + 1):
            mean[cells] = (cells - 1) / slots * (1.0 + mean[cells - 1])
        return np.where(load > 1.0 + 1e-9, np.inf, 0.5 * traffic.longest_ns * mean)
    squares = sum(source.per_s * share * 1e-9 * source.send_ns**2 for source, share in traffic.sources)
    with np.errstate(divide="ignore"):
        return np.where(load >= 1.0, np.inf, 0.5 * n * squares / np.maximum(1.0 - load, 0.0))


def waits_ns(forest: Forest, traffic: Traffic) -> NDArray[np.float64]:
    """Mean wait before every cell's link, (n,) [ns]; inf for a link with more than it can send.

    What waits in a whole tree is known; what waits at its top link is that less what waits in its branches.
    """
    n_cells = len(forest.parent)
    mean = mean_wait_ns(traffic, int(forest.below.max(initial=0)))
    total = forest.below * mean[forest.below]
    branches = np.zeros(n_cells)
    inner = np.flatnonzero(forest.parent >= 0)
    np.add.at(branches, forest.parent[inner], total[inner])
    overflows = ~np.isfinite(total)
    at_link = np.where(overflows, 0.0, total) - np.where(overflows, 0.0, branches)
    return np.where(overflows, np.inf, at_link / np.maximum(forest.below, 1))


def worst_backlog(forest: Forest, traffic: Traffic, jitter_ns: int = 0) -> NDArray[np.float64]:
    """Most packets that can wait behind the one that a cell's link sends, (n,); inf if there is no bound.

    From every branch comes one packet at a time, so a queue grows only while several branches send at once:
    for ℓ slots on end, branch c brings at most min(ℓ, its packets in that time), and ℓ are sent. Jitter, up
    to `jitter_ns` a link, lets packets of a branch come closer together.
    """
    spread_ns = jitter_ns * int(forest.depth.max(initial=0))
    worst = np.zeros(len(forest.parent))
    if not traffic.shortest_ns:
        return worst
    inner = np.flatnonzero(forest.parent >= 0)
    branches: list[list[int]] = [[] for _ in forest.parent]
    for cell in inner.tolist():
        branches[forest.parent[cell]].append(int(forest.below[cell]))
    busy_ns: dict[int, float] = {}
    for cell in np.flatnonzero(forest.depth).tolist():
        below = int(forest.below[cell])
        if below not in busy_ns:
            busy_ns[below] = traffic.busy_ns(below, spread_ns)
        worst[cell] = _most_waiting(branches[cell], traffic, busy_ns, below, (jitter_ns, spread_ns))
    return worst


def _most_waiting(
    branches: list[int], traffic: Traffic, busy_ns: dict[int, float], below: int, jitters_ns: tuple[int, int]
) -> float:
    jitter_ns, spread_ns = jitters_ns
    if not np.isfinite(busy_ns[below]):
        return np.inf
    most = int(busy_ns[below] // traffic.shortest_ns)  # sent without a pause, with all that waits
    slots = np.arange(1, 2 + most)
    arrived = 1.0 + (slots * traffic.longest_ns - 1 + jitter_ns) // traffic.shortest_ns
    window_ns = slots * traffic.longest_ns + spread_ns
    came = traffic.at_once(1) * (1.0 + window_ns // traffic.period_ns)
    for cells in branches:
        # what has waited in the branch may come together with what follows it
        late_ns = busy_ns[cells] if cells in busy_ns else traffic.busy_ns(cells, spread_ns)
        samples = 1.0 + (window_ns + late_ns) // traffic.period_ns
        came += np.minimum(arrived, traffic.at_once(cells) * samples)
    return float(max((np.minimum(came, most) - slots).max(), 0.0))
