"""The flat records on which the packet kernel works, and how they are laid out from a topology.

Links stand in the order in which ties are broken: by component, node of arrival, port of arrival. A node
injects its own packets over an *entry*, a link of port −1 without rate or delay; so an entry stands before
the node's input ports, and everything that happens at a node is the arrival of a packet over a link.
The position in this order is the *rank*; the number that the topology gave is kept in `number`.
"""

from enum import IntEnum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from skinnet.network.routes import NO_LINK
from skinnet.network.topology import UNBOUNDED, Topology
from skinnet.seeding import hash64, key_of

__all__ = [
    "COMPONENT",
    "ENDED",
    "FAR_NS",
    "LINK",
    "MAX_BUCKET_SHIFT",
    "NODE",
    "NONE",
    "PACKET",
    "Outcome",
    "Records",
    "bucket_shifts",
    "lay_out",
]

# Fields of a record are attributes to Numba only; mypy does not know them.
Records: TypeAlias = Any

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
        ("packets", "i8"),  # arrived, with those that were destroyed on the way
        ("bytes", "i8"),
        ("committed_ns", "i8"),  # transmission time of all accepted packets
        ("src", "i4"),
        ("number", "i4"),  # of the topology; NO_LINK on an entry
        ("queue_high_water", "i4"),
        ("bits_per_byte", "i4"),
        ("dropped", "i8"),
        ("bits_per_s", "i8"),
        ("key", "u8"),
        ("up", "u1"),
        ("scheduled", "u1"),  # is in a bucket or waits for a later window
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


def lay_out(
    topology: Topology, seed: int, node_keys: NDArray[np.uint64]
) -> tuple[Records, Records, Records, NDArray[np.int64]]:
    """Records of an idle network: links by rank, nodes, components, and the rank of every link (n_links,)."""
    n_nodes = topology.n_nodes
    at_node = np.concatenate((np.arange(n_nodes), topology.dst))
    at_port = np.concatenate((np.full(n_nodes, -1), topology.dst_port))
    order = np.lexsort((at_port, at_node, topology.component[at_node]))
    rank = np.argsort(order)
    entry, rank_of_link = rank[:n_nodes], rank[n_nodes:]

    nodes = np.zeros(n_nodes, dtype=NODE)
    root = key_of(seed, "network")
    nodes["key"] = [hash64(root, key) for key in node_keys]
    nodes["route_start"] = NONE
    nodes["local"][topology.members] = (
        np.arange(n_nodes) - topology.member_start[topology.component[topology.members]]
    )
    nodes["component"] = topology.component
    nodes["entry"] = entry

    links = np.zeros(order.size, dtype=LINK)
    for name in ("head", "tail", "cursor", "chain"):
        links[name] = NONE
    links["queue_packets"] = UNBOUNDED
    links["number"] = NO_LINK
    links["up"] = 1
    links["bits_per_s"] = links["bits_per_byte"] = 1
    links["dst"][rank] = at_node
    links["src"][entry] = np.arange(n_nodes)
    links["number"][rank_of_link] = np.arange(topology.n_links)
    for name in (
        "src",
        "bits_per_s",
        "bits_per_byte",
        "delay_ns",
        "queue_packets",
        "loss_probability",
        "jitter_ns",
    ):
        links[name][rank_of_link] = getattr(topology, name)
    # By node key and port, not by number, so that it does not matter which networks share an object.
    links["key"][rank_of_link] = [
        hash64(~nodes["key"][src], np.uint64(port))
        for src, port in zip(topology.src, topology.src_port, strict=True)
    ]

    components = np.zeros(topology.member_start.size - 1, dtype=COMPONENT)
    components["next_ns"] = FAR_NS
    components["waiting"] = NONE
    return links, nodes, components, rank_of_link.astype(np.int64)


def bucket_shifts(topology: Topology, size_bytes: int) -> NDArray[np.int64]:
    """Log2 of the bucket width of each component [ns], if no packet is smaller than `size_bytes`.

    The width is a quarter of the largest power of two not above the smallest hop time: no wider is correct, and
    with fewer arrivals in each bucket there is less to sort.
    """
    bits = np.int64(size_bytes) * topology.bits_per_byte * 1_000_000_000
    hop_ns = -(-bits // topology.bits_per_s) + topology.delay_ns
    least_ns = np.full(topology.member_start.size - 1, 1 << MAX_BUCKET_SHIFT, dtype=np.int64)
    np.minimum.at(least_ns, topology.component[topology.src], hop_ns)
    return np.asarray(np.maximum(np.frexp(least_ns)[1] - 3, 0), dtype=np.int64)
