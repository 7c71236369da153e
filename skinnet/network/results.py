"""What a network hands back: how packets ended, and what was counted on the way."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.network.records import Outcome

__all__ = ["Counters", "Finished", "LinkCounters"]


class Finished(NamedTuple):
    """Packets that ended, by time, then node, then the order in which the node handled them; each (n,).

    Attributes:
        packet_id: As offered.
        t_ns: When it ended [ns].
        node: Where it ended: at its destination, where it was dropped, at the far end of a link that
            destroyed it (`LOSS`, `CORRUPTED`), or at the near end of one that failed with it (`LINK_FAILED`).
        link: The link that was full, dead, failed or lossy; else the one over which it came in, `NO_LINK`
            for a packet of the node's own.
        outcome: `Outcome`; 0 is delivered.
    """

    packet_id: NDArray[np.int64]
    t_ns: NDArray[np.int64]
    node: NDArray[np.int64]
    link: NDArray[np.int64]
    outcome: NDArray[np.int64]


@dataclass(frozen=True)
class Counters:
    """Packets so far; offered = delivered + sum of dropped + in_flight at every moment.

    A packet counts as offered, and as in flight, from the call that offers it.
    """

    offered: int
    delivered: int
    dropped: dict[Outcome, int]
    in_flight: int


class LinkCounters(NamedTuple):
    """Traffic of every link up to now, each (n_links,).

    Attributes:
        packets: Fully arrived, with those that the link destroyed (`LOSS`, `CORRUPTED`).
        bytes: Of these packets.
        busy_ns: Time in transmission [ns].
        queue_high_water: Most packets that ever waited behind the one in transmission.
        dropped: Ended by this link: queue full, link failed or dead, loss, bit errors.
    """

    packets: NDArray[np.int64]
    bytes: NDArray[np.int64]
    busy_ns: NDArray[np.int64]
    queue_high_water: NDArray[np.int64]
    dropped: NDArray[np.int64]
