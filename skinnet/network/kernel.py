"""Compiled discrete-event packet kernel: a windowed calendar queue of arrivals, exact to the nanosecond.

A link is serial, so its packets form a first-in-first-out chain, and the calendar holds a link at most once,
at the arrival of its first packet. A bucket is no wider than the smallest hop time of its component (the
lookahead): events in one bucket only cause arrivals in later ones. All arrivals of a bucket are therefore
known when it is opened; sorted by (time, rank of the link) they are handled in exact order. A component is
advanced over the whole interval before the next component, which keeps its records in the cache.
"""

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.compilation import compiled, compiled_inline
from skinnet.network.records import (
    FREE,
    IN_FLIGHT,
    NEVER_NS,
    NULL,
    KernelScratch,
    KernelState,
    Outcome,
    Records,
)
from skinnet.network.routes import NO_LINK
from skinnet.random_streams import hash64, uniform

__all__ = ["BUCKETS", "MAX_SIZE_BYTES", "advance", "enqueue", "fail_link", "pending_packets"]

BUCKETS = 256
MAX_SIZE_BYTES = 2**26
"""Greatest packet size [bytes]: size × 64 bits per byte × 10⁹ ns/s stays below 2⁶³."""

_IN_FLIGHT = -1
_DELIVERED = int(Outcome.DELIVERED)
_QUEUE_FULL = int(Outcome.QUEUE_FULL)
_NO_ROUTE = int(Outcome.NO_ROUTE)
_TTL = int(Outcome.TTL)
_LINK_FAILED = int(Outcome.LINK_FAILED)
_LOSS = int(Outcome.LOSS)
_CORRUPTED = int(Outcome.CORRUPTED)
_BIT_ERROR_SALT = 0x5DEECE66D
_LOW_HALF = 0xFFFFFFFF
_INSERTION_SORT_MAX = 48


@compiled
def enqueue(
    t_ns: NDArray[np.int64],
    node: NDArray[np.int64],
    dest: NDArray[np.int64],
    size_bytes: NDArray[np.int64],
    packet_id: NDArray[np.int64],
    rank: NDArray[np.int64],
    state: KernelState,
) -> None:
    """Enqueue packets on the entries of their nodes, in order of time, equal times in order of offering.

    `rank` is the rank of the link for a link-local packet, else NONE. The caller has validated all values
    and provided enough free records.
    """
    links, packets, heap = state.links, state.packets, state.pool
    for i in range(t_ns.size):
        p = heap[FREE]
        packet = packets[p]
        heap[FREE] = packet.next
        heap[IN_FLIGHT] += 1
        packet.t_ns = t_ns[i]
        packet.sent_ns = t_ns[i]
        packet.packet_id = packet_id[i]
        packet.size = size_bytes[i]
        packet.dest = dest[i] if rank[i] == NULL else ~rank[i]
        packet.hops = 0
        home = state.nodes[node[i]]
        entry = links[home.entry]
        component = state.components[home.component]
        if entry.scheduled == 0:
            entry.scheduled = 1
            entry.chain = component.waiting
            component.waiting = home.entry
        component.next_ns = min(component.next_ns, t_ns[i])
        if entry.head == NULL:
            packet.next = NULL
            entry.head = p
            entry.tail = p
        elif t_ns[i] >= packets[entry.tail].t_ns:
            packet.next = NULL
            packets[entry.tail].next = p
            entry.tail = p
        elif t_ns[i] < packets[entry.head].t_ns:
            packet.next = entry.head
            entry.head = p
        else:
            before = entry.head
            if entry.cursor != NULL and packets[entry.cursor].t_ns <= t_ns[i]:
                before = entry.cursor
            while packets[packets[before].next].t_ns <= t_ns[i]:
                before = packets[before].next
            packet.next = packets[before].next
            packets[before].next = p
            entry.cursor = p


@compiled
def fail_link(rank: int, t_ns: int, state: KernelState, scratch: KernelScratch) -> None:
    """Fail a link at `t_ns` and drop every packet that has not fully arrived over it before."""
    link = state.links[rank]
    link.up = 0
    p = link.head
    while p != NULL:
        following = state.packets[p].next
        link.dropped += 1
        _end_packet(p, t_ns, link.src, link.number, _LINK_FAILED, state, scratch)
        p = following
    link.head = NULL
    link.cursor = NULL
    link.unsent = 0
    link.committed_ns -= max(0, link.busy_ns - t_ns)
    link.busy_ns = min(link.busy_ns, t_ns)
    link.last_arrival_ns = min(link.last_arrival_ns, t_ns)


