"""The packets by which cells form their network, and how they find working links [UCD].

Every packet has one layout of 62 bits, so each fits the 8 bytes of a control packet:
`kind` 4 bits, `epoch` 8, `cell` 14, `port` 4, `value` 32.

    phase           kind      cell             port              value
    1 sync          HELLO     –                –                 1: I have heard you on this link
    2 exploration   EXPLORE   –                –                 –
                    DONE      –                –                 cells in the sender's tree
    3 identity      ASSIGN    receiver's ID    –                 –
    4 neighbours    IDENTITY  sender's ID      sender's port     –
                    COLLECT   –                –                 –
                    UNIT      reporter's ID    its master port   its hardware number
                    LINKS     reporter's ID    first of 2 ports  IDs there: first + 2¹⁴ × second, 0: no cell

The computer has ID 0.
"""

from enum import IntEnum
from typing import NamedTuple

from skinnet.deployment.schema import NetworkSpec
from skinnet.errors import ProtocolError
from skinnet.skin.lattice import N_PORTS

__all__ = [
    "ID_BITS",
    "MAX_ID",
    "REPORTS_PER_CELL",
    "FormationPacket",
    "Handshake",
    "Kind",
    "Sends",
    "handshake_ns",
    "is_newer",
]

ID_BITS = 14
"""Bits of a cell's ID [T11]."""
MAX_ID = 2**ID_BITS - 1
REPORTS_PER_CELL = 1 + N_PORTS // 2
"""One UNIT, and LINKS for each two ports."""
_EPOCHS = 2**8


class Kind(IntEnum):
    """What a packet says; see the table above."""

    HELLO = 0
    EXPLORE = 1
    DONE = 2
    ASSIGN = 3
    IDENTITY = 4
    COLLECT = 5
    UNIT = 6
    LINKS = 7


class FormationPacket(NamedTuple):
    """A packet of network formation; it travels over one link, `epoch` counts the formations modulo 256."""

    kind: Kind
    epoch: int
    cell: int = 0
    port: int = 0
    value: int = 0

    def to_bytes(self) -> bytes:
        """The 8 bytes on the wire, little-endian."""
        word = self.kind | self.epoch << 4 | self.cell << 12 | self.port << 26 | self.value << 30
        return word.to_bytes(8, "little")

    @classmethod
    def from_bytes(cls, payload: bytes) -> "FormationPacket":
        """The packet in 8 bytes.

        Raises:
            ProtocolError: not 8 bytes, or of no known kind.
        """
        word = int.from_bytes(payload, "little")
        if len(payload) != 8 or word >> 62 or word & 0xF > max(Kind):
            raise ProtocolError(f"no packet of network formation: {payload.hex()}")
        cell = word >> 12 & MAX_ID
        return cls(Kind(word & 0xF), word >> 4 & 0xFF, cell, word >> 26 & 0xF, word >> 30)


Sends = list[tuple[int, FormationPacket]]
"""What a node sends, in this order: (port, packet)."""


def is_newer(epoch: int, than: int | None) -> bool:
    """Whether `epoch` comes after `than`, at most 127 formations later (they count modulo 256)."""
    return than is None or 0 < (epoch - than) % _EPOCHS < _EPOCHS // 2


class Handshake:
    """One node's part in finding which of its ports have a link that works both ways.

    Both ends send HELLO. Whoever hears one says so, once; whoever is told that it was heard knows that its
    own way works, and by hearing so, that the other way does. A wire broken in one direction convinces
    neither end.
    """

    def __init__(self, ports: int) -> None:
        self.up = [False] * ports
        self._told = [False] * ports

    def greet(self, epoch: int, heard_on: int | None = None) -> Sends:
        """HELLO on every port, as answer on the one where a HELLO came in."""
        if heard_on is not None:
            self._told[heard_on] = True
        return [
            (port, FormationPacket(Kind.HELLO, epoch, value=int(port == heard_on)))
            for port in range(len(self.up))
        ]

    def hear(self, packet: FormationPacket, port: int) -> Sends:
        """What to answer to a HELLO."""
        if packet.value:
            self.up[port] = True
        if self._told[port]:
            return []
        self._told[port] = True
        return [(port, FormationPacket(Kind.HELLO, packet.epoch, value=1))]

    def ports_up(self) -> list[int]:
        """Ports with a link that works both ways, ascending."""
        return [port for port, up in enumerate(self.up) if up]


def handshake_ns(network: NetworkSpec, reaction_ns: int) -> int:
    """Time after which the ports that have not answered count as open [ns].

    HELLO, answer and one more trip in reserve, each behind a full queue of the largest packets (an unbounded
    queue counts as one of 16), so that it also holds when the network forms again while data flow.
    """
    queue = network.queue_packets if network.queue_packets >= 0 else 16
    packet_bytes = max(network.event_bytes, network.stream_bytes, network.control_bytes)
    packet_ns = -(-packet_bytes * network.bits_per_byte * 1_000_000_000 // network.bits_per_s)
    hop_ns = round((network.hop_delay_us + network.jitter_us) * 1e3)
    return 3 * ((queue + 2) * packet_ns + hop_ns + reaction_ns)
