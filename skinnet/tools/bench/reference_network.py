"""Reference packet network in plain Python: one heap, one event per hop, one object per packet.

The compiled kernel is tested and measured against it. They share the random hash, nothing else.
"""

import heapq
from collections import deque
from collections.abc import Iterable
from itertools import count
from typing import Any, TypeAlias

import numpy as np

from skinnet.network.records import Outcome
from skinnet.network.routes import NO_LINK
from skinnet.network.topology import Topology
from skinnet.random_streams import StreamName, hash64, stream_key, uniform

__all__ = ["OfferedPacket", "PacketOutcome", "ScheduledEvent", "simulate"]

OfferedPacket: TypeAlias = tuple[int, int, int, int, int, int]
"""Packet to enqueue: (t_ns, node, dest, size_bytes, packet id, link or NO_LINK)."""
ScheduledEvent: TypeAlias = tuple[Any, ...]
"""Scheduled event: (t_ns, name of a method of `PacketNetwork`, its arguments …).

`impair_link` takes a link and a dictionary.
"""
PacketOutcome: TypeAlias = tuple[int, int, int, int, int]
"""Packet outcome: (packet id, t_ns, node, link, outcome)."""

_SCHEDULED, _ARRIVAL = 0, 1
_OWN_PORT = -1
_BIT_ERRORS = 0x5DEECE66D


class _Packet:
    __slots__ = ("dest", "entry", "hops", "link", "lost", "packet_id", "size")

    def __init__(self, dest: int, size: int, packet_id: int, link: int) -> None:
        self.dest, self.size, self.packet_id, self.link = dest, size, packet_id, link
        self.hops, self.entry, self.lost = 0, (0, 0), False


class _Link:
    def __init__(self, topology: Topology, index: int, node_key: np.uint64) -> None:
        def column(name: str) -> Any:
            return getattr(topology, name)[index].item()

        self.index, self.src, self.dst = index, column("src"), column("dst")
        self.dst_port, self.delay_ns = column("dst_port"), column("delay_ns")
        self.queue_packets, self.jitter_ns = column("queue_packets"), column("jitter_ns")
        self.bits_per_s, self.bits_per_byte = column("bits_per_s"), column("bits_per_byte")
        self.loss_probability, self.bit_error_rate = column("loss_probability"), column("bit_error_rate")
        self.key = np.uint64(hash64(~node_key, np.uint64(topology.src_port[index])))
        self.up, self.busy_until_ns, self.last_arrival_ns = True, 0, 0
        self.in_flight: deque[_Packet] = deque()
        self.transmission_ends_ns: deque[int] = deque()


def simulate(
    topology: Topology,
    packets: Iterable[OfferedPacket],
    scheduled_events: Iterable[ScheduledEvent],
    *,
    seed: int = 0,
    hop_limit: int = 255,
    arrivals_first: bool = False,
) -> list[PacketOutcome]:
    """Simulate all packets by the rules of `PacketNetwork`; return outcomes in the order that it promises.

    With `arrivals_first`, against these rules, a transmission ends after the arrivals of the same instant: to
    test whether results depend on that tie.
    """
    keys = [
        np.uint64(hash64(stream_key(seed, StreamName.NETWORK), np.uint64(node)))
        for node in range(topology.n_nodes)
    ]
    entered = [count() for _ in keys]
    links = [_Link(topology, number, keys[topology.src[number]]) for number in range(topology.n_links)]
    routes: dict[tuple[int, int], int] = {}
    serial = count()
    events: list[Any] = [
        (change[0], _SCHEDULED, 0, 0, next(serial), None, change) for change in scheduled_events
    ]
    for t_ns, node, dest, size, number, only in packets:
        packet = _Packet(dest, size, number, only)
        events.append((t_ns, _ARRIVAL, node, _OWN_PORT, next(serial), None, packet))
    heapq.heapify(events)
    ends: list[PacketOutcome] = []

    def draw(key: np.uint64, packet: _Packet) -> float:
        node, entry = packet.entry
        return uniform(key, np.uint64(hash64(keys[node], np.uint64(entry))) + np.uint64(packet.hops))

    def send(t_ns: int, packet: _Packet, link: _Link) -> Outcome | None:
        if not link.up:
            return Outcome.LINK_FAILED
        while link.transmission_ends_ns and (
            link.transmission_ends_ns[0] < t_ns
            or (link.transmission_ends_ns[0] == t_ns and not arrivals_first)
        ):
            link.transmission_ends_ns.popleft()
        if len(link.transmission_ends_ns) > link.queue_packets >= 0:
            return Outcome.QUEUE_FULL
        bits = packet.size * link.bits_per_byte
        link.busy_until_ns = max(t_ns, link.busy_until_ns) - (-bits * 10**9 // link.bits_per_s)
        link.transmission_ends_ns.append(link.busy_until_ns)
        extra_ns = int(draw(~link.key, packet) * (link.jitter_ns + 1)) if link.jitter_ns else 0
        link.last_arrival_ns = max(link.last_arrival_ns, link.busy_until_ns + link.delay_ns + extra_ns)
        link.in_flight.append(packet)
        heapq.heappush(
            events, (link.last_arrival_ns, _ARRIVAL, link.dst, link.dst_port, next(serial), link, packet)
        )
        return None

    def survive(packet: _Packet, link: _Link) -> Outcome | None:
        if link.loss_probability and draw(link.key, packet) <= link.loss_probability:
            return Outcome.LOSS
        if rate := link.bit_error_rate:
            whole = (1.0 - rate) ** (8 * packet.size)
            if draw(link.key ^ np.uint64(_BIT_ERRORS), packet) <= 1.0 - whole:
                return Outcome.CORRUPTED
        return None

    def change(t_ns: int, method: str, arguments: list[Any]) -> None:
        if method == "set_routes":
            table = arguments[0]
            for at, dest, way in zip(table.node, table.dest, table.link, strict=True):
                routes[int(at), int(dest)] = int(way)
            return
        link = links[arguments[0]]
        if method == "impair_link":
            for name, value in arguments[1].items():
                setattr(link, name, value)
        elif method == "repair_link":
            link.up = True
        else:
            for lost in link.in_flight:
                lost.lost = True
                ends.append((lost.packet_id, t_ns, link.src, link.index, Outcome.LINK_FAILED))
            link.up, link.busy_until_ns, link.last_arrival_ns = False, t_ns, t_ns
            link.in_flight.clear()
            link.transmission_ends_ns.clear()

    while events:
        t_ns, kind, node, _, _, link, packet = heapq.heappop(events)
        if kind == _SCHEDULED:
            _, method, *arguments = packet
            change(t_ns, method, arguments)
            continue
        if packet.lost:
            continue
        outcome: Outcome | None = None
        concerned = NO_LINK
        if link is None:
            packet.entry = (node, next(entered[node]))
        else:
            concerned = link.index
            link.in_flight.popleft()
            packet.hops += 1
            outcome = survive(packet, link)
        routed = packet.link == NO_LINK
        if outcome is None:
            if (routed and packet.dest == node) or (not routed and link is not None):
                outcome = Outcome.DELIVERED
            elif packet.hops >= hop_limit:
                outcome = Outcome.TTL
            elif (ahead := routes.get((node, packet.dest), NO_LINK) if routed else packet.link) == NO_LINK:
                outcome = Outcome.NO_ROUTE
            elif (outcome := send(t_ns, packet, links[ahead])) is not None:
                concerned = ahead
        if outcome is not None:
            ends.append((packet.packet_id, t_ns, node, concerned, outcome))
    return sorted(ends, key=lambda end: (end[1], end[2]))
