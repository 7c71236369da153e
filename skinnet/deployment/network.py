"""Network specs: cell-to-cell links, bridges, the network of the boards, and the power network.

Values marked *assumed* have no published source; all others cite theirs.
"""

from typing import Annotated, Literal

from msgspec import Meta

from skinnet.deployment.cell_names import PortName
from skinnet.deployment.types import Fraction, NonNegative, Positive, Table

__all__ = ["BoardNetworkSpec", "BridgeSpec", "NetworkSpec", "PowerSpec"]


class NetworkSpec(Table, frozen=True, kw_only=True):
    """Cell-to-cell links: UART of 2 Mbit/s, 10 bits a byte, packets of 8 and 23 bytes [T11].

    With this hop delay a 23-byte packet takes the measured 300 µs a hop [T11]; the queue is assumed.
    """

    bits_per_s: Annotated[int, Meta(gt=0)] = 2_000_000
    """Bit rate of each link and direction."""
    bits_per_byte: Annotated[int, Meta(gt=0)] = 10
    """Bits on the wire per byte, with start and stop bit."""
    hop_delay_us: NonNegative = 185.0
    """Processing delay of a cell that forwards a packet."""
    queue_packets: Annotated[int, Meta(ge=-1)] = 16
    """Capacity of the queue of each port; −1 for no bound."""
    event_bytes: Annotated[int, Meta(gt=0)] = 8
    """Size of an event packet."""
    stream_bytes: Annotated[int, Meta(gt=0)] = 23
    """Size of a packet with the full reading."""
    control_bytes: Annotated[int, Meta(gt=0)] = 8
    """Size of a packet of network formation or configuration."""
    jitter_us: NonNegative = 0.0
    """Largest random delay of a packet, added to the hop delay."""
    loss: Fraction = 0.0
    """Probability that a link loses a packet."""
    failure_detection_us: NonNegative = 500.0
    """Time from the loss of a line's signal (cut wire, or far end without power) to its detection by the
    receiver *(assumed)*."""
    aggregate_events: bool = False
    """Aggregate the events of a period in one message per gateway, instead of one per cell."""


class BridgeSpec(Table, frozen=True, kw_only=True):
    """Wire between free ports of cells of two patches, each "patch/cell:port"."""

    a: PortName
    """Port at one end."""
    b: PortName
    """Port at the other end, in another patch."""


class BoardNetworkSpec(Table, frozen=True, kw_only=True):
    """Network from the boards to the main PC *(assumed; more than 20 boards share one in [R11])*.

    `bus` is a medium shared by all boards and the PC, such as CAN, first come, first served. `star` gives
    each board its own wire. In a `chain` each board forwards the messages of the boards behind it. The wires
    of star and chain are full-duplex. 14 bits a byte correspond to the 111 bits of a CAN frame of 8 bytes.
    """

    kind: Literal["bus", "star", "chain"] = "bus"
    """Topology of the network."""
    bits_per_s: Annotated[int, Meta(gt=0)] = 1_000_000
    """Bit rate of each link."""
    bits_per_byte: Annotated[int, Meta(gt=0, le=64)] = 14
    """Bits on the wire per byte, with all overhead."""
    propagation_delay_us: NonNegative = 0.0
    """Propagation delay of each link."""
    jitter_us: NonNegative = 0.0
    """Largest random delay of a message."""
    loss: Fraction = 0.0
    """Probability that a link loses a message."""
    queue_messages: Annotated[int, Meta(ge=-1)] = 32
    """Capacity of the queue of each link; −1 for no bound."""
    header_bytes: Annotated[int, Meta(gt=0)] = 8
    """Header of any message: board, kind, scan number, count."""
    region_bytes: Annotated[int, Meta(gt=0)] = 12
    """Size of a region: id, lineage id, force, ξ1, ξ2 of two bytes each, peak and elements of one."""


class PowerSpec(Table, frozen=True, kw_only=True):
    """Power network over the 4-wire links that also carry data [T11]; undervoltage browns cells out."""

    supply_v: Positive = 3.3
    """Supply voltage [T11]."""
    current_ma: NonNegative = 47.0
    """Current of a cell with power saving; 130 mA without [T11]."""
    link_ohm: Positive = 0.05
    """Resistance of a link, both conductors together *(assumed: none is published)*."""
    feed_ohm: NonNegative = 0.0
    """Resistance between the supply and a feed point *(assumed)*."""
    brown_out_v: Positive = 2.7
    """Brown-out voltage, below which a cell leaves the network *(assumed)*."""
    feeds: tuple[PortName, ...] = ()
    """Feed points, ports of cells; all interfaces unless given."""

    def __post_init__(self) -> None:
        if self.brown_out_v >= self.supply_v:
            raise ValueError(
                f"brown_out_v = {self.brown_out_v:g}: must be below supply_v = {self.supply_v:g}"
            )
