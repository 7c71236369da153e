"""A cell's part in forming the network [UCD]: a state machine without I/O.

Four phases follow a sync of a new epoch, which resets the cell:

1. Sync: HELLO floods; after the handshake's time each cell knows its working links.
2. Exploration: the first EXPLORE to arrive sets the master port and goes on over all other working links.
   Tokens that meet on a link reject each other; a cell whose links have all answered sends DONE with the
   size of its tree to its master (the echo algorithm of Chang, 1982), so the gateway learns when the
   forest is complete, and its size, with no other knowledge.
3. Identity: IDs are handed down depth first; the interval below each port is the routing table.
4. Neighbours: IDs are exchanged over all working links. COLLECT walks the tree depth first, so one cell at
   a time reports to the computer: reports do not pile up before the gateway's link, whatever its queue.

Whoever drives a cell delivers packets at their times and, at one instant, in the order of ports. The first
call wins a tie. Packets may be lost: the formation then halts, and the gateway starts another epoch.
"""

from cells.formation_packets import (
    ID_BITS,
    REPORTS_PER_CELL,
    FormationPacket,
    Handshake,
    Kind,
    Sends,
    is_newer,
)
from skinnet.skin.lattice import N_PORTS

__all__ = ["CellFormation"]


class CellFormation:
    """One cell while the network forms, and what it has found out.

    Attributes:
        uid: Hardware number of the cell.
        epoch: Formation that the cell takes part in; None before the first.
        master_port: Port towards the gateway; None while unreached.
        network_id: ID of the cell; 0 while it has none.
        ignored: Packets of other epochs, or out of turn, that were dropped.
    """

    def __init__(self, uid: int, handshake_ns: int) -> None:
        """A cell that waits `handshake_ns` for its neighbours to answer (see `handshake_ns`)."""
        self.uid = uid
        self.epoch: int | None = None
        self.ignored = 0
        self._handshake_ns = handshake_ns
        self._reset()

    def _reset(self) -> None:
        self.master_port: int | None = None
        self.network_id = 0
        self._links = Handshake(N_PORTS)
        self._settled_ns: int | None = None
        self._early_tokens: list[int] = []
        self._unanswered: set[int] = set()
        self._tree_size = [0] * N_PORTS
        self._first_below = [0] * N_PORTS
        self._neighbour: list[int | None] = [None] * N_PORTS
        self._my_turn = False
        self._to_collect: list[int] = []
        self._expected_reports = 0

    def next_deadline(self) -> int | None:
        """When `on_deadline` is to be called [ns], if at all."""
        return self._settled_ns

    def next_port(self, network_id: int) -> int | None:
        """Port towards the cell `network_id` (0: the computer); None if it is this cell."""
        if network_id == self.network_id:
            return None
        for port, first in enumerate(self._first_below):
            if first <= network_id < first + self._tree_size[port]:
                return port
        return self.master_port

    def handle(self, packet: FormationPacket, port: int, t_ns: int) -> Sends:
        """What to send when `packet` arrives on `port`."""
        if packet.epoch != self.epoch:
            if packet.kind != Kind.HELLO or not is_newer(packet.epoch, self.epoch):
                self.ignored += 1
                return []
            self._reset()
            self.epoch = packet.epoch
            self._settled_ns = t_ns + self._handshake_ns
            return self._links.greet(packet.epoch, heard_on=port)
        sends = self.on_deadline(t_ns)  # a deadline that is due comes before the packet
        match packet.kind:
            case Kind.UNIT | Kind.LINKS:
                sends += self._on_report(packet, port)
            case Kind.HELLO:
                sends += self._links.hear(packet, port)
            case Kind.EXPLORE:
                sends += self._on_explore(port)
            case Kind.DONE:
                sends += self._on_done(packet.value, port)
            case Kind.ASSIGN:
                sends += self._on_assign(packet.cell, port)
            case Kind.IDENTITY:
                sends += self._on_identity(packet.cell, port)
            case Kind.COLLECT:
                sends += self._on_collect(port)
        return sends

    def on_deadline(self, t_ns: int) -> Sends:
        """What to send when the handshake's time is over; nothing before."""
        if self._settled_ns is None or t_ns < self._settled_ns:
            return []
        self._settled_ns = None
        return [send for port in self._early_tokens for send in self._on_explore(port)]

    def _packet(self, kind: Kind, cell: int = 0, port: int = 0, value: int = 0) -> FormationPacket:
        assert self.epoch is not None
        return FormationPacket(kind, self.epoch, cell, port, value)

    def _to_master(self, packet: FormationPacket) -> Sends:
        assert self.master_port is not None
        return [(self.master_port, packet)]

    def _on_explore(self, port: int) -> Sends:
        if self._settled_ns is not None:
            self._early_tokens.append(port)
            return []
        token = self._packet(Kind.EXPLORE)
        self._links.up[port] = True  # a token proves the link, even if our last answer to HELLO was lost
        if self.master_port is None:
            self.master_port = port
            others = [other for other in self._links.ports_up() if other != port]
            self._unanswered = set(others)
            return [(other, token) for other in others] + self._echo()
        if port in self._unanswered:
            self._unanswered.remove(port)
            return self._echo()
        return [(port, token)]

    def _on_done(self, tree_size: int, port: int) -> Sends:
        if port not in self._unanswered:
            return self._out_of_turn()
        self._unanswered.remove(port)
        self._tree_size[port] = tree_size
        return self._echo()

    def _echo(self) -> Sends:
        if self._unanswered:
            return []
        return self._to_master(self._packet(Kind.DONE, value=1 + sum(self._tree_size)))

    def _on_assign(self, network_id: int, port: int) -> Sends:
        if port != self.master_port or self.network_id:
            return self._out_of_turn()
        self.network_id = network_id
        sends: Sends = []
        first = network_id + 1
        for child in self._children():
            self._first_below[child] = first
            sends.append((child, self._packet(Kind.ASSIGN, cell=first)))
            first += self._tree_size[child]
        links = self._links.ports_up()
        return sends + [(link, self._packet(Kind.IDENTITY, cell=network_id, port=link)) for link in links]

    def _on_identity(self, network_id: int, port: int) -> Sends:
        self._neighbour[port] = network_id
        return self._report()

    def _on_collect(self, port: int) -> Sends:
        if port != self.master_port or not self.network_id:
            return self._out_of_turn()
        self._my_turn = True
        return self._report()

    def _report(self) -> Sends:
        """This cell's reports, once it is its turn and its neighbours are known, then its child's turn."""
        neighbours = self._neighbour
        if not self._my_turn or any(neighbours[link] is None for link in self._links.ports_up()):
            return []
        self._my_turn = False
        assert self.master_port is not None
        sends = self._to_master(self._packet(Kind.UNIT, self.network_id, self.master_port, self.uid))
        for port in range(0, N_PORTS, 2):
            pair = (neighbours[port] or 0) | (neighbours[port + 1] or 0) << ID_BITS
            sends += self._to_master(self._packet(Kind.LINKS, self.network_id, port, pair))
        self._to_collect = self._children()
        return sends + self._collect_next()

    def _collect_next(self) -> Sends:
        if not self._to_collect:
            return []
        child = self._to_collect[0]
        self._expected_reports = REPORTS_PER_CELL * self._tree_size[child]
        return [(child, self._packet(Kind.COLLECT))]

    def _on_report(self, packet: FormationPacket, port: int) -> Sends:
        if not self._to_collect or port != self._to_collect[0]:
            return self._out_of_turn()
        self._expected_reports -= 1
        sends = self._to_master(packet)
        if self._expected_reports == 0:
            self._to_collect.pop(0)
            sends += self._collect_next()
        return sends

    def _children(self) -> list[int]:
        return [port for port, size in enumerate(self._tree_size) if size]

    def _out_of_turn(self) -> Sends:
        self.ignored += 1
        return []
