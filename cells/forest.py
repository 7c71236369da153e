"""Routing forest of cells and their neighbours, as reported to the computer."""

from dataclasses import dataclass, field, replace

from cells.formation_packets import is_newer
from skinnet.errors import ProtocolError
from skinnet.messages import Topology
from skinnet.skin.lattice import N_PORTS

__all__ = ["Forest", "Member"]


@dataclass
class Member:
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


class Forest:
    """Forest of all cells that have ever reported, by network ID, and the set of those now in the network.

    Attributes:
        members: Cells by network ID.
        joined: Network IDs of the cells that are in the network now.
        told_in: Epoch of a cell's last LINKS report, by (network ID, first of two ports).
    """

    def __init__(self) -> None:
        self.told_in: dict[tuple[int, int], int] = {}
        self.members: dict[int, Member] = {}
        self.joined: set[int] = set()

    def id_of(self, uid: int) -> int:
        """Return the network ID of the cell with hardware ID `uid`; assign the next free one if it is new."""
        known = next((i for i, member in self.members.items() if member.uid == uid), None)
        if known is not None:
            return known
        network_id = max(self.members, default=0) + 1
        self.members[network_id] = Member(uid)
        return network_id

    def join(self, network_id: int, gateway: int, master_port: int, parent: int, hops: int) -> bool:
        """Record the position in the forest that a cell reports (JOINED); return True if it is new."""
        member = self.members[network_id]
        now = replace(member, gateway=gateway, master_port=master_port, parent=parent, hops=hops)
        is_news = now != member or network_id not in self.joined
        self.members[network_id] = now
        self.joined.add(network_id)
        return is_news

    def tell(self, network_id: int, port: int, pair: list[int], epoch: int) -> bool:
        """Record the neighbours that a cell reports at two of its ports (LINKS); return True if they are new.

        Reports of an earlier epoch may arrive late, over another route; they are stale and ignored.
        """
        last = self.told_in.get((network_id, port))
        if epoch != last and not is_newer(epoch, last):
            return False
        self.told_in[network_id, port] = epoch
        neighbours = self.members[network_id].neighbours
        is_news = neighbours[port : port + 2] != pair
        neighbours[port : port + 2] = pair
        return is_news

    def topology(self, patch: str, first: int, n_cells: int, version: int, t_ns: int) -> Topology:
        """Return the topology message of one patch, whose cells have consecutive hardware IDs from `first`.

        Cells that are not in the network have network ID 0, depth 0, and −1 elsewhere.

        Raises:
            ProtocolError: duplicate hardware IDs.
        """
        by_uid = {self.members[i].uid: i for i in self.joined}
        if len(by_uid) < len(self.joined):
            raise ProtocolError(f"patch {patch}: hardware numbers of cells repeat")
        ids = [by_uid.get(first + cell, 0) for cell in range(n_cells)]
        absent = Member(-1)
        rows = [self.members.get(i, absent) for i in ids]
        return Topology(
            patch=patch,
            version=version,
            t_ns=t_ns,
            network_id=ids,
            gateway=[row.gateway for row in rows],
            master_port=[row.master_port for row in rows],
            parent=[self._cell(row.parent, first, n_cells) for row in rows],
            depth=[row.hops for row in rows],
            neighbours=[[self._cell(i, first, n_cells) for i in row.neighbours] for row in rows],
            bridged=[
                [cell, port, self.members[i].uid]
                for cell, row in enumerate(rows)
                for port, i in enumerate(row.neighbours)
                if i in self.joined and self._cell(i, first, n_cells) < 0
            ],
        )

    def _cell(self, network_id: int, first: int, n_cells: int) -> int:
        """Return the index within the patch of the cell with a network ID; −1 if it is not in the patch."""
        if network_id not in self.joined:
            return -1
        cell = self.members[network_id].uid - first
        return cell if 0 <= cell < n_cells else -1
