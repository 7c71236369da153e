"""The gateway's part in forming the network [UCD], and what the computer knows at its end.

The gateway is the computer's interface; each of its ports is wired to a free port of some cell and becomes
the root of a tree. It starts all phases, and has no knowledge but what the packets bring.
"""

from dataclasses import dataclass
from enum import Enum, auto

from cells.formation_packets import ID_BITS, MAX_ID, FormationPacket, Handshake, Kind, Sends
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.messages import Topology
from skinnet.skin.lattice import N_PORTS

__all__ = ["Forest", "GatewayFormation", "Phase"]

_PAIRS = range(0, N_PORTS, 2)
"""The first of each two ports that LINKS tells of."""


class Phase(Enum):
    """Where the gateway's formation stands."""

    IDLE = auto()
    SYNC = auto()
    EXPLORATION = auto()
    REPORTS = auto()
    COMPLETE = auto()
    FAILED = auto()


@dataclass(frozen=True)
class Forest:
    """The network as its cells reported it, by network ID − 1.

    Attributes:
        uid: Hardware number of each cell.
        gateway: Port of the gateway that its tree hangs on.
        master_port: Its port towards the gateway.
        neighbours: IDs at its ports, 0 where there is no cell.
    """

    uid: tuple[int, ...]
    gateway: tuple[int, ...]
    master_port: tuple[int, ...]
    neighbours: tuple[tuple[int, ...], ...]

    def topology(self, patch: str, n_cells: int, version: int, t_ns: int) -> Topology:
        """The message, as lists over the cells 0 to `n_cells` − 1, which are the hardware numbers.

        `depth` counts the hops to the gateway, from 1. Cells that were not reached have ID 0, depth 0, and −1
        elsewhere.

        Raises:
            ProtocolError: hardware numbers that repeat, or that the patch does not have.
        """
        if len(set(self.uid)) < len(self.uid) or any(uid >= n_cells for uid in self.uid):
            raise ProtocolError(f"patch {patch}: hardware numbers repeat or exceed {n_cells - 1}: {self.uid}")
        network_id, depth = [0] * n_cells, [0] * n_cells
        gateway, master_port, parent = [-1] * n_cells, [-1] * n_cells, [-1] * n_cells
        neighbours = [[-1] * N_PORTS for _ in range(n_cells)]
        cell_of = (-1, *self.uid)
        for index, cell in enumerate(self.uid):  # depth first: a parent comes before its children
            network_id[cell] = index + 1
            gateway[cell] = self.gateway[index]
            master_port[cell] = self.master_port[index]
            neighbours[cell] = [cell_of[neighbour] for neighbour in self.neighbours[index]]
            parent[cell] = neighbours[cell][self.master_port[index]]
            depth[cell] = 1 if parent[cell] < 0 else depth[parent[cell]] + 1
        return Topology(
            patch=patch,
            version=version,
            t_ns=t_ns,
            network_id=network_id,
            gateway=gateway,
            master_port=master_port,
            parent=parent,
            depth=depth,
            neighbours=neighbours,
        )


