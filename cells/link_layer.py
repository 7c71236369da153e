"""The links of one node: which of its ports work both ways, and packets that arrive complete and in order.

A port that hears its line (*carrier*: a UART whose wire is cut or whose far end has no power reads a break)
greets with HELLO until both ends know that each hears the other. From then on the link is *up*: packets are
numbered, acknowledged and sent again until they arrive (go-back-N), each once and in order. A link goes down
when its carrier does, when the far end begins anew, or when nothing is acknowledged any more.

A *session* is one life of one end of a link; HELLO names it, so that neither end takes the packets of an
earlier life for those of the present one. No I/O: methods put what is to be sent into `out`.
"""

from collections import deque
from dataclasses import dataclass, field

from cells.formation_packets import FormationPacket, Kind, Sends

__all__ = ["LinkLayer"]

_WINDOW = 3
"""Packets that may wait for their acknowledgement: one less than the numbers that `seq` has."""
_NUMBERS = _WINDOW + 1
_SESSIONS = 256
_MAX_TRIES = 8
"""Without an answer after so many repetitions, a link is down *(assumed)*."""
_MAX_BACKOFF = 64
_FAREWELLS = 3
"""A port that has lost its carrier says so a few times: it cannot hear whether that is understood."""


@dataclass
class _Port:
    session: int
    peer: int | None = None
    """Session of the far end, once heard."""
    carrier: bool = False
    up: bool = False
    expected: int = 0
    next_seq: int = 0
    unacknowledged: deque[FormationPacket] = field(default_factory=deque)
    waiting: deque[FormationPacket] = field(default_factory=deque)
    timer_ns: int | None = None
    tries: int = 0


class LinkLayer:
    """All ports of a node.

    Attributes:
        out: What is to be sent now, in order; whoever sends it empties the list.
        changes: Ports whose link has come up or gone down, in order: (port, is up).
        repeated: Packets that were sent again.
    """

    def __init__(self, ports: int, resend_ns: int, life: int = 0) -> None:
        """Ports without carrier.

        Args:
            ports: How many.
            resend_ns: Time after which an answer is overdue.
            life: How often the node has been switched on before.
        """
        self.out: Sends = []
        self.changes: list[tuple[int, bool]] = []
        self.repeated = 0
        self._resend_ns = resend_ns
        self._ports = [_Port(session=16 * life % _SESSIONS) for _ in range(ports)]

    def __len__(self) -> int:
        return len(self._ports)

    def is_up(self, port: int) -> bool:
        """Whether the link at `port` works both ways."""
        return self._ports[port].up

    def ports_up(self) -> list[int]:
        """Ports with a link that works both ways, ascending."""
        return [number for number, port in enumerate(self._ports) if port.up]

    def next_deadline(self) -> int | None:
        """When `on_deadline` is to be called [ns], if at all."""
        return min((p.timer_ns for p in self._ports if p.timer_ns is not None), default=None)

    def set_carrier(self, number: int, present: bool, t_ns: int) -> None:
        """The line at a port is heard from now on, or no longer."""
        port = self._ports[number]
        if port.carrier == present:
            return
        port.carrier = present
        if present:
            port.tries = 0
            self._greet(number, t_ns)
        else:
            self._restart(number, t_ns)

    def send(self, number: int, packet: FormationPacket, t_ns: int) -> None:
        """Sends `packet` over the link at a port, which is up."""
        port = self._ports[number]
        assert port.up
        port.waiting.append(packet)
        self._fill_window(number, t_ns)

    def receive(self, number: int, packet: FormationPacket, t_ns: int) -> FormationPacket | None:
        """Takes in what came over a link; returns the packet that is new to the node, if it is one."""
        port = self._ports[number]
        if packet.kind is Kind.HELLO:
            self._on_hello(number, packet.value, t_ns)
        elif not port.up:
            return None
        elif packet.kind is Kind.ACK:
            self._on_ack(number, packet.value, t_ns)
        else:
            is_next = packet.seq == port.expected
            if is_next:
                port.expected = (port.expected + 1) % _NUMBERS
            self.out.append((number, FormationPacket(Kind.ACK, value=port.expected)))
            return packet if is_next else None
        return None

    def on_deadline(self, t_ns: int) -> None:
        """Repeats what is overdue."""
        for number, port in enumerate(self._ports):
            if port.timer_ns is None or port.timer_ns > t_ns:
                continue
            port.tries += 1
            if not port.up:
                self._greet(number, t_ns)
            elif port.tries > _MAX_TRIES:
                self._restart(number, t_ns)
            else:
                self.repeated += len(port.unacknowledged)
                self.out += [(number, packet) for packet in port.unacknowledged]
                port.timer_ns = t_ns + self._resend_ns

    def _greet(self, number: int, t_ns: int) -> None:
        """HELLO, and again later, less and less often, until it is answered."""
        port = self._ports[number]
        heard = 0 if port.peer is None else 1 << 8 | port.peer
        value = port.session | heard << 8 | port.up << 17
        self.out.append((number, FormationPacket(Kind.HELLO, value=value)))
        if not port.up:
            done = not port.carrier and port.tries >= _FAREWELLS - 1
            port.timer_ns = None if done else t_ns + self._resend_ns * min(2**port.tries, _MAX_BACKOFF)

    def _on_hello(self, number: int, value: int, t_ns: int) -> None:
        port = self._ports[number]
        session, heard, knows, peer_is_up = value & 0xFF, value >> 8 & 0xFF, value >> 16 & 1, value >> 17 & 1
        if session != port.peer:
            if port.up:
                self._go_down(number)
            port.peer, port.expected = session, 0
        if knows and heard == port.session and port.carrier and not port.up:
            port.up, port.tries, port.timer_ns = True, 0, None
            self.changes.append((number, True))
        if not peer_is_up and port.carrier:
            self._greet(number, t_ns)

    def _on_ack(self, number: int, expected: int, t_ns: int) -> None:
        port = self._ports[number]
        n = len(port.unacknowledged)
        acknowledged = (expected - (port.next_seq - n)) % _NUMBERS
        if not 0 < acknowledged <= n:
            return
        for _ in range(acknowledged):
            port.unacknowledged.popleft()
        port.tries = 0
        port.timer_ns = t_ns + self._resend_ns if port.unacknowledged else None
        self._fill_window(number, t_ns)

    def _fill_window(self, number: int, t_ns: int) -> None:
        port = self._ports[number]
        while port.waiting and len(port.unacknowledged) < _WINDOW:
            packet = port.waiting.popleft()._replace(seq=port.next_seq)
            port.next_seq = (port.next_seq + 1) % _NUMBERS
            port.unacknowledged.append(packet)
            self.out.append((number, packet))
            if port.timer_ns is None:
                port.timer_ns = t_ns + self._resend_ns

    def _restart(self, number: int, t_ns: int) -> None:
        """This end begins a new session, and says so."""
        port = self._ports[number]
        if port.up:
            self._go_down(number)
        port.session = (port.session + 1) % _SESSIONS
        port.peer, port.tries = None, 0
        self._greet(number, t_ns)

    def _go_down(self, number: int) -> None:
        port = self._ports[number]
        port.unacknowledged.clear()
        port.waiting.clear()
        port.up, port.expected, port.next_seq, port.tries, port.timer_ns = False, 0, 0, 0, None
        self.changes.append((number, False))
