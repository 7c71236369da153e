"""What the computer knows of the network: the forest of its cells, and their neighbours."""

from dataclasses import dataclass, field, replace

from cells.formation_packets import is_newer
from skinnet.errors import ProtocolError
from skinnet.messages import Topology
from skinnet.skin.lattice import N_PORTS

__all__ = ["Forest", "Member"]


@dataclass
class Member:
    """One cell, as it has reported.

    Attributes:
        uid: Its hardware number.
        gateway: Port of the gateway that its tree hangs on.
        master_port: Its port towards the gateway.
        parent: ID of the node there, 0 for the computer.
        hops: Hops to the gateway, from 1.
        neighbours: IDs at its ports, 0 where there is no cell.
    """

    uid: int
    gateway: int = -1
    master_port: int = -1
    parent: int = 0
    hops: int = 0
    neighbours: list[int] = field(default_factory=lambda: [0] * N_PORTS)


class Forest:
    """All cells that the computer has ever heard of, by ID, and which of them are in the network now.

    Attributes:
        members: The cells by ID.
        joined: IDs of those that are in the network.
        told_in: Epoch in which a cell last told of its neighbours, by (ID, first of two ports).
    """

    def __init__(self) -> None:
        self.told_in: dict[tuple[int, int], int] = {}
        self.members: dict[int, Member] = {}
        self.joined: set[int] = set()

    def id_of(self, uid: int) -> int:
        """ID of the cell with a hardware number: its own from before, or the next that is free."""
        known = next((i for i, member in self.members.items() if member.uid == uid), None)
        if known is not None:
            return known
        network_id = max(self.members, default=0) + 1
        self.members[network_id] = Member(uid)
        return network_id

    def join(self, network_id: int, gateway: int, master_port: int, parent: int, hops: int) -> bool:
        """A cell says where it is now; returns whether that is news."""
        member = self.members[network_id]
        now = replace(member, gateway=gateway, master_port=master_port, parent=parent, hops=hops)
        is_news = now != member or network_id not in self.joined
        self.members[network_id] = now
        self.joined.add(network_id)
        return is_news

    def tell(self, network_id: int, port: int, pair: list[int], epoch: int) -> bool:
        """A cell says which IDs are at two of its ports; returns whether that is news.

        What it said in an earlier epoch may come later, by another way, and is no longer true.
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
        """The message of one patch, whose cells have the hardware numbers from `first` on.

        Cells that are not in the network have ID 0, depth 0, and −1 elsewhere.

        Raises:
            ProtocolError: hardware numbers that repeat.
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
        """Number in the patch of the cell with an ID; −1 for none, or one of another patch."""
        if network_id not in self.joined:
            return -1
        cell = self.members[network_id].uid - first
        return cell if 0 <= cell < n_cells else -1