class GatewayFormation:
    """The gateway while the network forms: a state machine without I/O.

    A formation that nobody answers, or that is not complete after `patience_ns`, has lost packets or cells on
    the way; another epoch starts, up to `attempts` in all. `start` may be called again at any time, as after
    a broken link.

    Attributes:
        phase: Where it stands.
        epoch: Number of the formation, modulo 256.
        ignored: Packets of other epochs, or out of turn, that were dropped.
    """

    def __init__(
        self, ports: int, handshake_ns: int, patience_ns: int = 10_000_000_000, attempts: int = 3
    ) -> None:
        """A gateway of 1 to 16 ports; `patience_ns` and `attempts` are assumed.

        Raises:
            DeploymentError: as many ports do not fit the packets.
        """
        if not 1 <= ports <= 16:
            raise DeploymentError(f"a gateway with {ports} ports: allowed are 1 to 16; split the patch")
        self.phase = Phase.IDLE
        self.epoch = 0
        self.ignored = 0
        self._n_ports = ports
        self._handshake_ns = handshake_ns
        self._patience_ns = patience_ns
        self._attempts = attempts
        self._attempts_left = 0
        self._settled_ns = self._give_up_ns = 0
        self._reset()

    def _reset(self) -> None:
        self._links = Handshake(self._n_ports)
        self._unanswered: set[int] = set()
        self._tree_size = [0] * self._n_ports
        self._unidentified: set[int] = set()
        self._units: dict[int, FormationPacket] = {}
        self._pairs: dict[tuple[int, int], int] = {}

    def start(self, t_ns: int) -> Sends:
        """Begins a new epoch; returns what to send."""
        self._attempts_left = self._attempts
        return self._begin(t_ns)

    def _begin(self, t_ns: int) -> Sends:
        self._reset()
        self._attempts_left -= 1
        self.epoch = (self.epoch + 1) % 256
        self.phase = Phase.SYNC
        self._settled_ns = t_ns + self._handshake_ns
        self._give_up_ns = self._settled_ns + self._patience_ns
        return self._links.greet(self.epoch)

    def next_deadline(self) -> int | None:
        """When `on_deadline` is to be called [ns], if at all."""
        if self.phase is Phase.SYNC:
            return self._settled_ns
        return self._give_up_ns if self.phase in (Phase.EXPLORATION, Phase.REPORTS) else None

    def on_deadline(self, t_ns: int) -> Sends:
        """What to send when a deadline is over; nothing before."""
        deadline_ns = self.next_deadline()
        if deadline_ns is None or t_ns < deadline_ns:
            return []
        if self.phase is Phase.SYNC and self._links.ports_up():
            return self._explore()
        if self._attempts_left:
            return self._begin(t_ns)
        self._reset()
        self.phase = Phase.FAILED
        return []

    def handle(self, packet: FormationPacket, port: int, t_ns: int) -> Sends:
        """What to send when `packet` arrives on `port`.

        Raises:
            DeploymentError: more cells than IDs of 14 bits.
        """
        sends = self.on_deadline(t_ns)
        if packet.epoch != self.epoch or self.phase in (Phase.IDLE, Phase.FAILED):
            self.ignored += 1
            return sends
        match packet.kind:
            case Kind.HELLO:
                sends += self._links.hear(packet, port)
            case Kind.EXPLORE | Kind.DONE if port in self._unanswered:
                sends += self._on_answer(packet.value, port)
            case Kind.EXPLORE if self.phase is Phase.EXPLORATION:
                self._links.up[port] = True  # a token proves the link, even if the answer to HELLO was lost
                sends.append((port, FormationPacket(Kind.EXPLORE, self.epoch)))
            case Kind.IDENTITY if port in self._unidentified:
                self._unidentified.remove(port)
            case Kind.UNIT if 0 < packet.cell <= self.n_reached:
                self._units[packet.cell] = packet
            case Kind.LINKS if 0 < packet.cell <= self.n_reached and packet.port in _PAIRS:
                self._pairs[packet.cell, packet.port] = packet.value
            case _:
                self.ignored += 1
        if self.phase is Phase.REPORTS and self._all_told():
            self.phase = Phase.COMPLETE
        return sends

    @property
    def n_reached(self) -> int:
        """Cells in the gateway's trees, once exploration is over."""
        return sum(self._tree_size)

    def forest(self) -> Forest:
        """What the cells reported, once complete; no cell after a failure."""
        assert self.phase in (Phase.COMPLETE, Phase.FAILED)
        ids = range(1, self.n_reached + 1)
        gateway = [port for port, size in enumerate(self._tree_size) for _ in range(size)]
        pairs = [[self._pairs[i, port] for port in _PAIRS] for i in ids]
        return Forest(
            uid=tuple(self._units[i].value for i in ids),
            gateway=tuple(gateway),
            master_port=tuple(self._units[i].port for i in ids),
            neighbours=tuple(
                tuple(i for pair in row for i in (pair & MAX_ID, pair >> ID_BITS)) for row in pairs
            ),
        )

    def _explore(self) -> Sends:
        self.phase = Phase.EXPLORATION
        ports = self._links.ports_up()
        self._unanswered = set(ports)
        return [(port, FormationPacket(Kind.EXPLORE, self.epoch)) for port in ports]

    def _on_answer(self, tree_size: int, port: int) -> Sends:
        self._unanswered.remove(port)
        self._tree_size[port] = tree_size
        return [] if self._unanswered else self._assign()

    def _assign(self) -> Sends:
        if self.n_reached > MAX_ID:
            raise DeploymentError(
                f"{self.n_reached} cells behind one gateway: IDs of {ID_BITS} bits name {MAX_ID}; "
                "use more patches"
            )
        self.phase = Phase.REPORTS
        ports = self._links.ports_up()
        self._unidentified = set(ports)
        sends: Sends = []
        first = 1
        for port in ports:
            size = self._tree_size[port]
            if size:
                sends.append((port, FormationPacket(Kind.ASSIGN, self.epoch, cell=first)))
            sends.append((port, FormationPacket(Kind.IDENTITY, self.epoch, port=port)))
            if size:
                sends.append((port, FormationPacket(Kind.COLLECT, self.epoch)))
            first += size
        return sends

    def _all_told(self) -> bool:
        told = len(self._units) == self.n_reached and len(self._pairs) == len(_PAIRS) * self.n_reached
        return told and not self._unidentified
