"""Network formation and maintenance by the gateway [UCD]: a state machine without I/O.

The gateway is the computer's interface; each of its ports is wired to a free port of some cell and becomes
the root of a tree. It starts all epochs and knows only what packets report. The first epoch is cold; a later
change of links starts a warm one, in which cells keep their IDs (`cells.formation`).
"""

from enum import Enum, auto

from cells.formation.formation_agent import FormationAgent
from cells.formation.link_layer import LinkLayer
from cells.formation.packets import ID_BITS, MAX_ID, FormationPacket, FormationPacketKind, OutgoingPackets
from cells.formation.routing_forest import ForestNode, RoutingForest
from skinnet.errors import DeploymentError
from skinnet.skin.gateway_placement import MAX_GATEWAY_PORTS
from skinnet.skin.lattice import N_PORTS

__all__ = ["FormationPhase", "GatewayAgent"]

_PORT_PAIRS = range(0, N_PORTS, 2)
"""First port of each pair that one LINKS packet reports."""
_EPOCH_MODULUS = 2**12
_GENERATIONS = 8
_MAX_COLD_EPOCHS = 3
"""Cold epochs before formation fails *(assumed)*."""
_EPOCH_TIMEOUT_NS = 10_000_000_000
"""Timeout of a cold epoch [ns] *(assumed)*."""
_WARM_TIMEOUT_DIVISOR = 10
"""Ratio of the timeouts of a cold and a warm epoch, which has no depth-first traversal *(assumed)*."""


class FormationPhase(Enum):
    """Phase of the gateway's formation."""

    IDLE = auto()
    LINK_SYNC = auto()
    EXPLORATION = auto()
    REPORTS = auto()
    COMPLETE = auto()
    FAILED = auto()
    """No cell answers at any port."""


