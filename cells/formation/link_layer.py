"""Link layer of one node: link establishment and reliable, in-order delivery (go-back-N ARQ).

A port with *carrier* (a UART whose wire is cut or whose far end has no power reads a break) sends HELLO until
both ends know that each receives the other (three-way handshake). From then on the link is *up*: packets are
numbered, acknowledged and retransmitted (go-back-N), so that each arrives once and in order. A link goes down
when it loses its carrier, when the peer restarts, or when acknowledgements stop.

A *session* is one incarnation of one end of a link; HELLO carries its number, so that packets of an earlier
incarnation are not accepted. No I/O: methods append outgoing packets to `outgoing`.
"""

from collections import deque
from dataclasses import dataclass, field

from cells.formation.packets import FormationPacket, FormationPacketKind, OutgoingPackets

__all__ = ["LinkLayer"]

_WINDOW = 3
"""Go-back-N send window [packets]: one less than the modulus of `seq`."""
_SEQ_MODULUS = _WINDOW + 1
_SESSION_MODULUS = 256
_MAX_RETRANSMISSIONS = 8
"""Retransmissions without an acknowledgement after which a link is down *(assumed)*."""
_MAX_BACKOFF = 64
_DOWN_HELLOS = 3
"""HELLO packets that a port sends after losing its carrier: it cannot receive an acknowledgement."""


@dataclass
class _PortState:
    session: int
    peer_session: int | None = None
    """Session of the peer, once received."""
    carrier: bool = False
    up: bool = False
    expected_seq: int = 0
    next_seq: int = 0
    unacknowledged: deque[FormationPacket] = field(default_factory=deque)
    send_queue: deque[FormationPacket] = field(default_factory=deque)
    timer_ns: int | None = None
    retries: int = 0


