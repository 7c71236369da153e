"""Wiring of one process: the nodes and links of its cells, and an interface for each group of patches.

A group is a set of patches that bridges join into one network; most are a single patch. The nodes of a group
are consecutive: the cells of its patches, then its interface, whose ports are the gateways of its patches.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.network import NetworkSpec
from skinnet.network.packet_network import PacketNetwork
from skinnet.network.topology import UNBOUNDED, Topology
from skinnet.random_streams import StreamName, stream_key
from skinnet.skin.lattice import N_PORTS
from skinnet.skin.placement import Bridge, PlacedPatch
from skinnet.skin.whole_skin import WholeSkin, join_patches

__all__ = ["Wiring", "wire_cells"]

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Wiring:
    """Wiring of the cells of a process: indices of cells, nodes, groups and links.

    Attributes:
        skin: Patches, group after group, with the bridges between them; indices are those of the process.
        first_patch: (g + 1,) index of the first patch of each group, then the number of patches.
        group_ports: (g,) number of ports of each group's interface.
        gateway_port: (p,) first port of each patch's gateways at its group's interface.
        interface_node: (g,) node of each group's interface.
        node_of_cell: (cells,) node of each cell.
        uid_of_cell: (cells,) hardware ID: index of a cell within its group.
        group_of_node: (nodes,) group of each node.
        link_out: (nodes, ports) link that leaves a node by a port, −1 for none.
        topology: Nodes and links for the kernel.
    """

    skin: WholeSkin
    first_patch: Ints
    group_ports: list[int]
    gateway_port: Ints
    interface_node: Ints
    node_of_cell: Ints
    uid_of_cell: Ints
    group_of_node: Ints
    link_out: Ints
    topology: Topology

    @property
    def n_cells(self) -> int:
        """Number of cells of all patches."""
        return self.skin.n_cells

    @property
    def patches(self) -> tuple[PlacedPatch, ...]:
        """Placed patches, group after group."""
        return self.skin.patches

    @property
    def first_cell(self) -> Ints:
        """Index of the first cell of each patch, then the number of cells, (p + 1,)."""
        return self.skin.first_cell

    @property
    def patch_of_cell(self) -> Ints:
        """Patch of each cell, (cells,)."""
        return self.skin.patch_of_cell

    @property
    def group_of_patch(self) -> Ints:
        """Group of each patch, (p,)."""
        return np.repeat(np.arange(len(self.group_ports)), np.diff(self.first_patch))

    def packet_network(self, seed: int) -> PacketNetwork:
        """Return the packet kernel over these nodes; random streams belong to nodes, not to the process."""
        keys = []
        for first, last in pairwise(self.first_patch.tolist()):
            group = self.patches[first:last]
            keys += [
                stream_key(seed, StreamName.NODE, patch.name, i)
                for patch in group
                for i in range(patch.n_cells)
            ]
            keys.append(stream_key(seed, StreamName.NODE, group[0].name, group[0].n_cells))
        return PacketNetwork(self.topology, seed=seed, node_keys=np.array(keys, dtype=np.uint64))


def wire_cells(
    groups: Sequence[Sequence[PlacedPatch]], spec: NetworkSpec, bridges: Sequence[Bridge] = ()
) -> Wiring:
    """Index and wire the cells of groups of patches, with equal links.

    Args:
        groups: Groups of patches that bridges join.
        spec: Specification of the links.
        bridges: Wires between patches; those to patches outside `groups` are ignored.
    """
    patches = tuple(patch for group in groups for patch in group)
    names = {patch.name for patch in patches}
    skin = join_patches(patches, [b for b in bridges if b.a_patch in names and b.b_patch in names])
    first_cell, patch_of_cell, n_cells = skin.first_cell, skin.patch_of_cell, skin.n_cells
    first_patch = np.concatenate([[0], np.cumsum([len(group) for group in groups])]).astype(np.int64)
    group_of_patch = np.repeat(np.arange(len(groups)), np.diff(first_patch))
    node_of_cell = np.arange(n_cells) + group_of_patch[patch_of_cell]
    first_node = np.append(node_of_cell[first_cell[first_patch[:-1]]], n_cells + len(groups))
    interface = first_node[1:] - 1

    links = skin.wires.copy()
    links[:, [0, 2]] = node_of_cell[skin.wires[:, [0, 2]]]
    gateway_port = np.zeros(len(patches), dtype=np.int64)
    group_ports, wires = [], [links]
    for g, (first, last) in enumerate(pairwise(first_patch.tolist())):
        ports = 0
        for p in range(first, last):
            ends, gateway_port[p] = patches[p].interfaces, ports
            numbers = ports + np.arange(len(ends))
            node = node_of_cell[first_cell[p] + ends[:, 0]]
            wires.append(np.column_stack([np.full(len(ends), interface[g]), numbers, node, ends[:, 1]]))
            ports += len(ends)
        group_ports.append(ports)
    topology = _topology(np.vstack(wires), int(first_node[-1]), interface, spec)
    n_ports = max(N_PORTS, int(topology.src_port.max()) + 1)  # a cell sends on all of its ports, wired or not
    link_out = np.full((topology.n_nodes, n_ports), -1, dtype=np.int64)
    link_out[topology.src, topology.src_port] = np.arange(topology.n_links)
    uid_of_cell = np.arange(n_cells) - first_cell[first_patch[group_of_patch[patch_of_cell]]]
    return Wiring(
        skin=skin,
        first_patch=first_patch,
        group_ports=group_ports,
        gateway_port=gateway_port,
        interface_node=interface,
        node_of_cell=node_of_cell,
        uid_of_cell=uid_of_cell,
        group_of_node=np.repeat(np.arange(len(groups)), np.diff(first_node)),
        link_out=link_out,
        topology=topology,
    )


def _topology(wires: Ints, n_nodes: int, interface: Ints, spec: NetworkSpec) -> Topology:
    return Topology.from_wires(
        n_nodes,
        wires,
        bits_per_s=spec.bits_per_s,
        bits_per_byte=spec.bits_per_byte,
        delay_ns=round(spec.hop_delay_us * 1e3),
        queue_packets=_queue_capacities(wires, interface, spec.queue_packets),
        loss_probability=spec.loss,
        jitter_ns=round(spec.jitter_us * 1e3),
    )


def _queue_capacities(wires: Ints, interface: Ints, queue_packets: int) -> Ints:
    """Return the queue capacity of every link: a cell's, or unbounded if the computer sends (assumed)."""
    sender = wires[:, [0, 2]].ravel()
    return np.where(np.isin(sender, interface), UNBOUNDED, queue_packets)