class GatewayAgent(FormationAgent):
    """Formation agent of the gateway: it starts epochs and collects the cells' reports.

    An epoch that is not complete in time has lost a packet or a cell; another one starts. `start` may be
    called again at any time.

    Attributes:
        phase: Phase of the current epoch.
        epoch: Current epoch, modulo 4096.
        forest: Routing forest from the cells' reports.
        version: Number of changes of the known topology; the end of an epoch counts as one.
        has_settled: True once any epoch has completed or failed.
    """

    def __init__(self, ports: int, *, retransmission_timeout_ns: int, settle_ns: int) -> None:
        """Create an idle gateway.

        Args:
            ports: Number of ports, 1 to 16.
            retransmission_timeout_ns: Retransmission timeout of a link [ns].
            settle_ns: Time for links to come up before the first epoch [ns].

        Raises:
            DeploymentError: `ports` is out of range.
        """
        if not 1 <= ports <= MAX_GATEWAY_PORTS:
            raise DeploymentError(f"a gateway with {ports} ports: use 1 to {MAX_GATEWAY_PORTS}")
        super().__init__(LinkLayer(ports, retransmission_timeout_ns), epoch=0)
        self.phase = FormationPhase.IDLE
        self.forest = RoutingForest()
        self.version = 0
        self.has_settled = False
        self._settle_ns = settle_ns
        self._attempts_left = 0
        self._warm = self._has_formed = False
        self._generation = 0
        self._deadline_ns: int | None = None
        self._reset_epoch()

    def _reset_epoch(self) -> None:
        self._unanswered: set[int] = set()
        self._subtree_size = [0] * len(self.links)
        self._unidentified: set[int] = set()

    def start(self, t_ns: int) -> OutgoingPackets:
        """Start formation afresh; return the packets to send."""
        self._attempts_left = _MAX_COLD_EPOCHS
        self._start_sync(t_ns)
        return self._collect_outgoing(t_ns)

    @property
    def n_reached(self) -> int:
        """Number of cells in the gateway's trees, valid once exploration has ended."""
        return sum(self._subtree_size)

    def next_port(self, network_id: int) -> int | None:
        """Return the port towards the cell `network_id`; None if it has never reported."""
        return self._routes.get(network_id)

    def next_deadline(self) -> int | None:
        """Return the deadline [ns] at which `on_deadline` is to be called; None if there is none."""
        both = (self._deadline_ns, super().next_deadline())
        return min((t_ns for t_ns in both if t_ns is not None), default=None)

    def _on_timers(self, t_ns: int) -> None:
        if self._deadline_ns is not None and t_ns >= self._deadline_ns:
            self._on_timeout(t_ns)

    def _dispatch(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        self._process(packet, port, t_ns)
        if self.phase is FormationPhase.REPORTS and self._all_reported():
            self.phase, self._deadline_ns, self._has_formed = FormationPhase.COMPLETE, None, True
            self.version += 1
            self.has_settled = True

    def _process(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        forest, member = self.forest, self.forest.nodes.get(packet.cell)
        match packet.kind:
            case FormationPacketKind.NEIGHBOUR_REPORT if member is not None and packet.port in _PORT_PAIRS:
                pair = [packet.value & MAX_ID, packet.value >> ID_BITS]
                is_news = forest.record_neighbours(packet.cell, packet.port, pair, packet.epoch)
                self.version += is_news and self.phase is FormationPhase.COMPLETE
            case FormationPacketKind.ID_REQUEST if self._warm and (member is not None or not packet.cell):
                self._grant_id(packet, port, t_ns)
            case _ if packet.epoch != self.epoch or self.phase in (
                FormationPhase.IDLE,
                FormationPhase.FAILED,
            ):
                self.dropped_packets += 1
            case FormationPacketKind.LINK_CHANGE:
                self._start_epoch(t_ns)
            case FormationPacketKind.EXPLORE | FormationPacketKind.DONE if port in self._unanswered:
                self._on_explore_answer(
                    packet.value if packet.kind is FormationPacketKind.DONE else 0, port, t_ns
                )
            case FormationPacketKind.EXPLORE if self.phase is FormationPhase.EXPLORATION:
                self.links.send(port, self._explore_packet(), t_ns)
            case FormationPacketKind.IDENTITY:
                self._unidentified.discard(port)
            case FormationPacketKind.CELL_REPORT if 0 < packet.cell <= self.n_reached and not self._warm:
                forest.nodes[packet.cell] = ForestNode(packet.value, port, packet.port)
                forest.joined.add(packet.cell)
                self._learn_route(packet.cell, port)
            case FormationPacketKind.JOINED if member is not None and self._warm:
                hops, parent = packet.value & MAX_ID, packet.value >> ID_BITS
                is_news = forest.record_joined(packet.cell, port, packet.port, parent, hops)
                self.version += is_news and self.phase is FormationPhase.COMPLETE
                self._learn_route(packet.cell, port)
            case _:
                self.dropped_packets += 1

    def _on_link_change(self, port: int, is_up: bool, t_ns: int) -> None:
        self.links.link_changes.clear()  # one new epoch explores them all
        if self.phase not in (FormationPhase.IDLE, FormationPhase.LINK_SYNC):
            self._start_epoch(t_ns)

    # epochs

    def _start_sync(self, t_ns: int) -> None:
        self.forest = RoutingForest()
        self._warm = self._has_formed = False
        self.phase = FormationPhase.LINK_SYNC
        self._deadline_ns = t_ns + self._settle_ns

    def _on_timeout(self, t_ns: int) -> None:
        if self._has_formed:
            self._start_epoch(t_ns)
        elif self._attempts_left:
            self._attempts_left -= 1
            self._start_epoch(t_ns)
        else:
            self._fail()

    def _start_epoch(self, t_ns: int) -> None:
        """Begin a new epoch, warm once cells have IDs."""
        self._reset_epoch()
        ports = self.links.ports_up()
        if not ports:
            self._fail()
            return
        self._warm = self._has_formed
        if not self._warm:
            self._generation = (self._generation + 1) % _GENERATIONS
            self.forest = RoutingForest()
        self.forest.joined = set()
        self.epoch = ((self.epoch or 0) + 1) % _EPOCH_MODULUS
        self.phase = FormationPhase.EXPLORATION
        self._deadline_ns = t_ns + _EPOCH_TIMEOUT_NS // (_WARM_TIMEOUT_DIVISOR if self._warm else 1)
        self._unanswered = set(ports)
        for port in ports:
            self.links.send(port, self._explore_packet(), t_ns)

    def _explore_packet(self) -> FormationPacket:
        return self._packet(FormationPacketKind.EXPLORE, port=self._generation << 1 | self._warm)

    def _fail(self) -> None:
        """End formation without any cell; a link that comes up starts a new epoch."""
        self._reset_epoch()
        self.phase, self._deadline_ns = FormationPhase.FAILED, None
        self.forest.joined = set()
        self.version += 1
        self.has_settled = True

    def _on_explore_answer(self, subtree_size: int, port: int, t_ns: int) -> None:
        self._unanswered.remove(port)
        self._subtree_size[port] = subtree_size
        if not self._unanswered:
            self._end_exploration(t_ns)

    def _end_exploration(self, t_ns: int) -> None:
        if self.n_reached > MAX_ID:
            raise DeploymentError(
                f"{self.n_reached} cells behind one gateway: network IDs of {ID_BITS} bits allow {MAX_ID}; "
                "use more patches"
            )
        self.phase = FormationPhase.REPORTS
        if self._warm:
            return
        ports = self.links.ports_up()
        self._unidentified = set(ports)
        first = 1
        for port in ports:
            size = self._subtree_size[port]
            if size:
                self.links.send(port, self._packet(FormationPacketKind.ASSIGN, cell=first), t_ns)
            self.links.send(port, self._packet(FormationPacketKind.IDENTITY, port=self._generation), t_ns)
            if size:
                self.links.send(port, self._packet(FormationPacketKind.COLLECT), t_ns)
            first += size

    def _all_reported(self) -> bool:
        """Return True if every cell of the trees has reported."""
        if len(self.forest.joined) != self.n_reached:
            return False
        if not self._warm:
            if len(self.forest.neighbours_epoch) != len(_PORT_PAIRS) * self.n_reached or self._unidentified:
                return False
            self._compute_depths()
        return True

    def _compute_depths(self) -> None:
        for network_id in sorted(self.forest.nodes):  # IDs are depth first: parents before children
            member = self.forest.nodes[network_id]
            member.parent = member.neighbours[member.master_port]
            member.hops = 1 + (self.forest.nodes[member.parent].hops if member.parent else 0)

    def _grant_id(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        """Assign an ID to a cell without one, through its neighbour, since no route leads to it."""
        network_id = self.forest.assign_id(packet.value)
        if not packet.cell:
            self.links.send(port, self._packet(FormationPacketKind.ASSIGN, cell=network_id), t_ns)
        elif (way := self._routes.get(packet.cell)) is not None and self.links.is_up(way):
            self.links.send(
                way, self._packet(FormationPacketKind.ID_GRANT, packet.cell, packet.port, network_id), t_ns
            )
        else:
            self.dropped_packets += 1