class LinkLayer:
    """Link layer of all ports of a node.

    Attributes:
        outgoing: Outgoing packets, in order; the reader empties the list.
        link_changes: Link changes, in order: (port, is up); the reader empties the list.
        retransmitted: Number of retransmitted packets.
    """

    def __init__(self, ports: int, retransmission_timeout_ns: int, boot_count: int = 0) -> None:
        """Create ports without carrier.

        Args:
            ports: Number of ports.
            retransmission_timeout_ns: Retransmission timeout [ns].
            boot_count: Number of earlier power-ups of the node.
        """
        self.outgoing: OutgoingPackets = []
        self.link_changes: list[tuple[int, bool]] = []
        self.retransmitted = 0
        self._retransmission_timeout_ns = retransmission_timeout_ns
        self._ports = [_PortState(session=16 * boot_count % _SESSION_MODULUS) for _ in range(ports)]

    def __len__(self) -> int:
        return len(self._ports)

    def is_up(self, port: int) -> bool:
        """Return True if the link at `port` is up."""
        return self._ports[port].up

    def ports_up(self) -> list[int]:
        """Return the ports whose link is up, ascending."""
        return [number for number, port in enumerate(self._ports) if port.up]

    def next_deadline(self) -> int | None:
        """Return the deadline [ns] at which `on_deadline` is to be called; None if there is none."""
        return min((p.timer_ns for p in self._ports if p.timer_ns is not None), default=None)

    def set_carrier(self, number: int, present: bool, t_ns: int) -> None:
        """Set the carrier of a port: present or absent from now on."""
        port = self._ports[number]
        if port.carrier == present:
            return
        port.carrier = present
        if present:
            port.retries = 0
            self._send_hello(number, t_ns)
        else:
            self._start_session(number, t_ns)

    def send(self, number: int, packet: FormationPacket, t_ns: int) -> None:
        """Queue `packet` for the link at a port, which must be up."""
        port = self._ports[number]
        assert port.up
        port.send_queue.append(packet)
        self._fill_window(number, t_ns)

    def receive(self, number: int, packet: FormationPacket, t_ns: int) -> FormationPacket | None:
        """Receive a packet from a link; return it if it is the next in order, else None."""
        port = self._ports[number]
        if packet.kind is FormationPacketKind.HELLO:
            self._on_hello(number, packet.value, t_ns)
        elif not port.up:
            return None
        elif packet.kind is FormationPacketKind.ACK:
            self._on_ack(number, packet.value, t_ns)
        else:
            is_next = packet.seq == port.expected_seq
            if is_next:
                port.expected_seq = (port.expected_seq + 1) % _SEQ_MODULUS
            self.outgoing.append((number, FormationPacket(FormationPacketKind.ACK, value=port.expected_seq)))
            return packet if is_next else None
        return None

    def on_deadline(self, t_ns: int) -> None:
        """Process expired timers: repeat HELLO, retransmit (go-back-N), restart links without answer."""
        for number, port in enumerate(self._ports):
            if port.timer_ns is None or port.timer_ns > t_ns:
                continue
            port.retries += 1
            if not port.up:
                self._send_hello(number, t_ns)
            elif port.retries > _MAX_RETRANSMISSIONS:
                self._start_session(number, t_ns)
            else:
                self.retransmitted += len(port.unacknowledged)
                self.outgoing += [(number, packet) for packet in port.unacknowledged]
                port.timer_ns = t_ns + self._retransmission_timeout_ns

    def _send_hello(self, number: int, t_ns: int) -> None:
        """Send HELLO, and schedule the next with exponential backoff while the link is not up."""
        port = self._ports[number]
        heard = 0 if port.peer_session is None else 1 << 8 | port.peer_session
        value = port.session | heard << 8 | port.up << 17
        self.outgoing.append((number, FormationPacket(FormationPacketKind.HELLO, value=value)))
        if not port.up:
            done = not port.carrier and port.retries >= _DOWN_HELLOS - 1
            port.timer_ns = (
                None if done else t_ns + self._retransmission_timeout_ns * min(2**port.retries, _MAX_BACKOFF)
            )

    def _on_hello(self, number: int, value: int, t_ns: int) -> None:
        port = self._ports[number]
        session, heard, knows, peer_is_up = value & 0xFF, value >> 8 & 0xFF, value >> 16 & 1, value >> 17 & 1
        if session != port.peer_session:
            if port.up:
                self._take_down(number)
            port.peer_session, port.expected_seq = session, 0
        if knows and heard == port.session and port.carrier and not port.up:
            port.up, port.retries, port.timer_ns = True, 0, None
            self.link_changes.append((number, True))
        if not peer_is_up and port.carrier:
            self._send_hello(number, t_ns)

    def _on_ack(self, number: int, expected: int, t_ns: int) -> None:
        port = self._ports[number]
        n = len(port.unacknowledged)
        acknowledged = (expected - (port.next_seq - n)) % _SEQ_MODULUS
        if not 0 < acknowledged <= n:
            return
        for _ in range(acknowledged):
            port.unacknowledged.popleft()
        port.retries = 0
        port.timer_ns = t_ns + self._retransmission_timeout_ns if port.unacknowledged else None
        self._fill_window(number, t_ns)

    def _fill_window(self, number: int, t_ns: int) -> None:
        port = self._ports[number]
        while port.send_queue and len(port.unacknowledged) < _WINDOW:
            packet = port.send_queue.popleft()._replace(seq=port.next_seq)
            port.next_seq = (port.next_seq + 1) % _SEQ_MODULUS
            port.unacknowledged.append(packet)
            self.outgoing.append((number, packet))
            if port.timer_ns is None:
                port.timer_ns = t_ns + self._retransmission_timeout_ns

    def _start_session(self, number: int, t_ns: int) -> None:
        """Begin a new session at this end and announce it."""
        port = self._ports[number]
        if port.up:
            self._take_down(number)
        port.session = (port.session + 1) % _SESSION_MODULUS
        port.peer_session, port.retries = None, 0
        self._send_hello(number, t_ns)

    def _take_down(self, number: int) -> None:
        port = self._ports[number]
        port.unacknowledged.clear()
        port.send_queue.clear()
        port.up, port.expected_seq, port.next_seq, port.retries, port.timer_ns = False, 0, 0, 0, None
        self.link_changes.append((number, False))
