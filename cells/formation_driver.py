"""Lets the agents that form the network exchange their packets over the modelled links.

Slow path decides, fast path forwards: agents are Python objects that wake for a packet, a deadline or a line
that comes or goes; their packets travel link by link through the kernel, between the data, with exact times.
The routes that they decide on take effect in the kernel as long after as an answer takes.
"""

import heapq
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from cells.formation import CellFormation
from cells.formation_gateway import GatewayFormation
from cells.formation_packets import FormationPacket, Sends
from cells.packets import PacketKind, PacketPool
from cells.wiring import Wiring
from skinnet.messages import FOREVER_NS
from skinnet.network.network import Network
from skinnet.network.routes import Routes

__all__ = ["FormationDriver"]

_Agent = CellFormation | GatewayFormation


class FormationDriver:
    """The agents of all cells and gateways of a host.

    Attributes:
        cells: The agents of the cells, by host-wide number; one that was switched off and on is a new one.
        gateways: The gateways' agents, one for each group of patches.
        powered: Which cells have power.
        sent: Formation packets so far.
        in_flight: How many of them are on their way.
    """

    def __init__(
        self,
        wiring: Wiring,
        network: Network,
        pool: PacketPool,
        *,
        reaction_ns: int,
        resend_ns: int,
        settle_ns: int,
        detect_ns: int,
        size_bytes: int,
    ) -> None:
        """Agents without power.

        Args:
            wiring: Nodes and links.
            network: Kernel that carries the packets.
            pool: Rows of packets in flight.
            reaction_ns: From the arrival of a packet to the agent's answer.
            resend_ns: Time after which an answer over one link is overdue.
            settle_ns: How long links may take to come up before the first epoch.
            detect_ns: From the end of a line's signal to the moment when its receiver knows.
            size_bytes: Size of a formation packet.
        """
        self._wiring = wiring
        self._network = network
        self._pool = pool
        self._reaction_ns = max(reaction_ns, 1)  # an answer in no time would leave no time to look ahead
        self._resend_ns = resend_ns
        self._detect_ns = detect_ns
        self._size_bytes = size_bytes
        self.sent = self.in_flight = 0
        n = wiring.n_cells
        self.cells = [CellFormation(uid, resend_ns) for uid in wiring.uid_of_cell.tolist()]
        self.gateways = [
            GatewayFormation(ports, resend_ns=resend_ns, settle_ns=settle_ns) for ports in wiring.group_ports
        ]
        self.powered = np.zeros(n, dtype=np.bool_)
        self._lives = [0] * n
        self._earlier = Counter[str]()  # of agents that were switched off and on
        self._agents: list[_Agent | None] = [None] * wiring.topology.n_nodes
        self._node_of_id: list[dict[int, int]] = [{} for _ in self.gateways]
        for node, gateway in zip(wiring.interface.tolist(), self.gateways, strict=True):
            self._agents[node] = gateway
        self._alarms: list[tuple[int, int]] = []
        self._alarm_ns = [FOREVER_NS] * wiring.topology.n_nodes
        self._lines: list[tuple[int, int, bool]] = []
        self._outbox: list[tuple[int, int, int, int]] = []

    def start(self, t_ns: int, cells: Sequence[int], links_up: Sequence[bool]) -> None:
        """Gateways and these cells are switched on; every line that has a signal is heard at once."""
        for cell in cells:
            self._switch_on(cell)
        for node, gateway in zip(self._wiring.interface.tolist(), self.gateways, strict=True):
            self._send(t_ns, node, gateway.start(t_ns))
        for link, up in enumerate(links_up):
            if up:
                self._hear(t_ns, link, True)
        self.flush()

    def switch(self, cell: int, on: bool) -> None:
        """A cell loses its power, and with it all that it knew, or gets it back; see `line`."""
        if on:
            self._lives[cell] += 1
            self._switch_on(cell)
        else:
            self._agents[int(self._wiring.node_of_cell[cell])] = None
            self.powered[cell] = False

    def line(self, t_ns: int, link: int, present: bool) -> None:
        """The signal on a link comes or goes; its receiver notices after a while."""
        heapq.heappush(self._lines, (t_ns + self._detect_ns, link, present))

    def receive(self, t_ns: int, node: int, link: int, row: int) -> None:
        """A formation packet has arrived at `node`; its agent answers after its reaction time."""
        packet: FormationPacket = self._pool.contents[row]
        agent = self._agents[node]
        if agent is not None:
            port = int(self._wiring.topology.dst_port[link])
            self._send(t_ns + self._reaction_ns, node, agent.handle(packet, port, t_ns))

    def horizon_ns(self, until_ns: int) -> int:
        """How far the network may advance before an agent could have something to say, at most `until_ns`."""
        answer_ns = self._network.next_ns + self._reaction_ns if self.in_flight else FOREVER_NS
        return max(self._network.now_ns, min(until_ns, answer_ns, self._next_alarm_ns()))

    def ring(self, t_ns: int) -> None:
        """Lets the agents see the lines that have changed by `t_ns`, then wakes those that are due."""
        while self._lines and self._lines[0][0] <= t_ns:
            at_ns, link, present = heapq.heappop(self._lines)
            self._hear(at_ns, link, present)
        while self._alarms and self._alarms[0][0] <= t_ns:
            at_ns, node = heapq.heappop(self._alarms)
            agent = self._agents[node]
            if at_ns == self._alarm_ns[node]:
                self._alarm_ns[node] = FOREVER_NS
                if agent is not None:
                    self._send(t_ns + self._reaction_ns, node, agent.on_deadline(t_ns))
        self.flush()

    def flush(self) -> None:
        """Hands what the agents have said to the network."""
        if not self._outbox:
            return
        t_ns, node, row, link = np.array(self._outbox, dtype=np.int64).T
        self._outbox.clear()
        self._network.offer(t_ns, node, node, np.full(len(node), self._size_bytes), row, link)

    @property
    def repeated(self) -> int:
        """Packets that were sent again."""
        return self._earlier["repeated"] + sum(agent.links.repeated for agent in self._everyone())

    @property
    def ignored(self) -> int:
        """Packets of other epochs, or out of turn, that agents dropped."""
        return self._earlier["ignored"] + sum(agent.ignored for agent in self._everyone())

    def _everyone(self) -> Iterator[_Agent]:
        return chain(self.cells, self.gateways)

    @property
    def at_rest(self) -> bool:
        """Nothing is under way, and nobody is about to say anything."""
        return not self.in_flight and self._next_alarm_ns() == FOREVER_NS

    def _next_alarm_ns(self) -> int:
        while self._alarms and self._alarms[0][0] != self._alarm_ns[self._alarms[0][1]]:
            heapq.heappop(self._alarms)
        alarm_ns = self._alarms[0][0] if self._alarms else FOREVER_NS
        return min(alarm_ns, self._lines[0][0]) if self._lines else alarm_ns

    def _switch_on(self, cell: int) -> None:
        node = int(self._wiring.node_of_cell[cell])
        uid = int(self._wiring.uid_of_cell[cell])
        before = self.cells[cell]
        self._earlier.update(repeated=before.links.repeated, ignored=before.ignored)
        self.cells[cell] = self._agents[node] = CellFormation(uid, self._resend_ns, self._lives[cell])
        self.powered[cell] = True

    def _hear(self, t_ns: int, link: int, present: bool) -> None:
        topology = self._wiring.topology
        node = int(topology.dst[link])
        agent = self._agents[node]
        if agent is not None:
            sends = agent.set_carrier(int(topology.dst_port[link]), present, t_ns)
            self._send(t_ns + self._reaction_ns, node, sends)

    def _send(self, t_ns: int, node: int, sends: Sends) -> None:
        agent = self._agents[node]
        assert agent is not None
        if isinstance(agent, CellFormation) and agent.network_id:
            self._node_of_id[int(self._wiring.group_of_node[node])][agent.network_id] = node
        if agent.route_changes:
            self._set_routes(t_ns, node, agent)
        deadline_ns = agent.next_deadline()
        if deadline_ns is not None and deadline_ns != self._alarm_ns[node]:
            heapq.heappush(self._alarms, (deadline_ns, node))
        self._alarm_ns[node] = FOREVER_NS if deadline_ns is None else deadline_ns
        links = self._wiring.link_out[node]
        wired = [
            (int(links[port]), packet) for port, packet in sends if links[port] >= 0
        ]  # a port may be open
        self.sent += len(wired)
        self.in_flight += len(wired)
        for link, packet in wired:
            row = self._pool.put_content(PacketKind.FORMATION, node, packet)
            self._outbox.append((t_ns, node, row, link))

    def _set_routes(self, t_ns: int, node: int, agent: _Agent) -> None:
        """Gives the kernel the routes that an agent has found."""
        group = int(self._wiring.group_of_node[node])
        known = self._node_of_id[group]
        interface = int(self._wiring.interface[group])
        dest = np.array([known[i] if i else interface for i, _ in agent.route_changes], dtype=np.int64)
        link = self._wiring.link_out[node, [port for _, port in agent.route_changes]]
        agent.route_changes.clear()
        self._network.set_routes(t_ns, Routes(np.full(len(dest), node), dest, link))
