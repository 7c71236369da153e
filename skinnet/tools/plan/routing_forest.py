"""Routing forest to the gateways, as the cells will form it.

Tokens start at all gateways at once and take equally long over every link; a cell routes to the computer by
the port of the first token, the lowest port if several arrive at one instant. So every cell has a route of
fewest hops, which is computed here without running the protocol.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.network.routes import NO_LINK, min_hop_routes
from skinnet.network.topology import Topology

__all__ = ["GATEWAY", "UNREACHED", "RoutingForest", "compute_forest"]

GATEWAY = -1
UNREACHED = -2


@dataclass(frozen=True)
class RoutingForest:
    """Routing forest of the cells; each cell has one uplink, so a link has the index of its cell.

    Attributes:
        parent: (n,) next cell towards the gateway, `GATEWAY`, or `UNREACHED` for a cell without a route.
        port: (n,) port by which a cell sends; −1 for none.
        gateway: (n,) index of the gateway; −1 for none.
        depth: (n,) hops to the gateway, from 1; 0 for a cell without a route.
    """

    parent: NDArray[np.int64]
    port: NDArray[np.int64]
    gateway: NDArray[np.int64]
    depth: NDArray[np.int64]

    @cached_property
    def cells_by_depth(self) -> list[NDArray[np.int64]]:
        """Cells by depth: those of depth 1, of depth 2, and so on."""
        return [np.flatnonzero(self.depth == depth) for depth in range(1, int(self.depth.max(initial=0)) + 1)]

    @cached_property
    def subtree_size(self) -> NDArray[np.int64]:
        """Subtree sizes (n,): cells whose packets go over a cell's link, the cell included."""
        return self.subtree_sums((self.depth > 0).astype(np.int64))

    @cached_property
    def tree_size(self) -> NDArray[np.int64]:
        """Tree sizes (n,): cells that share the gateway of each cell."""
        size = np.bincount(self.gateway[self.gateway >= 0], minlength=1)
        return np.where(self.gateway >= 0, size[np.maximum(self.gateway, 0)], 0)

    def subtree_sums(self, values: NDArray[np.int64]) -> NDArray[np.int64]:
        """Sum `values` (n,) over each cell and all cells that send through it."""
        total = values.copy()
        for level in self.cells_by_depth[:0:-1]:
            np.add.at(total, self.parent[level], total[level])
        return total

    def route_sums(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum `values` (n,) over the links of each cell's route to the gateway."""
        total = values.copy()
        for level in self.cells_by_depth[1:]:
            total[level] += total[self.parent[level]]
        return total


def compute_forest(n_cells: int, wires: ArrayLike, gateways: ArrayLike) -> RoutingForest:
    """Compute the routing forest of cells with `wires` (m, 4) and gateway ports `gateways` (g, 2)."""
    ends = np.asarray(wires, dtype=np.int64).reshape(-1, 4)
    roots = np.asarray(gateways, dtype=np.int64).reshape(-1, 2)
    computer = np.column_stack([np.full(len(roots), n_cells), np.arange(len(roots)), roots])
    topology = Topology.from_wires(
        n_cells + 1, np.vstack([ends, computer]), bits_per_s=1_000_000, bits_per_byte=10
    )
    routes = min_hop_routes(topology, [n_cells])
    leads = routes.link != NO_LINK
    cell, link = routes.node[leads], routes.link[leads]
    parent = np.full(n_cells, UNREACHED, dtype=np.int64)
    port, gateway, depth = (np.full(n_cells, fill, dtype=np.int64) for fill in (-1, -1, 0))
    parent[cell] = np.where(topology.dst[link] == n_cells, GATEWAY, topology.dst[link])
    port[cell] = topology.src_port[link]
    top = parent[cell] == GATEWAY
    gateway[cell[top]] = topology.dst_port[link[top]]
    depth[cell[top]] = 1
    level = cell[top]
    while len(level):
        level = np.flatnonzero(np.isin(parent, level))
        gateway[level], depth[level] = gateway[parent[level]], depth[parent[level]] + 1
    return RoutingForest(parent, port, gateway, depth)
