"""Results of a packet network: ended packets and traffic counters."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.network.records import Outcome

__all__ = ["EndedPackets", "LinkCounters", "PacketCounters"]


class EndedPackets(NamedTuple):
    """Ended packets, sorted by time, node, and order of handling at the node; each (n,).

    Attributes:
        packet_id: Packet id as offered.
        t_ns: Time of the end [ns].
        node: Node of the end: the destination, the node of the drop, the far end of a link that destroyed
            the packet (`LOSS`, `CORRUPTED`), or the near end of one that failed with it (`LINK_FAILED`).
        link: Link that was full, down, failed or lossy; else the one of arrival, `NO_LINK` for a packet
            injected at the node itself.
        outcome: `Outcome`; 0 is delivered.
    """

    packet_id: NDArray[np.int64]
    t_ns: NDArray[np.int64]
    node: NDArray[np.int64]
    link: NDArray[np.int64]
    outcome: NDArray[np.int64]


@dataclass(frozen=True)
class PacketCounters:
    """Packet counters; offered = delivered + sum of dropped + in_flight at all times.

    Each is counted on its own: offered by the caller, ended where the kernel ends a packet, in flight by a
    walk through the queues. So the equation fails if the kernel loses or repeats a packet. A packet counts as
    offered and in flight from the call that offers it.
    """

    offered: int
    delivered: int
    dropped: dict[Outcome, int]
    in_flight: int

    @property
    def are_conserved(self) -> bool:
        """True if every offered packet is delivered, dropped or in flight, and none is twice."""
        return self.offered == self.delivered + sum(self.dropped.values()) + self.in_flight


class LinkCounters(NamedTuple):
    """Link counters up to now, each (n_links,).

    Attributes:
        packets: Packets fully arrived, with those that the link destroyed (`LOSS`, `CORRUPTED`).
        bytes: Bytes of these packets.
        busy_ns: Time in transmission [ns].
        queue_high_water: Greatest number of packets queued behind the one in transmission.
        dropped: Packets ended by this link: queue full, link failed or down, loss, bit errors.
    """

    packets: NDArray[np.int64]
    bytes: NDArray[np.int64]
    busy_ns: NDArray[np.int64]
    queue_high_water: NDArray[np.int64]
    dropped: NDArray[np.int64]
