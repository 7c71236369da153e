"""Memory layout of the kernel's records: construction from a topology and growth."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from skinnet.network.records import (
    COMPONENT,
    FREE,
    IN_FLIGHT,
    LINK,
    MAX_BUCKET_SHIFT,
    N_ROUTES,
    NEVER_NS,
    NODE,
    NULL,
    PACKET,
    KernelState,
    Outcome,
)
from skinnet.network.routes import NO_LINK
from skinnet.network.topology import UNBOUNDED, Topology
from skinnet.random_streams import StreamName, hash64, stream_key

__all__ = ["bucket_shifts", "build_state", "with_capacity", "with_routes"]

Ints: TypeAlias = NDArray[np.int64]

_INITIAL_CAPACITY = 1024


def build_state(
    topology: Topology, seed: int, node_keys: NDArray[np.uint64]
) -> tuple[KernelState, NDArray[np.int64]]:
    """Build the state of an idle network; return it and the rank of every link, (n_links,)."""
    n_nodes = topology.n_nodes
    at_node = np.concatenate((np.arange(n_nodes), topology.dst))
    at_port = np.concatenate((np.full(n_nodes, -1), topology.dst_port))
    order = np.lexsort((at_port, at_node, topology.component[at_node]))
    rank = np.argsort(order)
    entry, rank_of_link = rank[:n_nodes], rank[n_nodes:]

    nodes = np.zeros(n_nodes, dtype=NODE)
    root = stream_key(seed, StreamName.NETWORK)
    nodes["key"] = [hash64(root, key) for key in node_keys]
    nodes["route_start"] = NULL
    nodes["local"][topology.members] = (
        np.arange(n_nodes) - topology.member_start[topology.component[topology.members]]
    )
    nodes["component"] = topology.component
    nodes["entry"] = entry

    links = np.zeros(order.size, dtype=LINK)
    for name in ("head", "tail", "cursor", "chain"):
        links[name] = NULL
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
        "bit_error_rate",
        "jitter_ns",
    ):
        links[name][rank_of_link] = getattr(topology, name)
    # By node key and port, not by number: independent of how components share `Network` objects.
    links["key"][rank_of_link] = [
        hash64(~nodes["key"][src], np.uint64(port))
        for src, port in zip(topology.src, topology.src_port, strict=True)
    ]

    components = np.zeros(topology.member_start.size - 1, dtype=COMPONENT)
    components["next_ns"] = NEVER_NS
    components["waiting"] = NULL
    state = KernelState(
        links,
        np.empty(0, dtype=PACKET),
        nodes,
        components,
        routes=np.empty(0, dtype=np.uint32),
        outcome_counts=np.zeros(len(Outcome), dtype=np.int64),
        pool=np.array([NULL, 0, 0], dtype=np.int64),
    )
    return state, rank_of_link.astype(np.int64)


def bucket_shifts(topology: Topology, size_bytes: int) -> NDArray[np.int64]:
    """Return log2 of each component's bucket width [ns] for packets of at least `size_bytes`.

    The width is a quarter of the largest power of two not above the smallest hop time. Any width up to the
    hop time is correct; narrower buckets hold fewer arrivals to sort.
    """
    bits = np.int64(size_bytes) * topology.bits_per_byte * 1_000_000_000
    hop_ns = -(-bits // topology.bits_per_s) + topology.delay_ns
    least_ns = np.full(topology.member_start.size - 1, 1 << MAX_BUCKET_SHIFT, dtype=np.int64)
    np.minimum.at(least_ns, topology.component[topology.src], hop_ns)
    return np.asarray(np.maximum(np.frexp(least_ns)[1] - 3, 0), dtype=np.int64)


def with_capacity(state: KernelState, n: int) -> KernelState:
    """Return the state with room for `n` more packets; capacity at least doubles when it grows."""
    size = state.packets.size
    needed = int(state.pool[IN_FLIGHT]) + n
    if needed <= size:
        return state
    packets = np.zeros(max(_INITIAL_CAPACITY, 2 * size, needed), dtype=PACKET)
    packets[:size] = state.packets
    packets["next"][size:] = np.arange(size + 1, packets.size + 1)
    packets["next"][-1] = state.pool[FREE]
    state.pool[FREE] = size
    return state._replace(packets=packets)


def with_routes(state: KernelState, topology: Topology, node: Ints, dest: Ints, rank: Ints) -> KernelState:
    """Return the state with these route entries; a destination gets its column with its first route."""
    start = state.nodes["route_start"]
    fresh = np.unique(dest[start[dest] == NULL])
    sizes = np.diff(topology.member_start)[topology.component[fresh]]
    ends = int(state.pool[N_ROUTES]) + np.cumsum(sizes)
    start[fresh] = ends - sizes
    routes = state.routes
    if fresh.size:
        state.pool[N_ROUTES] = ends[-1]
    if (missing := int(state.pool[N_ROUTES]) - routes.size) > 0:
        routes = np.concatenate((routes, np.full(max(missing, routes.size), NULL, dtype=np.uint32)))
    routes[start[dest] + state.nodes["local"][node]] = rank
    return state._replace(routes=routes)
