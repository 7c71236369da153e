"""Network formation and maintenance by the gateway [UCD]: a state machine without I/O.

The gateway is the computer's interface; each of its ports is wired to a free port of some cell and becomes
the root of a tree. It starts all epochs and knows only what packets report. The first epoch is cold; a later
change of links starts a warm one, in which cells keep their IDs (`cells.formation`).
"""

from enum import Enum, auto

from cells.forest import Forest, Member
from cells.formation_packets import ID_BITS, MAX_ID, FormationPacket, Kind, Sends
from cells.link_layer import LinkLayer
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import N_PORTS

__all__ = ["MAX_PORTS", "GatewayFormation", "Phase"]

MAX_PORTS = 16
_PAIRS = range(0, N_PORTS, 2)
"""First port of each pair that one LINKS packet reports."""
_EPOCHS = 2**12
_AGES = 8
_HASTE = 10
"""Ratio of the timeouts of a cold and a warm epoch, which has no depth-first traversal *(assumed)*."""


class Phase(Enum):
    """Phase of the gateway's formation."""

    IDLE = auto()
    SYNC = auto()
    EXPLORATION = auto()
    REPORTS = auto()
    COMPLETE = auto()
    FAILED = auto()
    """No cell answers at any port."""


class GatewayFormation:
    """Formation agent of the gateway: it starts epochs and collects the cells' reports.

    An epoch that is not complete after `patience_ns` has lost a packet or a cell; another one starts.
    `start` may be called again at any time.

    Attributes:
        phase: Phase of the current epoch.
        epoch: Epoch number, modulo 4096.
        forest: Routing forest from the cells' reports.
        version: Number of changes of the known topology; the end of an epoch counts as one.
        settled: True once any epoch has completed or failed.
        route_changes: New routes: (network ID, port); the reader empties the list.
        ignored: Number of packets that were dropped as stale or unexpected.
    """

    def __init__(
        self,
        ports: int,
        *,
        resend_ns: int,
        settle_ns: int,
        patience_ns: int = 10_000_000_000,
        attempts: int = 3,
    ) -> None:
        """Create an idle gateway.

        Args:
            ports: Number of ports, 1 to 16.
            resend_ns: Retransmission timeout of a link [ns].
            settle_ns: Time for links to come up before the first epoch [ns].
            patience_ns: Timeout of a cold epoch [ns] *(assumed)*.
            attempts: Cold epochs before formation fails *(assumed)*.

        Raises:
            DeploymentError: `ports` is out of range.
        """
        if not 1 <= ports <= MAX_PORTS:
            raise DeploymentError(
                f"a gateway with {ports} ports: allowed are 1 to {MAX_PORTS}; split the patch"
            )
        self.phase = Phase.IDLE
        self.epoch = 0
        self.forest = Forest()
        self.version = 0
        self.settled = False
        self.route_changes: list[tuple[int, int]] = []
        self.ignored = 0
        self.links = LinkLayer(ports, resend_ns)
        self._settle_ns = settle_ns
        self._patience_ns = patience_ns
        self._attempts = attempts
        self._attempts_left = 0
        self._warm = self._formed = False
        self._age = 0
        self._deadline_ns: int | None = None
        self._routes: dict[int, int] = {}
        self._begin_epoch()

    def _begin_epoch(self) -> None:
        self._unanswered: set[int] = set()
        self._tree_size = [0] * len(self.links)
        self._unidentified: set[int] = set()

    def start(self, t_ns: int) -> Sends:
        """Start formation afresh; return the packets to send."""
        self._attempts_left = self._attempts
        self._settle(t_ns)
        return self._after(t_ns)

    @property
    def n_reached(self) -> int:
        """Number of cells in the gateway's trees, valid once exploration has ended."""
        return sum(self._tree_size)

    def next_port(self, network_id: int) -> int | None:
        """Return the port towards the cell `network_id`; None if it has never reported."""
        return self._routes.get(network_id)

    def next_deadline(self) -> int | None:
        """Return the deadline [ns] at which `on_deadline` is to be called; None if there is none."""
        both = (self._deadline_ns, self.links.next_deadline())
        return min((t_ns for t_ns in both if t_ns is not None), default=None)

    def set_carrier(self, port: int, present: bool, t_ns: int) -> Sends:
        """Process a change of carrier at a port; return the packets to send."""
        self.links.set_carrier(port, present, t_ns)
        return self._after(t_ns)

    def on_deadline(self, t_ns: int) -> Sends:
        """Process expired timers; return the packets to send."""
        self.links.on_deadline(t_ns)
        if self._deadline_ns is not None and t_ns >= self._deadline_ns:
            self._on_overdue(t_ns)
        return self._after(t_ns)

    def handle(self, packet: FormationPacket, port: int, t_ns: int) -> Sends:
        """Process a packet that arrives on `port`; return the packets to send.

        Raises:
            DeploymentError: more cells than IDs of 14 bits.
        """
        new = self.links.receive(port, packet, t_ns)
        if new is not None:
            self._dispatch(new, port, t_ns)
            if self.phase is Phase.REPORTS and self._all_told():
                self.phase, self._deadline_ns, self._formed = Phase.COMPLETE, None, True
                self.version += 1
                self.settled = True
        return self._after(t_ns)

    def _dispatch(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        forest, member = self.forest, self.forest.members.get(packet.cell)
        match packet.kind:
            case Kind.LINKS if member is not None and packet.port in _PAIRS:
                pair = [packet.value & MAX_ID, packet.value >> ID_BITS]
                is_news = forest.tell(packet.cell, packet.port, pair, packet.epoch)
                self.version += is_news and self.phase is Phase.COMPLETE
            case Kind.NEWCOMER if self._warm and (member is not None or not packet.cell):
                self._adopt(packet, port, t_ns)
            case _ if packet.epoch != self.epoch or self.phase in (Phase.IDLE, Phase.FAILED):
                self.ignored += 1
            case Kind.CHANGE:
                self._begin(t_ns)
            case Kind.EXPLORE | Kind.DONE if port in self._unanswered:
                self._on_answer(packet.value if packet.kind is Kind.DONE else 0, port, t_ns)
            case Kind.EXPLORE if self.phase is Phase.EXPLORATION:
                self.links.send(port, self._token(), t_ns)
            case Kind.IDENTITY:
                self._unidentified.discard(port)
            case Kind.UNIT if 0 < packet.cell <= self.n_reached and not self._warm:
                forest.members[packet.cell] = Member(packet.value, port, packet.port)
                forest.joined.add(packet.cell)
                self._learn(packet.cell, port)
            case Kind.JOINED if member is not None and self._warm:
                hops, parent = packet.value & MAX_ID, packet.value >> ID_BITS
                is_news = forest.join(packet.cell, port, packet.port, parent, hops)
                self.version += is_news and self.phase is Phase.COMPLETE
                self._learn(packet.cell, port)
            case _:
                self.ignored += 1

    def _after(self, t_ns: int) -> Sends:
        """Process pending link changes; return all packets to send."""
        links = self.links
        while links.changes:
            links.changes.clear()
            if self.phase not in (Phase.IDLE, Phase.SYNC):
                self._begin(t_ns)
        sends, links.out = links.out, []
        return sends

    # epochs

    def _settle(self, t_ns: int) -> None:
        self.forest = Forest()
        self._warm = self._formed = False
        self.phase = Phase.SYNC
        self._deadline_ns = t_ns + self._settle_ns

    def _on_overdue(self, t_ns: int) -> None:
        if self._formed:
            self._begin(t_ns)
        elif self._attempts_left:
            self._attempts_left -= 1
            self._begin(t_ns)
        else:
            self._fail()

    def _begin(self, t_ns: int) -> None:
        """Begin a new epoch, warm once cells have IDs."""
        self._begin_epoch()
        ports = self.links.ports_up()
        if not ports:
            self._fail()
            return
        self._warm = self._formed
        if not self._warm:
            self._age = (self._age + 1) % _AGES
            self.forest = Forest()
        self.forest.joined = set()
        self.epoch = (self.epoch + 1) % _EPOCHS
        self.phase = Phase.EXPLORATION
        self._deadline_ns = t_ns + (self._patience_ns // _HASTE if self._warm else self._patience_ns)
        self._unanswered = set(ports)
        for port in ports:
            self.links.send(port, self._token(), t_ns)

    def _token(self) -> FormationPacket:
        return self._packet(Kind.EXPLORE, port=self._age << 1 | self._warm)

    def _fail(self) -> None:
        """End formation without any cell; a link that comes up starts a new epoch."""
        self._begin_epoch()
        self.phase, self._deadline_ns = Phase.FAILED, None
        self.forest.joined = set()
        self.version += 1
        self.settled = True

    def _on_answer(self, tree_size: int, port: int, t_ns: int) -> None:
        self._unanswered.remove(port)
        self._tree_size[port] = tree_size
        if not self._unanswered:
            self._end_exploration(t_ns)

    def _end_exploration(self, t_ns: int) -> None:
        if self.n_reached > MAX_ID:
            raise DeploymentError(
                f"{self.n_reached} cells behind one gateway: IDs of {ID_BITS} bits name {MAX_ID}; "
                "use more patches"
            )
        self.phase = Phase.REPORTS
        if self._warm:
            return
        ports = self.links.ports_up()
        self._unidentified = set(ports)
        first = 1
        for port in ports:
            size = self._tree_size[port]
            if size:
                self.links.send(port, self._packet(Kind.ASSIGN, cell=first), t_ns)
            self.links.send(port, self._packet(Kind.IDENTITY, port=self._age), t_ns)
            if size:
                self.links.send(port, self._packet(Kind.COLLECT), t_ns)
            first += size

    def _all_told(self) -> bool:
        """Return True if every cell of the trees has reported."""
        if len(self.forest.joined) != self.n_reached:
            return False
        if not self._warm:
            if len(self.forest.told_in) != len(_PAIRS) * self.n_reached or self._unidentified:
                return False
            self._work_out_depths()
        return True

    def _work_out_depths(self) -> None:
        for network_id in sorted(self.forest.members):  # IDs are depth first: parents before children
            member = self.forest.members[network_id]
            member.parent = member.neighbours[member.master_port]
            member.hops = 1 + (self.forest.members[member.parent].hops if member.parent else 0)

    def _adopt(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        """Assign an ID to a cell without one, through its neighbour, since no route leads to it."""
        network_id = self.forest.id_of(packet.value)
        if not packet.cell:
            self.links.send(port, self._packet(Kind.ASSIGN, cell=network_id), t_ns)
        elif (way := self._routes.get(packet.cell)) is not None and self.links.is_up(way):
            self.links.send(way, self._packet(Kind.ADOPT, packet.cell, packet.port, network_id), t_ns)
        else:
            self.ignored += 1

    def _learn(self, network_id: int, port: int) -> None:
        if self._routes.get(network_id) != port:
            self._routes[network_id] = port
            self.route_changes.append((network_id, port))

    def _packet(self, kind: Kind, cell: int = 0, port: int = 0, value: int = 0) -> FormationPacket:
        return FormationPacket(kind, self.epoch, cell, port, value)