@compiled
def pending_packets(state: KernelState, packet_id: NDArray[np.int64]) -> int:
    """Write the ids of all packets that queue at a link or are on it; return their number.

    Counted by walking the chains, without any counter of the kernel, so that a lost packet is missed here and
    a packet in two places is found twice. `packet_id` has room for (n_packets,); the walk ends when it is
    full.
    """
    n = 0
    for rank in range(state.links.size):
        p = state.links[rank].head
        while p != NULL and n < packet_id.size:
            packet_id[n] = state.packets[p].packet_id
            n += 1
            p = state.packets[p].next
    return n


@compiled
def advance(until_ns: int, hop_limit: int, state: KernelState, scratch: KernelScratch) -> int:
    """Handle every arrival before `until_ns`; return a lower bound of the next event time [ns].

    A packet ends with `TTL` at the node that would send it over more than `hop_limit` links.
    """
    next_ns = NEVER_NS
    for c in range(state.components.size):
        component = state.components[c]
        while component.next_ns < until_ns:
            _advance_window(until_ns, hop_limit, component, state, scratch)
        next_ns = min(next_ns, component.next_ns)
    return next_ns


@compiled_inline
def _advance_window(
    until_ns: int, hop_limit: int, component: Records, state: KernelState, scratch: KernelScratch
) -> None:
    """Handle the arrivals of one component in the window of all buckets from its next event on."""
    links, packets, nodes = state.links, state.packets, state.nodes
    buckets, keys = scratch.buckets, scratch.keys
    start_ns = component.next_ns
    width_ns = 1 << component.bucket_shift
    end_ns = min(until_ns, start_ns + BUCKETS * width_ns)
    rank = component.waiting
    component.waiting = NULL
    component.next_ns = NEVER_NS
    scheduled = 0
    while rank != NULL:
        following = links[rank].chain
        first = links[rank].head
        if first == NULL:  # the link failed while it waited
            links[rank].scheduled = 0
        else:
            scheduled += _schedule(rank, packets[first].t_ns, start_ns, end_ns, links, component, buckets)
        rank = following

    bucket = -1
    while scheduled > 0:
        bucket += 1
        rank = buckets[bucket]
        if rank == NULL:
            continue
        buckets[bucket] = NULL
        open_ns = start_ns + bucket * width_ns
        close_ns = min(open_ns + width_ns, end_ns)
        n = 0
        while rank != NULL:
            link = links[rank]
            following = link.chain
            p = link.head
            while p != NULL and packets[p].t_ns < close_ns:
                keys[n] = (packets[p].t_ns - open_ns) << 32 | rank
                n += 1
                p = packets[p].next
            link.scheduled = 0
            scheduled -= 1
            if p != NULL:
                scheduled += _schedule(rank, packets[p].t_ns, start_ns, end_ns, links, component, buckets)
            rank = following
        if n > _INSERTION_SORT_MAX:
            _sort_many(keys, n)
        else:
            _sort_few(keys, n)
        for i in range(n):
            rank = keys[i] & _LOW_HALF
            link = links[rank]
            p = link.head
            packet = packets[p]
            t_ns = packet.t_ns
            node = link.dst
            outcome = _arrive(p, packet, link, nodes[node])
            concerned = link.number
            if outcome == _IN_FLIGHT:
                if packet.hops >= hop_limit:
                    outcome = _TTL
                else:
                    ahead = _next_link(packet.dest, node, nodes, state.routes)
                    if ahead == NULL:
                        outcome = _NO_ROUTE
                    else:
                        outcome = _enqueue_on_link(p, t_ns, links[ahead], packets)
                        if outcome != _IN_FLIGHT:
                            concerned = links[ahead].number
                        elif links[ahead].scheduled == 0:
                            scheduled += _schedule(
                                ahead, packet.t_ns, start_ns, end_ns, links, component, buckets
                            )
            if outcome != _IN_FLIGHT:
                _end_packet(p, t_ns, node, concerned, outcome, state, scratch)


