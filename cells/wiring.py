"""The nodes and links of one host: every cell of its patches, and an interface node for each patch.

A patch's nodes follow one another: its cells, then its interface, whose ports are the patch's gateways.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.schema import NetworkSpec
from skinnet.network.network import Network
from skinnet.network.topology import UNBOUNDED, Topology
from skinnet.seeding import key_of
from skinnet.skin.lattice import N_PORTS
from skinnet.skin.placement import PlacedPatch

__all__ = ["Wiring", "wire"]


@dataclass(frozen=True)
class Wiring:
    """How the cells of a host are numbered and wired.

    Attributes:
        patches: The patches, in order.
        first_cell: (p + 1,) host-wide number of the first cell of each patch, then of all cells.
        first_node: (p + 1,) node of the first cell of each patch, then of all nodes.
        interface: (p,) node of each patch's interface.
        node_of_cell: (cells,) node of each cell.
        patch_of_node: (nodes,) patch of each node.
        link_out: (nodes, ports) link that leaves a node by a port, −1 for none.
        topology: Nodes and links for the kernel.
    """

    patches: tuple[PlacedPatch, ...]
    first_cell: NDArray[np.int64]
    first_node: NDArray[np.int64]
    interface: NDArray[np.int64]
    node_of_cell: NDArray[np.int64]
    patch_of_node: NDArray[np.int64]
    link_out: NDArray[np.int64]
    topology: Topology

    @property
    def n_cells(self) -> int:
        """Cells of all patches."""
        return int(self.first_cell[-1])

    def cell_of_node(self, node: int) -> int:
        """Host-wide number of the cell at `node`."""
        return node - int(self.patch_of_node[node])

    def network(self, seed: int) -> Network:
        """The kernel over these nodes; its random draws belong to the nodes, not to their host."""
        keys = [
            key_of(seed, "node", patch.name, i) for patch in self.patches for i in range(patch.n_cells + 1)
        ]
        return Network(self.topology, seed=seed, node_keys=np.array(keys, dtype=np.uint64))


def wire(patches: tuple[PlacedPatch, ...], spec: NetworkSpec) -> Wiring:
    """Numbers and wires the cells of `patches`, with equal links."""
    sizes = np.array([patch.n_cells for patch in patches], dtype=np.int64)
    first_cell = np.concatenate([[0], np.cumsum(sizes)])
    first_node = np.concatenate([[0], np.cumsum(sizes + 1)])
    interface = first_node[1:] - 1
    wires = []
    for index, patch in enumerate(patches):
        base = first_node[index]
        wires.append(patch.wires + np.array([base, 0, base, 0]))
        gateways = np.arange(len(patch.interfaces))
        ends = patch.interfaces + np.array([base, 0])
        wires.append(np.column_stack([np.full(len(ends), interface[index]), gateways, ends]))
    links = np.vstack(wires)
    topology = Topology.from_wires(
        int(first_node[-1]),
        links,
        bits_per_s=spec.bits_per_s,
        bits_per_byte=spec.bits_per_byte,
        delay_ns=round(spec.hop_delay_us * 1e3),
        queue_packets=_queues(links, interface, spec.queue_packets),
        jitter_ns=round(spec.jitter_us * 1e3),
    )
    n_ports = max(N_PORTS, int(topology.src_port.max()) + 1)  # a cell sends on all of its ports, wired or not
    link_out = np.full((topology.n_nodes, n_ports), -1, dtype=np.int64)
    link_out[topology.src, topology.src_port] = np.arange(topology.n_links)
    node_of_cell = np.concatenate([np.arange(n) + first_node[i] for i, n in enumerate(sizes)])
    patch_of_node = np.repeat(np.arange(len(patches)), sizes + 1)
    return Wiring(patches, first_cell, first_node, interface, node_of_cell, patch_of_node, link_out, topology)


def _queues(wires: NDArray[np.int64], interface: NDArray[np.int64], queue_packets: int) -> NDArray[np.int64]:
    """Room on every link: what a cell has, but no bound where the sender is a computer (assumed)."""
    sender = wires[:, [0, 2]].ravel()
    return np.where(np.isin(sender, interface), UNBOUNDED, queue_packets)
