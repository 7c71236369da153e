"""The packets by which cells form their network and keep it alive [UCD].

Every packet has one layout of 64 bits, so each fits the 8 bytes of a control packet:
`kind` 4 bits, `epoch` 12, `cell` 14, `port` 4, `value` 28, `seq` 2.

    layer           kind      cell             port              value
    link            HELLO     –                –                 sender's session, heard session, is it up
                    ACK       –                –                 number of the packet that is expected next
    exploration     EXPLORE   sender's ID      2 × age + warm    hops of the sender to the computer
                    DONE      –                –                 cells in the sender's tree
    identity        ASSIGN    receiver's ID    –                 –
    neighbours      IDENTITY  sender's ID      age               –
                    COLLECT   –                –                 –
                    UNIT      reporter's ID    its master port   its hardware number
                    LINKS     reporter's ID    first of 2 ports  IDs there: first + 2¹⁴ × second, 0: no cell
    life            CHANGE    reporter's ID    its port          1: a link has come, 0: it has gone
                    JOINED    reporter's ID    its master port   hops + 2¹⁴ × its parent's ID
                    NEWCOMER  neighbour's ID   neighbour's port  hardware number of a cell without ID
                    ADOPT     neighbour's ID   neighbour's port  ID of the cell there

The computer has ID 0. The *age* counts the cold epochs modulo 8: an ID of another age is void. HELLO and ACK
make a link and keep its packets in order and complete; all others carry a number `seq` modulo 4 and are sent
again until they are acknowledged (`cells.link_layer`).
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
    "Kind",
    "Sends",
    "is_newer",
    "round_trip_ns",
]

ID_BITS = 14
"""Bits of a cell's ID [T11]."""
MAX_ID = 2**ID_BITS - 1
REPORTS_PER_CELL = 1 + N_PORTS // 2
"""One UNIT, and LINKS for each two ports."""
_EPOCHS = 2**12


class Kind(IntEnum):
    """What a packet says; see the table above."""

    HELLO = 0
    ACK = 1
    EXPLORE = 2
    DONE = 3
    ASSIGN = 4
    IDENTITY = 5
    COLLECT = 6
    UNIT = 7
    LINKS = 8
    CHANGE = 9
    JOINED = 10
    NEWCOMER = 11
    ADOPT = 12


class FormationPacket(NamedTuple):
    """A packet of network formation; it travels over one link, `epoch` counts the formations modulo 4096."""

    kind: Kind
    epoch: int = 0
    cell: int = 0
    port: int = 0
    value: int = 0
    seq: int = 0

    def to_bytes(self) -> bytes:
        """The 8 bytes on the wire, little-endian."""
        word = self.kind | self.epoch << 4 | self.cell << 16 | self.port << 30 | self.value << 34
        return (word | self.seq << 62).to_bytes(8, "little")

    @classmethod
    def from_bytes(cls, payload: bytes) -> "FormationPacket":
        """The packet in 8 bytes.

        Raises:
            ProtocolError: not 8 bytes, or of no known kind.
        """
        word = int.from_bytes(payload, "little")
        if len(payload) != 8 or word & 0xF > max(Kind):
            raise ProtocolError(f"no packet of network formation: {payload.hex()}")
        cell, value = word >> 16 & MAX_ID, word >> 34 & (2**28 - 1)
        return cls(Kind(word & 0xF), word >> 4 & 0xFFF, cell, word >> 30 & 0xF, value, word >> 62)


Sends = list[tuple[int, FormationPacket]]
"""What a node sends, in this order: (port, packet)."""


def is_newer(epoch: int, than: int | None) -> bool:
    """Whether `epoch` comes after `than`, at most 2047 formations later (they count modulo 4096)."""
    return than is None or 0 < (epoch - than) % _EPOCHS < _EPOCHS // 2


def round_trip_ns(network: NetworkSpec, reaction_ns: int) -> int:
    """Longest time from a packet to its answer over one link [ns].

    Each behind a full queue of the largest packets (an unbounded queue counts as one of 16), so that it also
    holds while data flow.
    """
    queue = network.queue_packets if network.queue_packets >= 0 else 16
    packet_bytes = max(network.event_bytes, network.stream_bytes, network.control_bytes)
    packet_ns = -(-packet_bytes * network.bits_per_byte * 1_000_000_000 // network.bits_per_s)
    hop_ns = round((network.hop_delay_us + network.jitter_us) * 1e3)
    return 2 * ((queue + 2) * packet_ns + hop_ns + reaction_ns)
