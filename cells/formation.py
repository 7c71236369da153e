"""Network formation and maintenance by a cell [UCD]: a state machine without I/O.

The gateway starts an *epoch*. The first is *cold*: no cell has a network ID.

1. Exploration: the first EXPLORE to arrive sets the master port and is flooded over all other links. Tokens
   that cross on a link reject each other; a cell whose links have all answered sends DONE with the size of
   its subtree to its master (the echo algorithm of Chang, 1982), so the gateway detects termination.
2. Identity: network IDs are assigned depth first.
3. Neighbours: IDs are exchanged over all links. COLLECT traverses the tree depth first, so one cell at a time
   reports to the computer: the queue of the gateway's link cannot overflow.

A node that detects that a link has come up or gone down reports it to the gateway (CHANGE), which starts a
*warm* epoch: cells keep their IDs. Each cell that finds its new master reports upwards at once (JOINED), from
which the nodes on the path learn the route to it (backward learning); then it reports its neighbours (LINKS).
Losses in an earlier epoch therefore do no harm. A cell without ID requests one (NEWCOMER) through its
neighbour.

The driver delivers packets at their arrival times and, at equal times, in the order of ports; the first call
wins a tie. The links below (`LinkLayer`) deliver packets reliably and in order.
"""

from cells.formation_packets import ID_BITS, REPORTS_PER_CELL, FormationPacket, Kind, Sends, is_newer
from cells.link_layer import LinkLayer
from cells.neighbourhood import Neighbourhood
from skinnet.skin.lattice import N_PORTS

__all__ = ["CellFormation"]


