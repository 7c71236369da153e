"""Formation agent (base): what cells and gateway share: links, routes learned from packets, timers."""

from abc import ABC, abstractmethod

from cells.formation.link_layer import LinkLayer
from cells.formation.packets import FormationPacket, FormationPacketKind, OutgoingPackets

__all__ = ["FormationAgent"]


class FormationAgent(ABC):
    """Formation agent of one node: a state machine without I/O that returns the packets to send.

    Attributes:
        epoch: Current epoch; None before the first.
        network_id: Network ID of the node; 0 for the computer, and for a cell that has none.
        links: Link layer of the node's ports.
        route_changes: New routes: (network ID or 0 for the computer, port); the reader empties the list.
        dropped_packets: Number of packets that were dropped as stale or unexpected.
    """

    def __init__(self, links: LinkLayer, epoch: int | None) -> None:
        """Create an agent on `links`, without carrier at any port, in `epoch`."""
        self.epoch = epoch
        self.network_id = 0
        self.links = links
        self.route_changes: list[tuple[int, int]] = []
        self.dropped_packets = 0
        self._routes: dict[int, int] = {}

    def next_deadline(self) -> int | None:
        """Return the deadline [ns] at which `on_deadline` is to be called; None if there is none."""
        return self.links.next_deadline()

    def set_carrier(self, port: int, present: bool, t_ns: int) -> OutgoingPackets:
        """Process a change of carrier at a port; return the packets to send."""
        self.links.set_carrier(port, present, t_ns)
        return self._collect_outgoing(t_ns)

    def on_deadline(self, t_ns: int) -> OutgoingPackets:
        """Process expired timers; return the packets to send."""
        self.links.on_deadline(t_ns)
        self._on_timers(t_ns)
        return self._collect_outgoing(t_ns)

    def handle(self, packet: FormationPacket, port: int, t_ns: int) -> OutgoingPackets:
        """Process a packet that arrives on `port`; return the packets to send.

        Raises:
            DeploymentError: more cells than IDs of 14 bits.
        """
        new = self.links.receive(port, packet, t_ns)
        if new is not None:
            self._dispatch(new, port, t_ns)
        return self._collect_outgoing(t_ns)

    @abstractmethod
    def next_port(self, network_id: int) -> int | None:
        """Return the port towards the cell `network_id`; None without a route."""

    @abstractmethod
    def _dispatch(self, packet: FormationPacket, port: int, t_ns: int) -> None:
        """Process a packet that the link layer delivers."""

    @abstractmethod
    def _on_link_change(self, port: int, is_up: bool, t_ns: int) -> None:
        """Process a link that has come up or gone down."""

    def _on_timers(self, t_ns: int) -> None:  # noqa: B027 (no timers beside those of the links)
        """Process the agent's own timers."""

    def _collect_outgoing(self, t_ns: int) -> OutgoingPackets:
        """Process pending link changes; return all packets to send."""
        links = self.links
        while links.link_changes:
            self._on_link_change(*links.link_changes.pop(0), t_ns)
        sends, links.outgoing = links.outgoing, []
        return sends

    def _learn_route(self, network_id: int, port: int) -> None:
        """Learn the route to a cell from the port of its packets (backward learning)."""
        if self._routes.get(network_id) != port:
            self._routes[network_id] = port
            self.route_changes.append((network_id, port))

    def _packet(
        self, kind: FormationPacketKind, cell: int = 0, port: int = 0, value: int = 0
    ) -> FormationPacket:
        assert self.epoch is not None
        return FormationPacket(kind, self.epoch, cell, port, value)
