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

from cells.formation.formation_agent import FormationAgent
from cells.formation.link_layer import LinkLayer
from cells.formation.neighbour_table import NeighbourTable
from cells.formation.packets import (
    ID_BITS,
    REPORTS_PER_CELL,
    FormationPacket,
    FormationPacketKind,
    is_newer,
)
from skinnet.skin.lattice import N_PORTS

__all__ = ["CellAgent"]


class CellAgent(FormationAgent):
    """Formation agent of one cell: its position in the tree, its ID, routes and neighbours.

    Attributes:
        uid: Hardware ID of the cell.
        master_port: Port towards the gateway; None while unreached.
        joined_ns: Time at which the cell found its present master [ns].
    """

    def __init__(self, uid: int, retransmission_timeout_ns: int, boot_count: int = 0) -> None:
        """Create the agent of a cell that is switched on, with no carrier at any port.

        Args:
            uid: Hardware ID.
            retransmission_timeout_ns: Retransmission timeout of a link [ns].
            boot_count: Number of earlier power-ups.
        """
        super().__init__(LinkLayer(N_PORTS, retransmission_timeout_ns, boot_count), epoch=None)
        self.uid = uid
        self.master_port: int | None = None
        self.joined_ns: int | None = None
        self._warm = False
        self._hops = 0
        self._neighbour_table = NeighbourTable()
        self._pending_id_requests: list[tuple[int, int]] = []
        self._reset_epoch()

    def _reset_epoch(self) -> None:
        self._unanswered: set[int] = set()
        self._subtree_size = [0] * N_PORTS
        self._is_collected = False
        self._to_collect: list[int] = []
        self._expected_reports = 0

    def next_port(self, network_id: int) -> int | None:
        """Return the port towards the cell `network_id` (0: the computer); None if it is this cell."""
        return None if network_id == self.network_id else self._routes.get(network_id, self.master_port)

    def _dispatch(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        match packet.kind:
            case FormationPacketKind.EXPLORE:
                self._on_explore(packet, port, t_ns)
            case FormationPacketKind.IDENTITY:
                self._on_identity(packet, port, t_ns)
            case FormationPacketKind.NEIGHBOUR_REPORT if self._warm or packet.epoch != self.epoch:
                self._send_up(packet, t_ns)
            case FormationPacketKind.LINK_CHANGE:
                self._send_up(packet, t_ns)
            case FormationPacketKind.ID_REQUEST:
                self._on_id_request(packet, port, t_ns)
            case FormationPacketKind.ID_GRANT:
                self._on_id_grant(packet, t_ns)
            case _ if packet.epoch != self.epoch:
                self.dropped_packets += 1
            case FormationPacketKind.DONE:
                self._on_done(packet.value, port, t_ns)
            case FormationPacketKind.ASSIGN:
                self._on_assign(packet.cell, port, t_ns)
            case FormationPacketKind.COLLECT:
                self._on_collect(port, t_ns)
            case FormationPacketKind.CELL_REPORT | FormationPacketKind.NEIGHBOUR_REPORT:
                self._on_report(packet, port, t_ns)
            case FormationPacketKind.JOINED:
                self._learn_route(packet.cell, port)
                self._send_up(packet, t_ns)
            case _:
                self.dropped_packets += 1

    # link changes

    def _on_link_change(self, port: int, is_up: bool, t_ns: int) -> None:
        if is_up:
            self._on_link_up(port, t_ns)
        else:
            self._on_link_down(port, t_ns)

    def _on_link_up(self, port: int, t_ns: int) -> None:
        if self.network_id:
            self._send(port, self._identity_packet(), t_ns)
        self._report_link_change(port, True, t_ns)

    def _on_link_down(self, port: int, t_ns: int) -> None:
        self._neighbour_table.remove(port)
        if port in self._unanswered:
            self._unanswered.remove(port)
            self._echo_if_answered(t_ns)
        self._report_link_change(port, False, t_ns)
        self._report_neighbours(t_ns)

    def _report_link_change(self, port: int, is_up: bool, t_ns: int) -> None:
        if self._has_route():
            self._send_up(
                self._packet(FormationPacketKind.LINK_CHANGE, self.network_id, port, int(is_up)), t_ns
            )

    def _report_neighbours(self, t_ns: int) -> None:
        """Report the neighbours that have changed since the last report to the computer."""
        if self._unanswered or not (self._warm and self.network_id and self._has_route()):
            return  # positions (JOINED) are reported before neighbours
        for port, one, other in self._neighbour_table.take_unreported():
            self._send_up(
                self._packet(
                    FormationPacketKind.NEIGHBOUR_REPORT, self.network_id, port, one | other << ID_BITS
                ),
                t_ns,
            )

    # exploration

    def _on_explore(self, token: FormationPacket, port: int, t_ns: int) -> None:
        if token.cell:
            self._neighbour_table.update(port, token.cell, token.port >> 1)
        if is_newer(token.epoch, self.epoch):
            self._join_epoch(token, port, t_ns)
        elif token.epoch != self.epoch:
            self.dropped_packets += 1
        elif port in self._unanswered:
            self._unanswered.remove(port)
            self._echo_if_answered(t_ns)
        else:
            self._send(port, self._explore_packet(), t_ns)
        self._report_neighbours(t_ns)

    def _join_epoch(self, token: FormationPacket, port: int, t_ns: int) -> None:
        """Join a new epoch; the port of its first token becomes the master port."""
        self._reset_epoch()
        self.epoch, self._warm, self._hops = token.epoch, bool(token.port & 1), token.value + 1
        if not self._warm or self._neighbour_table.generation != token.port >> 1:
            self.network_id = 0  # an ID of another cold epoch is void
        self._neighbour_table.generation = token.port >> 1
        self._neighbour_table.mark_all_unreported()
        self.master_port, self.joined_ns = port, t_ns
        self.route_changes.append((0, port))
        others = [other for other in self.links.ports_up() if other != port]
        self._unanswered = set(others)
        for other in others:
            self._send(other, self._explore_packet(), t_ns)
        if self._warm and self.network_id:
            self._report_joined(t_ns)
        elif self._warm:
            self._send(port, self._packet(FormationPacketKind.ID_REQUEST, value=self.uid), t_ns)
        self._echo_if_answered(t_ns)

    def _explore_packet(self) -> FormationPacket:
        return self._packet(
            FormationPacketKind.EXPLORE,
            self.network_id,
            self._neighbour_table.generation << 1 | self._warm,
            self._hops,
        )

    def _on_done(self, subtree_size: int, port: int, t_ns: int) -> None:
        if port not in self._unanswered:
            self.dropped_packets += 1
            return
        self._unanswered.remove(port)
        self._subtree_size[port] = subtree_size
        self._echo_if_answered(t_ns)

    def _echo_if_answered(self, t_ns: int) -> None:
        if not self._unanswered:
            self._send_up(self._packet(FormationPacketKind.DONE, value=1 + sum(self._subtree_size)), t_ns)
            self._report_neighbours(t_ns)

    # identity

    def _on_assign(self, network_id: int, port: int, t_ns: int) -> None:
        if port != self.master_port or self.network_id:
            self.dropped_packets += 1
            return
        self.network_id = network_id
        first = network_id + 1
        if not self._warm:
            for child in self._children():
                self._send(child, self._packet(FormationPacketKind.ASSIGN, cell=first), t_ns)
                first += self._subtree_size[child]
        for link in self.links.ports_up():
            self._send(link, self._identity_packet(), t_ns)
        if self._warm:
            self._report_joined(t_ns)
        newcomers, self._pending_id_requests = self._pending_id_requests, []
        for below, uid in newcomers:
            self._send_up(self._packet(FormationPacketKind.ID_REQUEST, network_id, below, uid), t_ns)

    def _on_identity(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        is_news = self._neighbour_table.update(port, packet.cell, packet.port)
        self._report_if_collected(t_ns)
        if is_news and port == self.master_port and self._warm and self.network_id:
            self._report_joined(t_ns)  # the parent had no ID yet when this cell joined
        else:
            self._report_neighbours(t_ns)

    def _report_joined(self, t_ns: int) -> None:
        assert self.master_port is not None
        parent = self._neighbour_table.id_at(self.master_port) or 0
        value = self._hops | parent << ID_BITS
        self._neighbour_table.mark_all_unreported()
        self._send_up(
            self._packet(FormationPacketKind.JOINED, self.network_id, self.master_port, value), t_ns
        )
        self._report_neighbours(t_ns)

    def _on_id_request(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        """Forward an ID request, of a neighbour without ID or relayed by another cell."""
        if packet.cell:
            self._send_up(packet, t_ns)
        elif self.network_id:
            self._send_up(packet._replace(cell=self.network_id, port=port), t_ns)
        else:
            self._pending_id_requests.append((port, packet.value))

    def _on_id_grant(self, packet: FormationPacket, t_ns: int) -> None:
        mine = packet.cell == self.network_id
        port = packet.port if mine else self._routes.get(packet.cell)
        if port is None or not self.links.is_up(port):
            self.dropped_packets += 1
        elif mine:
            self._send(port, self._packet(FormationPacketKind.ASSIGN, cell=packet.value), t_ns)
        else:
            self._send(port, packet, t_ns)

    # reports of a cold epoch

    def _on_collect(self, port: int, t_ns: int) -> None:
        if port != self.master_port or not self.network_id:
            self.dropped_packets += 1
            return
        self._is_collected = True
        self._report_if_collected(t_ns)

    def _report_if_collected(self, t_ns: int) -> None:
        """Report this cell once it is collected and knows its neighbours, then collect its children."""
        if not self._is_collected or not self._neighbour_table.is_complete(self.links.ports_up()):
            return
        self._is_collected = False
        assert self.master_port is not None
        self._send_up(
            self._packet(FormationPacketKind.CELL_REPORT, self.network_id, self.master_port, self.uid), t_ns
        )
        for port, one, other in self._neighbour_table.take_unreported():
            self._send_up(
                self._packet(
                    FormationPacketKind.NEIGHBOUR_REPORT, self.network_id, port, one | other << ID_BITS
                ),
                t_ns,
            )
        self._to_collect = self._children()
        self._collect_next(t_ns)

    def _collect_next(self, t_ns: int) -> None:
        if self._to_collect:
            child = self._to_collect[0]
            self._expected_reports = REPORTS_PER_CELL * self._subtree_size[child]
            self._send(child, self._packet(FormationPacketKind.COLLECT), t_ns)

    def _on_report(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        if not self._to_collect or port != self._to_collect[0]:
            self.dropped_packets += 1
            return
        if packet.kind is FormationPacketKind.CELL_REPORT:
            self._learn_route(packet.cell, port)
        self._expected_reports -= 1
        self._send_up(packet, t_ns)
        if self._expected_reports == 0:
            self._to_collect.pop(0)
            self._collect_next(t_ns)

    # helpers

    def _children(self) -> list[int]:
        return [port for port, size in enumerate(self._subtree_size) if size]

    def _identity_packet(self) -> FormationPacket:
        return self._packet(FormationPacketKind.IDENTITY, self.network_id, self._neighbour_table.generation)

    def _has_route(self) -> bool:
        return self.master_port is not None and self.links.is_up(self.master_port)

    def _send(self, port: int, packet: FormationPacket, t_ns: int) -> None:
        if self.links.is_up(port):
            self.links.send(port, packet, t_ns)
        else:
            self.dropped_packets += 1

    def _send_up(self, packet: FormationPacket, t_ns: int) -> None:
        """Send a packet towards the computer; drop it without a route: the next epoch asks again."""
        if self._has_route():
            assert self.master_port is not None
            self.links.send(self.master_port, packet, t_ns)
        else:
            self.dropped_packets += 1