class CellFormation:
    """Formation agent of one cell: its position in the tree, its ID, routes and neighbours.

    Attributes:
        uid: Hardware ID of the cell.
        epoch: Current epoch; None before the first.
        master_port: Port towards the gateway; None while unreached.
        network_id: Network ID of the cell; 0 while it has none.
        joined_ns: Time at which the cell found its present master [ns].
        route_changes: New routes: (network ID or 0 for the computer, port); the reader empties the list.
        ignored: Number of packets that were dropped as stale or unexpected.
    """

    def __init__(self, uid: int, resend_ns: int, life: int = 0) -> None:
        """Create the agent of a cell that is switched on, with no carrier at any port.

        Args:
            uid: Hardware ID.
            resend_ns: Retransmission timeout of a link [ns].
            life: Number of earlier power-ups.
        """
        self.uid = uid
        self.links = LinkLayer(N_PORTS, resend_ns, life)
        self.epoch: int | None = None
        self.network_id = 0
        self.master_port: int | None = None
        self.joined_ns: int | None = None
        self.route_changes: list[tuple[int, int]] = []
        self.ignored = 0
        self._routes: dict[int, int] = {}
        self._warm = False
        self._hops = 0
        self._neighbours = Neighbourhood()
        self._newcomers: list[tuple[int, int]] = []
        self._begin_epoch()

    def _begin_epoch(self) -> None:
        self._unanswered: set[int] = set()
        self._tree_size = [0] * N_PORTS
        self._my_turn = False
        self._to_collect: list[int] = []
        self._expected_reports = 0

    def next_deadline(self) -> int | None:
        """Return the deadline [ns] at which `on_deadline` is to be called; None if there is none."""
        return self.links.next_deadline()

    def next_port(self, network_id: int) -> int | None:
        """Return the port towards the cell `network_id` (0: the computer); None if it is this cell."""
        return None if network_id == self.network_id else self._routes.get(network_id, self.master_port)

    def set_carrier(self, port: int, present: bool, t_ns: int) -> Sends:
        """Process a change of carrier at a port; return the packets to send."""
        self.links.set_carrier(port, present, t_ns)
        return self._after(t_ns)

    def on_deadline(self, t_ns: int) -> Sends:
        """Process expired timers; return the packets to send."""
        self.links.on_deadline(t_ns)
        return self._after(t_ns)

    def handle(self, packet: FormationPacket, port: int, t_ns: int) -> Sends:
        """Process a packet that arrives on `port`; return the packets to send."""
        new = self.links.receive(port, packet, t_ns)
        if new is not None:
            self._dispatch(new, port, t_ns)
        return self._after(t_ns)

    def _dispatch(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        match packet.kind:
            case Kind.EXPLORE:
                self._on_explore(packet, port, t_ns)
            case Kind.IDENTITY:
                self._on_identity(packet, port, t_ns)
            case Kind.LINKS if self._warm or packet.epoch != self.epoch:
                self._up(packet, t_ns)
            case Kind.CHANGE:
                self._up(packet, t_ns)
            case Kind.NEWCOMER:
                self._on_newcomer(packet, port, t_ns)
            case Kind.ADOPT:
                self._on_adopt(packet, t_ns)
            case _ if packet.epoch != self.epoch:
                self.ignored += 1
            case Kind.DONE:
                self._on_done(packet.value, port, t_ns)
            case Kind.ASSIGN:
                self._on_assign(packet.cell, port, t_ns)
            case Kind.COLLECT:
                self._on_collect(port, t_ns)
            case Kind.UNIT | Kind.LINKS:
                self._on_report(packet, port, t_ns)
            case Kind.JOINED:
                self._learn(packet.cell, port)
                self._up(packet, t_ns)
            case _:
                self.ignored += 1

    def _after(self, t_ns: int) -> Sends:
        """Process pending link changes; return all packets to send."""
        links = self.links
        while links.changes:
            port, is_up = links.changes.pop(0)
            if is_up:
                self._on_link_up(port, t_ns)
            else:
                self._on_link_down(port, t_ns)
        sends, links.out = links.out, []
        return sends

    # link changes

    def _on_link_up(self, port: int, t_ns: int) -> None:
        if self.network_id:
            self._send(port, self._identity(), t_ns)
        self._tell_change(port, True, t_ns)

    def _on_link_down(self, port: int, t_ns: int) -> None:
        self._neighbours.lose(port)
        if port in self._unanswered:
            self._unanswered.remove(port)
            self._echo(t_ns)
        self._tell_change(port, False, t_ns)
        self._tell_links(t_ns)

    def _tell_change(self, port: int, is_up: bool, t_ns: int) -> None:
        if self._has_way():
            self._up(self._packet(Kind.CHANGE, self.network_id, port, int(is_up)), t_ns)

    def _tell_links(self, t_ns: int) -> None:
        """Report the neighbours that have changed since the last report to the computer."""
        if self._unanswered or not (self._warm and self.network_id and self._has_way()):
            return  # positions (JOINED) are reported before neighbours
        for port, one, other in self._neighbours.untold():
            self._up(self._packet(Kind.LINKS, self.network_id, port, one | other << ID_BITS), t_ns)

    # exploration

    def _on_explore(self, token: FormationPacket, port: int, t_ns: int) -> None:
        if token.cell:
            self._neighbours.note(port, token.cell, token.port >> 1)
        if is_newer(token.epoch, self.epoch):
            self._join(token, port, t_ns)
        elif token.epoch != self.epoch:
            self.ignored += 1
        elif port in self._unanswered:
            self._unanswered.remove(port)
            self._echo(t_ns)
        else:
            self._send(port, self._token(), t_ns)
        self._tell_links(t_ns)

    def _join(self, token: FormationPacket, port: int, t_ns: int) -> None:
        """Join a new epoch; the port of its first token becomes the master port."""
        self._begin_epoch()
        self.epoch, self._warm, self._hops = token.epoch, bool(token.port & 1), token.value + 1
        if not self._warm or self._neighbours.age != token.port >> 1:
            self.network_id = 0  # an ID of another cold epoch is void
        self._neighbours.age = token.port >> 1
        self._neighbours.tell_all_again()
        self.master_port, self.joined_ns = port, t_ns
        self.route_changes.append((0, port))
        others = [other for other in self.links.ports_up() if other != port]
        self._unanswered = set(others)
        for other in others:
            self._send(other, self._token(), t_ns)
        if self._warm and self.network_id:
            self._tell_joined(t_ns)
        elif self._warm:
            self._send(port, self._packet(Kind.NEWCOMER, value=self.uid), t_ns)
        self._echo(t_ns)

    def _token(self) -> FormationPacket:
        return self._packet(Kind.EXPLORE, self.network_id, self._neighbours.age << 1 | self._warm, self._hops)

    def _on_done(self, tree_size: int, port: int, t_ns: int) -> None:
        if port not in self._unanswered:
            self.ignored += 1
            return
        self._unanswered.remove(port)
        self._tree_size[port] = tree_size
        self._echo(t_ns)

    def _echo(self, t_ns: int) -> None:
        if not self._unanswered:
            self._up(self._packet(Kind.DONE, value=1 + sum(self._tree_size)), t_ns)
            self._tell_links(t_ns)

    # identity

    def _on_assign(self, network_id: int, port: int, t_ns: int) -> None:
        if port != self.master_port or self.network_id:
            self.ignored += 1
            return
        self.network_id = network_id
        first = network_id + 1
        if not self._warm:
            for child in self._children():
                self._send(child, self._packet(Kind.ASSIGN, cell=first), t_ns)
                first += self._tree_size[child]
        for link in self.links.ports_up():
            self._send(link, self._identity(), t_ns)
        if self._warm:
            self._tell_joined(t_ns)
        newcomers, self._newcomers = self._newcomers, []
        for below, uid in newcomers:
            self._up(self._packet(Kind.NEWCOMER, network_id, below, uid), t_ns)

    def _on_identity(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        is_news = self._neighbours.note(port, packet.cell, packet.port)
        self._report(t_ns)
        if is_news and port == self.master_port and self._warm and self.network_id:
            self._tell_joined(t_ns)  # the parent had no ID yet when this cell joined
        else:
            self._tell_links(t_ns)

    def _tell_joined(self, t_ns: int) -> None:
        assert self.master_port is not None
        parent = self._neighbours.at(self.master_port) or 0
        value = self._hops | parent << ID_BITS
        self._neighbours.tell_all_again()
        self._up(self._packet(Kind.JOINED, self.network_id, self.master_port, value), t_ns)
        self._tell_links(t_ns)

    def _on_newcomer(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        """Forward an ID request, of a neighbour without ID or relayed by another cell."""
        if packet.cell:
            self._up(packet, t_ns)
        elif self.network_id:
            self._up(packet._replace(cell=self.network_id, port=port), t_ns)
        else:
            self._newcomers.append((port, packet.value))

    def _on_adopt(self, packet: FormationPacket, t_ns: int) -> None:
        mine = packet.cell == self.network_id
        port = packet.port if mine else self._routes.get(packet.cell)
        if port is None or not self.links.is_up(port):
            self.ignored += 1
        elif mine:
            self._send(port, self._packet(Kind.ASSIGN, cell=packet.value), t_ns)
        else:
            self._send(port, packet, t_ns)

    def _learn(self, network_id: int, port: int) -> None:
        """Learn the route to a cell from the port of its packets (backward learning)."""
        if self._routes.get(network_id) != port:
            self._routes[network_id] = port
            self.route_changes.append((network_id, port))

    # reports of a cold epoch

    def _on_collect(self, port: int, t_ns: int) -> None:
        if port != self.master_port or not self.network_id:
            self.ignored += 1
            return
        self._my_turn = True
        self._report(t_ns)

    def _report(self, t_ns: int) -> None:
        """Report this cell once it is collected and knows its neighbours, then collect its children."""
        if not self._my_turn or not self._neighbours.complete(self.links.ports_up()):
            return
        self._my_turn = False
        assert self.master_port is not None
        self._up(self._packet(Kind.UNIT, self.network_id, self.master_port, self.uid), t_ns)
        for port, one, other in self._neighbours.untold():
            self._up(self._packet(Kind.LINKS, self.network_id, port, one | other << ID_BITS), t_ns)
        self._to_collect = self._children()
        self._collect_next(t_ns)

    def _collect_next(self, t_ns: int) -> None:
        if self._to_collect:
            child = self._to_collect[0]
            self._expected_reports = REPORTS_PER_CELL * self._tree_size[child]
            self._send(child, self._packet(Kind.COLLECT), t_ns)

    def _on_report(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        if not self._to_collect or port != self._to_collect[0]:
            self.ignored += 1
            return
        if packet.kind is Kind.UNIT:
            self._learn(packet.cell, port)
        self._expected_reports -= 1
        self._up(packet, t_ns)
        if self._expected_reports == 0:
            self._to_collect.pop(0)
            self._collect_next(t_ns)

    # helpers

    def _children(self) -> list[int]:
        return [port for port, size in enumerate(self._tree_size) if size]

    def _packet(self, kind: Kind, cell: int = 0, port: int = 0, value: int = 0) -> FormationPacket:
        assert self.epoch is not None
        return FormationPacket(kind, self.epoch, cell, port, value)

    def _identity(self) -> FormationPacket:
        return self._packet(Kind.IDENTITY, self.network_id, self._neighbours.age)

    def _has_way(self) -> bool:
        return self.master_port is not None and self.links.is_up(self.master_port)

    def _send(self, port: int, packet: FormationPacket, t_ns: int) -> None:
        if self.links.is_up(port):
            self.links.send(port, packet, t_ns)
        else:
            self.ignored += 1

    def _up(self, packet: FormationPacket, t_ns: int) -> None:
        """Send a packet towards the computer; drop it without a route: the next epoch asks again."""
        if self._has_way():
            assert self.master_port is not None
            self.links.send(self.master_port, packet, t_ns)
        else:
            self.ignored += 1
