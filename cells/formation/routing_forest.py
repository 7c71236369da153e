"""Routing forest of cells and their neighbours, as reported to the computer."""

from dataclasses import dataclass, field, replace

from cells.formation.packets import is_newer
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import Topology
from skinnet.skin.lattice import N_PORTS

__all__ = ["ForestNode", "RoutingForest"]


@dataclass
class ForestNode:
    """Forest node of one cell, as the cell has reported it.

    Attributes:
        uid: Hardware ID of the cell.
        gateway: Gateway port at the root of its tree.
        master_port: Port towards the gateway.
        parent: Network ID of the node there, 0 for the computer.
        hops: Hops to the gateway, from 1.
        neighbours: Network IDs at its ports, 0 where there is no cell.
    """

    uid: int
    gateway: int = -1
    master_port: int = -1
    parent: int = 0
    hops: int = 0
    neighbours: list[int] = field(default_factory=lambda: [0] * N_PORTS)


class RoutingForest:
    """Forest of all cells that have ever reported, by network ID, and the set of those now in the network.

    Attributes:
        nodes: Cells by network ID.
        joined: Network IDs of the cells that are in the network now.
        neighbours_epoch: Epoch of a cell's last LINKS report, by (network ID, first of two ports).
    """

    def __init__(self) -> None:
        self.neighbours_epoch: dict[tuple[int, int], int] = {}
        self.nodes: dict[int, ForestNode] = {}
        self.joined: set[int] = set()

    def joined_uids(self) -> frozenset[int]:
        """Hardware IDs of the cells that are in the network."""
        return frozenset(self.nodes[i].uid for i in self.joined)

    def depth(self) -> int:
        """Maximum number of hops from a cell in the network to its gateway, 0 without cells."""
        return max((self.nodes[i].hops for i in self.joined), default=0)

    def assign_id(self, uid: int) -> int:
        """Return the network ID of the cell with hardware ID `uid`; assign the next free one if it is new."""
        known = next((i for i, member in self.nodes.items() if member.uid == uid), None)
        if known is not None:
            return known
        network_id = max(self.nodes, default=0) + 1
        self.nodes[network_id] = ForestNode(uid)
        return network_id

    def record_joined(self, network_id: int, gateway: int, master_port: int, parent: int, hops: int) -> bool:
        """Record the position in the forest that a cell reports (JOINED); return True if it is new."""
        member = self.nodes[network_id]
        now = replace(member, gateway=gateway, master_port=master_port, parent=parent, hops=hops)
        is_news = now != member or network_id not in self.joined
        self.nodes[network_id] = now
        self.joined.add(network_id)
        return is_news

    def record_neighbours(self, network_id: int, port: int, reported_ids: list[int], epoch: int) -> bool:
        """Record the neighbours that a cell reports at two of its ports (LINKS); return True if they are new.

        Reports of an earlier epoch may arrive late, over another route; they are stale and ignored.
        """
        last = self.neighbours_epoch.get((network_id, port))
        if epoch != last and not is_newer(epoch, last):
            return False
        self.neighbours_epoch[network_id, port] = epoch
        neighbours = self.nodes[network_id].neighbours
        is_news = neighbours[port : port + 2] != reported_ids
        neighbours[port : port + 2] = reported_ids
        return is_news

    def topology_message(self, patch: str, first_uid: int, n_cells: int, version: int, t_ns: int) -> Topology:
        """Return the topology message of one patch, with consecutive hardware IDs from `first_uid`.

        Cells that are not in the network have network ID 0, depth 0, and −1 elsewhere.

        Raises:
            ProtocolError: duplicate hardware IDs.
        """
        by_uid = {self.nodes[i].uid: i for i in self.joined}
        if len(by_uid) < len(self.joined):
            raise ProtocolError(f"patch {patch}: duplicate hardware IDs of cells")
        ids = [by_uid.get(first_uid + cell, 0) for cell in range(n_cells)]
        absent = ForestNode(-1)
        rows = [self.nodes.get(i, absent) for i in ids]
        return Topology(
            patch=patch,
            version=version,
            t_ns=t_ns,
            network_id=ids,
            gateway=[row.gateway for row in rows],
            master_port=[row.master_port for row in rows],
            parent=[self._cell_index(row.parent, first_uid, n_cells) for row in rows],
            depth=[row.hops for row in rows],
            neighbours=[[self._cell_index(i, first_uid, n_cells) for i in row.neighbours] for row in rows],
            bridged_neighbours=[
                [cell, port, self.nodes[i].uid]
                for cell, row in enumerate(rows)
                for port, i in enumerate(row.neighbours)
                if i in self.joined and self._cell_index(i, first_uid, n_cells) < 0
            ],
        )

    def _cell_index(self, network_id: int, first_uid: int, n_cells: int) -> int:
        """Return the index within the patch of the cell with a network ID; −1 if it is not in the patch."""
        if network_id not in self.joined:
            return -1
        cell = self.nodes[network_id].uid - first_uid
        return cell if 0 <= cell < n_cells else -1
