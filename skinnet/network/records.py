"""The flat records on which the packet kernel works.

Links stand in the order in which ties are broken: by component, node of arrival, port of arrival. A node
injects its own packets over an *entry*, a link of port −1 without rate or delay; so an entry stands before
the node's input ports, and everything that happens at a node is the arrival of a packet over a link.
The position in this order is the *rank*; the number that the topology gave is kept in `number`.
"""

from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "COMPONENT",
    "ENDED",
    "FAR_NS",
    "FREE",
    "IN_FLIGHT",
    "LINK",
    "MAX_BUCKET_SHIFT",
    "NODE",
    "NONE",
    "N_ROUTES",
    "PACKET",
    "Outcome",
    "Records",
    "Scratch",
    "State",
]

# Fields of a record are attributes to Numba only; mypy does not know them.
Records: TypeAlias = Any

FREE, IN_FLIGHT, N_ROUTES = 0, 1, 2
"""What stands where in `State.heap`."""
NONE = 2**32 - 1
"""No link, packet or route. Positions are unsigned, which spares every access a look at their sign."""
FAR_NS = 2**62
"""Later than everything: no event."""
MAX_BUCKET_SHIFT = 30
"""Times within a bucket must fit into the upper half of a 64-bit sort key."""


class Outcome(IntEnum):
    """How a packet ended: delivered, or the cause of its drop."""

    DELIVERED = 0
    QUEUE_FULL = 1
    NO_ROUTE = 2
    TTL = 3
    LINK_FAILED = 4
    LOSS = 5
    CORRUPTED = 6


LINK = np.dtype(
    [
        # touched at every hop
        ("busy_ns", "i8"),  # end of the last accepted transmission
        ("last_arrival_ns", "i8"),  # nothing arrives before this: a serial link keeps its order
        ("delay_ns", "i8"),
        ("tx_ns", "i8"),  # transmission time of a packet of tx_size bytes, the last size seen
        ("tx_size", "i4"),
        ("queue_packets", "i4"),
        ("head", "u4"),  # packets on the link or waiting for it, in order; chained by `next`
        ("tail", "u4"),
        ("unsent", "i4"),  # how many of them had not left at the last look
        ("cursor", "u4"),  # the first of these; on an entry: where the last packet was inserted
        ("chain", "u4"),  # next link in the same bucket, or of those that wait for a later window
        ("dst", "u4"),
        ("jitter_ns", "i8"),
        ("loss_probability", "f8"),
        ("bit_error_rate", "f8"),
        ("packets", "i8"),  # arrived, with those that were destroyed on the way
        ("bytes", "i8"),
        ("committed_ns", "i8"),  # transmission time of all accepted packets
        ("number", "i4"),  # of the topology; NO_LINK on an entry
        ("queue_high_water", "i4"),
        ("up", "u1"),
        ("scheduled", "u1"),  # is in a bucket or waits for a later window
        # touched now and then
        ("bits_per_byte", "i4"),
        ("src", "i4"),
        ("bits_per_s", "i8"),
        ("dropped", "i8"),
        ("key", "u8"),
    ],
    align=True,
)

PACKET = np.dtype(
    [
        ("t_ns", "i8"),  # full arrival at the end of the link that it is on
        ("sent_ns", "i8"),  # end of its transmission on that link
        ("packet_id", "i8"),
        ("key", "u8"),  # of its random draws
        ("dest", "i4"),  # node, or ~rank of the one link over which it goes
        ("size", "i4"),
        ("next", "u4"),  # behind it on the link, or in the list of free records
        ("hops", "i4"),
    ],
    align=True,
)

NODE = np.dtype(
    [
        ("key", "u8"),
        ("entered", "u8"),  # own packets so far
        ("route_start", "i8"),  # where the routes to this node begin; NONE if there are none
        ("local", "u4"),  # number within the component
        ("component", "u4"),
        ("entry", "u4"),  # rank
    ],
    align=True,
)

COMPONENT = np.dtype(
    [
        ("next_ns", "i8"),  # no event before this
        ("waiting", "u4"),  # links whose next arrival lies outside the window, chained
        ("bucket_shift", "i4"),  # log2 of the bucket width, which is at most the smallest hop time
    ],
    align=True,
)

ENDED = np.dtype(
    [("t_ns", "i8"), ("packet_id", "i8"), ("node", "i4"), ("link", "i4"), ("outcome", "i4")], align=True
)


class State(NamedTuple):
    """The arrays of a network that change with time.

    Attributes:
        links: `LINK` records by rank, with the entries.
        packets: `PACKET` records, taken or free.
        nodes: `NODE` records.
        components: `COMPONENT` records.
        routes: Rank of the next link, for destination after destination over the nodes of its component.
        tally: How many packets ended with each outcome so far.
        heap: First free packet record (`FREE`), how many are taken (`IN_FLIGHT`), how many of `routes` are
            taken (`N_ROUTES`).
    """

    links: Records
    packets: Records
    nodes: Records
    components: Records
    routes: NDArray[np.uint32]
    tally: NDArray[np.int64]
    heap: NDArray[np.int64]


class Scratch(NamedTuple):
    """The arrays that the kernel needs only while it runs.

    Attributes:
        buckets: First link of each bucket, all NONE before and after, (BUCKETS,).
        keys: Sort keys; room for all packets in flight.
        ended: `ENDED` records; room for all packets in flight.
        n_ended: How many of these are filled, (1,).
    """

    buckets: NDArray[np.uint32]
    keys: NDArray[np.int64]
    ended: Records
    n_ended: NDArray[np.int64]
