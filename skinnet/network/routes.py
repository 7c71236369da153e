"""Route tables of fewest hops, computed by breadth-first search from each destination."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.compilation import compiled
from skinnet.network.topology import Topology

__all__ = ["NO_LINK", "Routes", "min_hop_routes"]

NO_LINK = -1
"""No link: in a route, no path; in a packet record, injected at the node."""


@dataclass(frozen=True, eq=False)
class Routes:
    """Route table entries: at `node[i]`, a packet for `dest[i]` leaves by `link[i]`, all (n,).

    `NO_LINK` means no path. Entries that are not listed stay unchanged.
    """

    node: NDArray[np.int64]
    dest: NDArray[np.int64]
    link: NDArray[np.int64]


def min_hop_routes(topology: Topology, dests: ArrayLike, *, dead_links: ArrayLike = ()) -> Routes:
    """Compute routes of fewest hops to each of `dests`, from every other node of its component.

    Among several links on shortest paths, a node takes the one of its lowest port.

    Args:
        topology: Nodes and links.
        dests: Destination nodes, (n_dests,).
        dead_links: Links that no route may use.

    Returns:
        One entry for every destination and other node of its component, `NO_LINK` without a path, so that
        these routes replace all earlier ones to the same destinations.
    """
    wanted = np.atleast_1d(np.asarray(dests, dtype=np.int64))
    alive = np.ones(topology.n_links, dtype=np.bool_)
    alive[np.asarray(dead_links, dtype=np.int64)] = False
    by_dst = np.argsort(topology.dst, kind="stable")
    in_start = np.concatenate(([0], np.cumsum(np.bincount(topology.dst, minlength=topology.n_nodes))))
    sizes = np.diff(topology.member_start)[topology.component[wanted]] - 1
    node, dest, link = (np.empty(int(sizes.sum()), dtype=np.int64) for _ in range(3))
    _breadth_first_search(
        wanted,
        topology.component,
        topology.members,
        topology.member_start,
        by_dst,
        in_start.astype(np.int64),
        topology.src,
        topology.src_port,
        alive,
        node,
        dest,
        link,
    )
    return Routes(node, dest, link)


@compiled
def _breadth_first_search(
    dests: NDArray[np.int64],
    component: NDArray[np.int64],
    members: NDArray[np.int64],
    member_start: NDArray[np.int64],
    by_dst: NDArray[np.int64],
    in_start: NDArray[np.int64],
    src: NDArray[np.int64],
    src_port: NDArray[np.int64],
    alive: NDArray[np.bool_],
    out_node: NDArray[np.int64],
    out_dest: NDArray[np.int64],
    out_link: NDArray[np.int64],
) -> None:
    distance = np.full(component.size, -1, dtype=np.int64)
    chosen = np.full(component.size, -1, dtype=np.int64)
    front = np.empty(component.size, dtype=np.int64)
    n_out = 0
    for goal in dests:
        distance[goal] = 0
        front[0] = goal
        read, written = 0, 1
        while read < written:
            node = front[read]
            read += 1
            for i in range(in_start[node], in_start[node + 1]):
                link = by_dst[i]
                before = src[link]
                if not alive[link]:
                    continue
                if distance[before] < 0:
                    distance[before] = distance[node] + 1
                    front[written] = before
                    written += 1
                elif distance[before] != distance[node] + 1:
                    continue
                if chosen[before] < 0 or src_port[link] < src_port[chosen[before]]:
                    chosen[before] = link
        group = component[goal]
        for i in range(member_start[group], member_start[group + 1]):
            node = members[i]
            if node != goal:
                out_node[n_out] = node
                out_dest[n_out] = goal
                out_link[n_out] = chosen[node]
                n_out += 1
            distance[node] = -1
            chosen[node] = -1
