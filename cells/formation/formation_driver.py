"""Driver of the formation agents: it carries their packets over the modelled links.

Control plane and data plane: agents are Python objects that run on a packet, a timer or a change of carrier;
their packets travel link by link through the kernel, among the data, with exact times. The routes that they
decide on take effect in the kernel after the agent's reaction time.
"""

import heapq
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from cells.formation.cell_agent import CellAgent
from cells.formation.formation_agent import FormationAgent
from cells.formation.gateway_agent import GatewayAgent
from cells.formation.packets import FormationPacket, OutgoingPackets, max_round_trip_ns
from cells.networking.packet_pool import PacketKind, PacketPool
from cells.networking.wiring import Wiring
from skinnet.deployment.network import NetworkSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.network.packet_network import EndedPackets, PacketNetwork
from skinnet.network.records import Outcome
from skinnet.network.routes import Routes
from skinnet.protocol.messages import FOREVER_NS

__all__ = ["FormationDriver", "FormationTiming"]


class FormationTiming(NamedTuple):
    """Timing of the formation agents.

    Attributes:
        reaction_ns: Time from the arrival of a packet to the agent's answer [ns].
        retransmission_ns: Retransmission timeout of a link [ns].
        settle_ns: Time for links to come up before the first epoch [ns].
        carrier_detect_ns: Time from a change of carrier to its detection by the receiver [ns].
    """

    reaction_ns: int
    retransmission_ns: int
    settle_ns: int
    carrier_detect_ns: int

    @classmethod
    def build(cls, cells: CellSpec, network: NetworkSpec) -> "FormationTiming":
        """Timing of `cells` on the links of `network`: timeouts follow from the largest round-trip time."""
        reaction_ns = round(cells.processing_delay_us * 1e3)
        retransmission_ns = max_round_trip_ns(network, reaction_ns)
        carrier_detect_ns = round(network.failure_detection_us * 1e3)
        return cls(reaction_ns, retransmission_ns, 2 * retransmission_ns, carrier_detect_ns)


