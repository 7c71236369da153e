"""Lets the agents that form the network exchange their packets over the modelled links.

Slow path decides, fast path forwards: agents are Python objects that wake for a packet or a deadline; their
packets travel link by link through the kernel, between the data, with exact times.
"""

import numpy as np

from cells.formation import CellFormation
from cells.formation_gateway import GatewayFormation
from cells.formation_packets import FormationPacket, Sends
from cells.packets import PacketKind, PacketPool
from cells.wiring import Wiring
from skinnet.messages import FOREVER_NS
from skinnet.network.network import Network

__all__ = ["FormationDriver"]


class FormationDriver:
    """The agents of all cells and interfaces of a host.

    Args:
        wiring: Nodes and links.
        network: Kernel that carries the packets.
        pool: Rows of packets in flight.
        reaction_ns: From the arrival of a packet to the agent's answer.
        handshake_ns: How long a cell waits for its neighbours to answer.
        size_bytes: Size of a formation packet.
    """

    def __init__(
        self,
        wiring: Wiring,
        network: Network,
        pool: PacketPool,
        *,
        reaction_ns: int,
        handshake_ns: int,
        size_bytes: int,
    ) -> None:
        self._wiring = wiring
        self._network = network
        self._pool = pool
        self._reaction_ns = max(reaction_ns, 1)  # an answer in no time would leave no time to look ahead
        self._size_bytes = size_bytes
        self.sent = 0
        self.cells = [
            CellFormation(cell, handshake_ns) for patch in wiring.patches for cell in range(patch.n_cells)
        ]
        self.gateways = [GatewayFormation(len(patch.interfaces), handshake_ns) for patch in wiring.patches]
        self._agents: dict[int, CellFormation | GatewayFormation] = {
            **dict(zip(wiring.node_of_cell.tolist(), self.cells, strict=True)),
            **dict(zip(wiring.interface.tolist(), self.gateways, strict=True)),
        }

    def start(self, t_ns: int) -> None:
        """Every interface begins to form its patch."""
        for node, gateway in zip(self._wiring.interface.tolist(), self.gateways, strict=True):
            self._send(t_ns, node, gateway.start(t_ns))

    def receive(self, t_ns: int, node: int, link: int, row: int) -> None:
        """A formation packet has arrived at `node`; its agent answers after its reaction time."""
        packet: FormationPacket = self._pool.contents[row]
        port = int(self._wiring.topology.dst_port[link])
        self._send(t_ns + self._reaction_ns, node, self._agents[node].handle(packet, port, t_ns))

    def horizon_ns(self, until_ns: int) -> int:
        """How far the network may advance before an agent could have something to say, at most `until_ns`."""
        answer_ns = self._network.next_ns + self._reaction_ns
        return max(self._network.now_ns, min(until_ns, answer_ns, self._next_deadline_ns()))

    def ring(self, t_ns: int) -> None:
        """Wakes the agents whose deadline has come."""
        for node, agent in self._agents.items():
            deadline_ns = agent.next_deadline()
            if deadline_ns is not None and deadline_ns <= t_ns:
                self._send(t_ns, node, agent.on_deadline(t_ns))

    def _next_deadline_ns(self) -> int:
        deadlines = (agent.next_deadline() for agent in self._agents.values())
        return min((t_ns for t_ns in deadlines if t_ns is not None), default=FOREVER_NS)

    def _send(self, t_ns: int, node: int, sends: Sends) -> None:
        links = self._wiring.link_out[node]
        wired = [(int(links[port]), packet) for port, packet in sends if links[port] >= 0]
        if not wired:  # an open port leads nowhere
            return
        n = len(wired)
        self.sent += n
        rows = [self._pool.put_content(PacketKind.FORMATION, node, packet) for _, packet in wired]
        self._network.offer(
            t_ns=np.full(n, t_ns),
            node=np.full(n, node),
            dest=np.full(n, node),
            size_bytes=np.full(n, self._size_bytes),
            packet_id=np.array(rows),
            link=np.array([link for link, _ in wired]),
        )
