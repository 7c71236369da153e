"""Packets of network formation and maintenance between cells [UCD].

All packets share one layout of 64 bits, which fits the 8 bytes of a control packet:
`kind` 4 bits, `epoch` 12, `cell` 14, `port` 4, `value` 28, `seq` 2.

    layer           kind      cell             port              value
    link            HELLO     –                –                 sender's session, peer's session, is it up
                    ACK       –                –                 sequence number that is expected next
    exploration     EXPLORE   sender's ID      2 × age + warm    hops of the sender to the computer
                    DONE      –                –                 cells in the sender's subtree
    identity        ASSIGN    receiver's ID    –                 –
    neighbours      IDENTITY  sender's ID      age               –
                    COLLECT   –                –                 –
                    UNIT      reporter's ID    its master port   its hardware ID
                    LINKS     reporter's ID    first of 2 ports  IDs there: first + 2¹⁴ × second, 0: no cell
    maintenance     CHANGE    reporter's ID    its port          1: the link is up, 0: it is down
                    JOINED    reporter's ID    its master port   hops + 2¹⁴ × its parent's ID
                    NEWCOMER  neighbour's ID   neighbour's port  hardware ID of a cell without ID
                    ADOPT     neighbour's ID   neighbour's port  ID of the cell there

The computer has ID 0. The *age* counts cold epochs modulo 8: an ID of another age is void. HELLO and ACK
establish a link and make it reliable; all others carry a sequence number `seq` modulo 4 and are
retransmitted until they are acknowledged (`cells.link_layer`).
"""

from enum import IntEnum
from typing import NamedTuple

from skinnet.deployment.network import NetworkSpec
from skinnet.errors import ProtocolError
from skinnet.skin.lattice import N_PORTS

__all__ = [
    "ID_BITS",
    "MAX_ID",
    "REPORTS_PER_CELL",
    "FormationPacket",
    "FormationPacketKind",
    "OutgoingPackets",
    "is_newer",
    "max_round_trip_ns",
]

ID_BITS = 14
"""Bits of a cell's network ID [T11]."""
MAX_ID = 2**ID_BITS - 1
REPORTS_PER_CELL = 1 + N_PORTS // 2
"""Reports of a cell in a cold epoch: one UNIT, and one LINKS for each two ports."""
_EPOCH_MODULUS = 2**12


class FormationPacketKind(IntEnum):
    """Kind of a formation packet; see the table above."""

    HELLO = 0
    ACK = 1
    EXPLORE = 2
    DONE = 3
    ASSIGN = 4
    IDENTITY = 5
    COLLECT = 6
    CELL_REPORT = 7
    NEIGHBOUR_REPORT = 8
    LINK_CHANGE = 9
    JOINED = 10
    ID_REQUEST = 11
    ID_GRANT = 12


class FormationPacket(NamedTuple):
    """Formation packet, which travels over one link; `epoch` counts modulo 4096."""

    kind: FormationPacketKind
    epoch: int = 0
    cell: int = 0
    port: int = 0
    value: int = 0
    seq: int = 0

    def to_bytes(self) -> bytes:
        """Encode the packet in 8 bytes, little-endian."""
        word = self.kind | self.epoch << 4 | self.cell << 16 | self.port << 30 | self.value << 34
        return (word | self.seq << 62).to_bytes(8, "little")

    @classmethod
    def from_bytes(cls, payload: bytes) -> "FormationPacket":
        """Decode a packet of 8 bytes.

        Raises:
            ProtocolError: not 8 bytes, or an unknown kind.
        """
        word = int.from_bytes(payload, "little")
        if len(payload) != 8 or word & 0xF > max(FormationPacketKind):
            raise ProtocolError(
                f"not a formation packet: {payload.hex()}; needs 8 bytes and a kind of 0 to "
                f"{max(FormationPacketKind)}"
            )
        cell, value = word >> 16 & MAX_ID, word >> 34 & (2**28 - 1)
        return cls(
            FormationPacketKind(word & 0xF), word >> 4 & 0xFFF, cell, word >> 30 & 0xF, value, word >> 62
        )


OutgoingPackets = list[tuple[int, FormationPacket]]
"""Outgoing packets of a node, in order: (port, packet)."""


def is_newer(epoch: int, reference: int | None) -> bool:
    """Compare epochs by serial numbers (RFC 1982): True if `epoch` is 1 to 2047 after `reference`."""
    return reference is None or 0 < (epoch - reference) % _EPOCH_MODULUS < _EPOCH_MODULUS // 2


def max_round_trip_ns(network: NetworkSpec, reaction_ns: int) -> int:
    """Return the maximum round-trip time over one link [ns], the reaction time included.

    Packet and answer each wait behind a full queue of the largest packets (an unbounded queue counts as 16),
    so the bound also holds under load.
    """
    queue = network.queue_packets if network.queue_packets >= 0 else 16
    packet_bytes = max(network.event_bytes, network.stream_bytes, network.control_bytes)
    packet_ns = -(-packet_bytes * network.bits_per_byte * 1_000_000_000 // network.bits_per_s)
    hop_ns = round((network.hop_delay_us + network.jitter_us) * 1e3)
    return 2 * ((queue + 2) * packet_ns + hop_ns + reaction_ns)