class FormationDriver:
    """Formation agents of all cells and gateways of a process, and their timers.

    Attributes:
        cells: Agents of the cells, by index within the process; a power cycle creates a new agent.
        gateways: Agents of the gateways, one for each group of patches.
        powered: (cells,) True for cells that have power.
        sent: Number of formation packets sent.
        in_flight: Number of formation packets in flight.
    """

    def __init__(
        self,
        wiring: Wiring,
        network: PacketNetwork,
        pool: PacketPool,
        timing: FormationTiming,
        size_bytes: int,
    ) -> None:
        """Create the agents, all without power.

        Args:
            wiring: Nodes and links.
            network: Kernel that carries the packets.
            pool: Rows of packets in flight.
            timing: Reaction time and timeouts of the agents.
            size_bytes: Size of a formation packet.
        """
        self._wiring = wiring
        self._network = network
        self._pool = pool
        self._reaction_ns = max(timing.reaction_ns, 1)  # a reaction time of zero would leave no lookahead
        self._timing = timing
        self._size_bytes = size_bytes
        self.sent = self.in_flight = 0
        n = wiring.n_cells
        self.cells = [CellAgent(uid, timing.retransmission_ns) for uid in wiring.uid_of_cell.tolist()]
        self.gateways = [
            GatewayAgent(
                ports, retransmission_timeout_ns=timing.retransmission_ns, settle_ns=timing.settle_ns
            )
            for ports in wiring.group_ports
        ]
        self.powered = np.zeros(n, dtype=np.bool_)
        self._boot_count = [0] * n
        self._replaced_counts = Counter[str]()  # counts of agents that a power cycle replaced
        self._agents: list[FormationAgent | None] = [None] * wiring.topology.n_nodes
        self._node_of_id: list[dict[int, int]] = [{} for _ in self.gateways]
        for node, gateway in zip(wiring.interface_node.tolist(), self.gateways, strict=True):
            self._agents[node] = gateway
        self._timers: list[tuple[int, int]] = []
        self._timer_ns = [FOREVER_NS] * wiring.topology.n_nodes
        self._carrier_changes: list[tuple[int, int, bool]] = []
        self._outbox: list[tuple[int, int, int, int]] = []

    def start(self, t_ns: int, cells: Sequence[int], carriers: Sequence[bool]) -> None:
        """Switch on all gateways and the given cells; carriers that are present are detected at once."""
        for cell in cells:
            self._switch_on(cell)
        for node, gateway in zip(self._wiring.interface_node.tolist(), self.gateways, strict=True):
            self._send(t_ns, node, gateway.start(t_ns))
        for link, up in enumerate(carriers):
            if up:
                self._set_carrier(t_ns, link, True)
        self.flush()

    def set_power(self, cell: int, on: bool) -> None:
        """Switch a cell's power; its agent loses all state. Carriers change by `schedule_carrier`."""
        if on:
            self._boot_count[cell] += 1
            self._switch_on(cell)
        else:
            self._agents[int(self._wiring.node_of_cell[cell])] = None
            self.powered[cell] = False

    def schedule_carrier(self, t_ns: int, link: int, present: bool) -> None:
        """Schedule a change of carrier on a link; its receiver detects it after `carrier_detect_ns`."""
        heapq.heappush(self._carrier_changes, (t_ns + self._timing.carrier_detect_ns, link, present))

    def receive(self, finished: EndedPackets) -> None:
        """Deliver formation packets that have ended to the agents that they reached, and free their rows.

        An agent answers after its reaction time.
        """
        self.in_flight -= len(finished.outcome)
        for i in np.flatnonzero(finished.outcome == Outcome.DELIVERED).tolist():
            node, t_ns = int(finished.node[i]), int(finished.t_ns[i])
            agent = self._agents[node]
            if agent is not None:
                packet: FormationPacket = self._pool.objects[int(finished.packet_id[i])]
                port = int(self._wiring.topology.dst_port[int(finished.link[i])])
                self._send(t_ns + self._reaction_ns, node, agent.handle(packet, port, t_ns))
        self.flush()
        self._pool.free(finished.packet_id)

    def horizon_ns(self, until_ns: int) -> int:
        """Return the lookahead horizon [ns], at most `until_ns`: no agent can send a packet before it."""
        answer_ns = self._network.next_event_ns + self._reaction_ns if self.in_flight else FOREVER_NS
        return max(self._network.now_ns, min(until_ns, answer_ns, self._next_timer_ns()))

    def process_timers(self, t_ns: int) -> None:
        """Process the carrier changes, then the timers, that are due by `t_ns`."""
        while self._carrier_changes and self._carrier_changes[0][0] <= t_ns:
            at_ns, link, present = heapq.heappop(self._carrier_changes)
            self._set_carrier(at_ns, link, present)
        while self._timers and self._timers[0][0] <= t_ns:
            at_ns, node = heapq.heappop(self._timers)
            agent = self._agents[node]
            if at_ns == self._timer_ns[node]:
                self._timer_ns[node] = FOREVER_NS
                if agent is not None:
                    self._send(t_ns + self._reaction_ns, node, agent.on_deadline(t_ns))
        self.flush()

    def flush(self) -> None:
        """Hand the agents' outgoing packets to the kernel."""
        if not self._outbox:
            return
        t_ns, node, row, link = np.array(self._outbox, dtype=np.int64).T
        self._outbox.clear()
        self._network.enqueue(t_ns, node, node, np.full(len(node), self._size_bytes), row, link)

    @property
    def retransmitted(self) -> int:
        """Number of retransmitted packets."""
        return self._replaced_counts["repeated"] + sum(
            agent.links.retransmitted for agent in self._all_agents()
        )

    @property
    def dropped_packets(self) -> int:
        """Number of stale or unexpected packets that agents dropped."""
        return self._replaced_counts["ignored"] + sum(agent.dropped_packets for agent in self._all_agents())

    def _all_agents(self) -> Iterator[FormationAgent]:
        return chain(self.cells, self.gateways)

    @property
    def is_idle(self) -> bool:
        """True if no formation packet is in flight and no timer or carrier change is pending."""
        return not self.in_flight and self._next_timer_ns() == FOREVER_NS

    def _next_timer_ns(self) -> int:
        while self._timers and self._timers[0][0] != self._timer_ns[self._timers[0][1]]:
            heapq.heappop(self._timers)
        alarm_ns = self._timers[0][0] if self._timers else FOREVER_NS
        return min(alarm_ns, self._carrier_changes[0][0]) if self._carrier_changes else alarm_ns

    def _switch_on(self, cell: int) -> None:
        node = int(self._wiring.node_of_cell[cell])
        uid = int(self._wiring.uid_of_cell[cell])
        before = self.cells[cell]
        self._replaced_counts.update(repeated=before.links.retransmitted, ignored=before.dropped_packets)
        self.cells[cell] = self._agents[node] = CellAgent(
            uid, self._timing.retransmission_ns, self._boot_count[cell]
        )
        self.powered[cell] = True

    def _set_carrier(self, t_ns: int, link: int, present: bool) -> None:
        topology = self._wiring.topology
        node = int(topology.dst[link])
        agent = self._agents[node]
        if agent is not None:
            sends = agent.set_carrier(int(topology.dst_port[link]), present, t_ns)
            self._send(t_ns + self._reaction_ns, node, sends)

    def _send(self, t_ns: int, node: int, sends: OutgoingPackets) -> None:
        agent = self._agents[node]
        assert agent is not None
        if agent.network_id:
            self._node_of_id[int(self._wiring.group_of_node[node])][agent.network_id] = node
        if agent.route_changes:
            self._set_routes(t_ns, node, agent)
        deadline_ns = agent.next_deadline()
        if deadline_ns is not None and deadline_ns != self._timer_ns[node]:
            heapq.heappush(self._timers, (deadline_ns, node))
        self._timer_ns[node] = FOREVER_NS if deadline_ns is None else deadline_ns
        links = self._wiring.link_out[node]
        wired = [
            (int(links[port]), packet) for port, packet in sends if links[port] >= 0
        ]  # a port may be unwired
        self.sent += len(wired)
        self.in_flight += len(wired)
        for link, packet in wired:
            row = self._pool.allocate_object(PacketKind.FORMATION, node, packet)
            self._outbox.append((t_ns, node, row, link))

    def _set_routes(self, t_ns: int, node: int, agent: FormationAgent) -> None:
        """Install an agent's new routes in the kernel at `t_ns`."""
        group = int(self._wiring.group_of_node[node])
        known = self._node_of_id[group]
        interface = int(self._wiring.interface_node[group])
        dest = np.array([known[i] if i else interface for i, _ in agent.route_changes], dtype=np.int64)
        link = self._wiring.link_out[node, [port for _, port in agent.route_changes]]
        agent.route_changes.clear()
        self._network.set_routes(t_ns, Routes(np.full(len(dest), node), dest, link))
