"""Flat records (structured arrays) of the packet kernel.

Links are stored in the order in which ties are broken: by component, node of arrival, port of arrival. A node
injects its own packets over an *entry*, a link of port −1 without rate or delay; an entry thus precedes the
node's input ports, and every event at a node is the arrival of a packet over a link. The position in this
order is the *rank*; the link number of the topology is kept in `number`.
"""

from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "COMPONENT",
    "ENDED",
    "FREE",
    "IN_FLIGHT",
    "LINK",
    "MAX_BUCKET_SHIFT",
    "NEVER_NS",
    "NODE",
    "NULL",
    "N_ROUTES",
    "PACKET",
    "KernelScratch",
    "KernelState",
    "Outcome",
    "Records",
]

# Fields of a record are attributes to Numba only; mypy does not know them.
Records: TypeAlias = Any

FREE, IN_FLIGHT, N_ROUTES = 0, 1, 2
"""Indices into `KernelState.pool`."""
NULL = 2**32 - 1
"""Null index: no link, packet or route. Indices are unsigned, which avoids a sign check on access."""
NEVER_NS = 2**62
"""Time after every event [ns]: no event."""
MAX_BUCKET_SHIFT = 30
"""Greatest log2 of the bucket width [ns]; times within a bucket fit the upper half of a 64-bit sort key."""


class Outcome(IntEnum):
    """Packet outcome: delivered, or the cause of its drop."""

    DELIVERED = 0
    QUEUE_FULL = 1
    NO_ROUTE = 2
    TTL = 3
    LINK_FAILED = 4
    LOSS = 5
    CORRUPTED = 6


LINK = np.dtype(
    [
        # accessed at every hop
        ("busy_ns", "i8"),  # end of the last accepted transmission
        ("last_arrival_ns", "i8"),  # lower bound of the next arrival: a serial link keeps order
        ("delay_ns", "i8"),
        ("tx_ns", "i8"),  # transmission time of a packet of tx_size bytes, the last size seen
        ("tx_size", "i4"),
        ("queue_packets", "i4"),
        ("head", "u4"),  # packets on the link or queued, in order; chained by `next`
        ("tail", "u4"),
        ("unsent", "i4"),  # number of them not yet sent at the last update
        ("cursor", "u4"),  # the first of these; on an entry: the last insertion point
        ("chain", "u4"),  # next link in the same bucket, or in `waiting`
        ("dst", "u4"),
        ("jitter_ns", "i8"),
        ("loss_probability", "f8"),
        ("bit_error_rate", "f8"),
        ("packets", "i8"),  # arrived, with those destroyed on the link
        ("bytes", "i8"),
        ("committed_ns", "i8"),  # transmission time of all accepted packets
        ("number", "i4"),  # link number of the topology; NO_LINK on an entry
        ("queue_high_water", "i4"),
        ("up", "u1"),
        ("scheduled", "u1"),  # in a bucket or in `waiting`
        # accessed rarely
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
        ("t_ns", "i8"),  # full arrival at the end of its present link
        ("sent_ns", "i8"),  # end of its transmission on that link
        ("packet_id", "i8"),
        ("key", "u8"),  # key of its random draws
        ("dest", "i4"),  # node, or ~rank of the link of a link-local packet
        ("size", "i4"),
        ("next", "u4"),  # next packet on the link, or next free record
        ("hops", "i4"),
    ],
    align=True,
)

NODE = np.dtype(
    [
        ("key", "u8"),
        ("entered", "u8"),  # number of own packets injected
        ("route_start", "i8"),  # start of the routes to this node; NONE without routes
        ("local", "u4"),  # index within the component
        ("component", "u4"),
        ("entry", "u4"),  # rank of its entry
    ],
    align=True,
)

COMPONENT = np.dtype(
    [
        ("next_ns", "i8"),  # lower bound of the next event
        ("waiting", "u4"),  # links with their next arrival after the window, chained
        ("bucket_shift", "i4"),  # log2 of the bucket width, at most the smallest hop time
    ],
    align=True,
)

ENDED = np.dtype(
    [("t_ns", "i8"), ("packet_id", "i8"), ("node", "i4"), ("link", "i4"), ("outcome", "i4")], align=True
)


class KernelState(NamedTuple):
    """State arrays of a network, which change with time.

    Attributes:
        links: `LINK` records by rank, with the entries.
        packets: `PACKET` records, in use or free.
        nodes: `NODE` records.
        components: `COMPONENT` records.
        routes: Rank of the next link, per destination, over the nodes of its component.
        outcome_counts: Number of ended packets per outcome.
        pool: First free packet record (`FREE`), number of packets in flight (`IN_FLIGHT`), number of used
            `routes` (`N_ROUTES`).
    """

    links: Records
    packets: Records
    nodes: Records
    components: Records
    routes: NDArray[np.uint32]
    outcome_counts: NDArray[np.int64]
    pool: NDArray[np.int64]


class KernelScratch(NamedTuple):
    """Scratch arrays that the kernel needs only while it runs.

    Attributes:
        buckets: First link of each bucket, all NONE before and after a run, (BUCKETS,).
        keys: Sort keys; room for all packets in flight.
        ended: `ENDED` records; room for all packets in flight.
        n_ended: Number of filled `ended` records, (1,).
    """

    buckets: NDArray[np.uint32]
    keys: NDArray[np.int64]
    ended: Records
    n_ended: NDArray[np.int64]