@compiled_inline
def _arrive(p: int, packet: Records, link: Records, node: Records) -> int:
    """Dequeue the first packet of a link at its arrival; return its outcome, or `_IN_FLIGHT`."""
    link.head = packet.next
    link.packets += 1
    link.bytes += packet.size
    if link.number == NO_LINK:
        if link.cursor == p:
            link.cursor = NULL
        packet.key = hash64(node.key, node.entered)
        node.entered += np.uint64(1)
        return _DELIVERED if packet.dest == link.dst else _IN_FLIGHT
    if link.cursor == p:
        link.cursor = packet.next
        link.unsent -= 1
    packet.hops += 1
    chance = link.loss_probability
    if chance > 0.0 and uniform(link.key, packet.key + np.uint64(packet.hops)) <= chance:
        link.dropped += 1
        return _LOSS
    rate = link.bit_error_rate
    if rate > 0.0:
        share = uniform(link.key ^ np.uint64(_BIT_ERROR_SALT), packet.key + np.uint64(packet.hops))
        if share <= -pinned_math.expm1(8 * packet.size * pinned_math.log1p(-rate)):
            link.dropped += 1
            return _CORRUPTED
    return _DELIVERED if packet.dest < 0 or packet.dest == link.dst else _IN_FLIGHT


@compiled_inline
def _next_link(dest: int, node: int, nodes: Records, routes: NDArray[np.uint32]) -> int:
    if dest < 0:
        return ~dest
    start = nodes[dest].route_start
    if start == NULL or nodes[dest].component != nodes[node].component:
        return NULL
    return int(routes[start + nodes[node].local])


@compiled_inline
def _enqueue_on_link(p: int, t_ns: int, link: Records, packets: Records) -> int:
    """Enqueue a packet on a link at `t_ns`; return the cause of its drop, or `_IN_FLIGHT`."""
    if link.up == 0:
        link.dropped += 1
        return _LINK_FAILED
    while link.unsent > 0 and packets[link.cursor].sent_ns <= t_ns:
        link.cursor = packets[link.cursor].next
        link.unsent -= 1
    if link.unsent > link.queue_packets and link.queue_packets >= 0:
        link.dropped += 1
        return _QUEUE_FULL
    packet = packets[p]
    if link.tx_size != packet.size:
        bits = packet.size * link.bits_per_byte
        link.tx_size = packet.size
        link.tx_ns = (bits * 1_000_000_000 + link.bits_per_s - 1) // link.bits_per_s
    link.busy_ns = max(t_ns, link.busy_ns) + link.tx_ns
    link.committed_ns += link.tx_ns
    arrival_ns = link.busy_ns + link.delay_ns
    if link.jitter_ns > 0:
        share = uniform(~link.key, packet.key + np.uint64(packet.hops))
        arrival_ns += min(int(share * (link.jitter_ns + 1)), link.jitter_ns)
    link.last_arrival_ns = max(arrival_ns, link.last_arrival_ns)
    packet.sent_ns = link.busy_ns
    packet.t_ns = link.last_arrival_ns
    packet.next = NULL
    if link.head == NULL:
        link.head = p
    else:
        packets[link.tail].next = p
    link.tail = p
    if link.unsent == 0:
        link.cursor = p
    link.queue_high_water = max(link.queue_high_water, link.unsent)
    link.unsent += 1
    return _IN_FLIGHT


@compiled_inline
def _end_packet(
    p: int, t_ns: int, node: int, link: int, outcome: int, state: KernelState, scratch: KernelScratch
) -> None:
    record = scratch.ended[scratch.n_ended[0]]
    scratch.n_ended[0] += 1
    record.t_ns = t_ns
    record.packet_id = state.packets[p].packet_id
    record.node = node
    record.link = link
    record.outcome = outcome
    state.outcome_counts[outcome] += 1
    state.packets[p].next = state.pool[FREE]
    state.pool[FREE] = p
    state.pool[IN_FLIGHT] -= 1


@compiled_inline
def _schedule(
    rank: int,
    t_ns: int,
    start_ns: int,
    end_ns: int,
    links: Records,
    component: Records,
    buckets: NDArray[np.uint32],
) -> int:
    """Schedule a link in the bucket of its next arrival; return 1, or 0 if outside the window."""
    link = links[rank]
    link.scheduled = 1
    if t_ns < end_ns:
        bucket = (t_ns - start_ns) >> component.bucket_shift
        link.chain = buckets[bucket]
        buckets[bucket] = rank
        return 1
    link.chain = component.waiting
    component.waiting = rank
    component.next_ns = min(component.next_ns, t_ns)
    return 0


@compiled
def _sort_many(keys: NDArray[np.int64], n: int) -> None:
    """Sort the first n keys."""
    keys[:n].sort()


@compiled_inline
def _sort_few(keys: NDArray[np.int64], n: int) -> None:
    """Sort the first n keys by insertion, the fastest method for few keys."""
    for i in range(1, n):
        key = keys[i]
        j = i
        while j > 0 and keys[j - 1] > key:
            keys[j] = keys[j - 1]
            j -= 1
        keys[j] = key
