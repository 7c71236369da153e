"""The packet network once more, as plainly as it can be said: one heap, one event per hop, Python objects.

It shares the random hash and the packet record's meaning with the compiled kernel, and nothing else.
"""

import heapq
from collections import deque
from itertools import count
from typing import Any

import numpy as np

from skinnet.network.records import Outcome
from skinnet.network.topology import Topology
from skinnet.seeding import hash64, key_of, uniform

CHANGE, ARRIVAL = 0, 1
OWN_PORT = -1


class Link:
    def __init__(self, topology: Topology, number: int, node_key: np.uint64) -> None:
        self.number, self.loss_probability = number, float(topology.loss_probability[number])
        self.src, self.dst = int(topology.src[number]), int(topology.dst[number])
        self.dst_port, self.delay_ns = int(topology.dst_port[number]), int(topology.delay_ns[number])
        self.queue_packets, self.jitter_ns = (
            int(topology.queue_packets[number]),
            int(topology.jitter_ns[number]),
        )
        self.bits_per_s, self.bits_per_byte = (
            int(topology.bits_per_s[number]),
            int(topology.bits_per_byte[number]),
        )
        self.key = np.uint64(hash64(~node_key, np.uint64(topology.src_port[number])))
        self.up, self.busy_ns, self.last_ns = True, 0, 0
        self.on_it: list[Any] = []
        self.sent: deque[int] = deque()


def simulate(
    topology: Topology,
    offers: list[tuple[int, int, int, int, int, int]],
    changes: list[tuple[Any, ...]],
    *,
    seed: int = 0,
    hop_limit: int = 255,
) -> list[tuple[int, int, int, int, int]]:
    """Ends of all packets as (packet id, t, node, link, outcome), in the order that the network promises.

    `offers` are (t, node, dest, size, packet id, link); `changes` are (t, method, arguments …).
    """
    keys = [np.uint64(hash64(key_of(seed, "network"), np.uint64(node))) for node in range(topology.n_nodes)]
    entered = [count() for _ in keys]
    links = [Link(topology, number, keys[topology.src[number]]) for number in range(topology.n_links)]
    routes: dict[tuple[int, int], int] = {}
    serial = count()
    events: list[Any] = [(change[0], CHANGE, 0, 0, next(serial), None, change) for change in changes]
    for t, node, dest, size, packet_id, link in offers:
        packet = {"id": packet_id, "dest": dest, "size": size, "only": link, "hops": 0, "lost": False}
        events.append((t, ARRIVAL, node, OWN_PORT, next(serial), None, packet))
    heapq.heapify(events)
    ends: list[tuple[int, int, int, int, int]] = []

    def send(t: int, packet: Any, link: Link) -> Outcome | None:
        if not link.up:
            return Outcome.LINK_FAILED
        while link.sent and link.sent[0] <= t:
            link.sent.popleft()
        if len(link.sent) > link.queue_packets >= 0:
            return Outcome.QUEUE_FULL
        bits = packet["size"] * link.bits_per_byte
        link.busy_ns = max(t, link.busy_ns) - (-bits * 10**9 // link.bits_per_s)
        link.sent.append(link.busy_ns)
        share = uniform(~link.key, packet["key"] + np.uint64(packet["hops"])) if link.jitter_ns else 0.0
        link.last_ns = max(link.last_ns, link.busy_ns + link.delay_ns + int(share * (link.jitter_ns + 1)))
        link.on_it.append(packet)
        heapq.heappush(events, (link.last_ns, ARRIVAL, link.dst, link.dst_port, next(serial), link, packet))
        return None

    while events:
        t, kind, node, _, _, link, packet = heapq.heappop(events)
        if kind == CHANGE:
            _, method, *arguments = packet
            if method == "set_routes":
                table = arguments[0]
                for at, dest, way in zip(table.node, table.dest, table.link, strict=True):
                    routes[int(at), int(dest)] = int(way)
                continue
            link = links[arguments[0]]
            if method == "impair_link":
                link.loss_probability, link.jitter_ns = arguments[1:]
            elif method == "repair_link":
                link.up = True
            else:
                for lost in link.on_it:
                    lost["lost"] = True
                    ends.append((lost["id"], t, link.src, link.number, Outcome.LINK_FAILED))
                link.up, link.busy_ns, link.last_ns = False, t, t
                link.on_it.clear()
                link.sent.clear()
            continue
        if packet["lost"]:
            continue
        outcome: Outcome | None = None
        concerned = -1
        if link is None:
            packet["key"] = np.uint64(hash64(keys[node], np.uint64(next(entered[node]))))
        else:
            concerned = link.number
            link.on_it.pop(0)
            packet["hops"] += 1
            risk = link.loss_probability
            if risk and uniform(link.key, packet["key"] + np.uint64(packet["hops"])) <= risk:
                outcome = Outcome.LOSS
        routed = packet["only"] < 0
        if outcome is None:
            if (routed and packet["dest"] == node) or (not routed and link is not None):
                outcome = Outcome.DELIVERED
            elif packet["hops"] >= hop_limit:
                outcome = Outcome.TTL
            elif (ahead := routes.get((node, packet["dest"]), -1) if routed else packet["only"]) < 0:
                outcome = Outcome.NO_ROUTE
            elif (outcome := send(t, packet, links[ahead])) is not None:
                concerned = ahead
        if outcome is not None:
            ends.append((packet["id"], t, node, concerned, outcome))
    return sorted(ends, key=lambda end: (end[1], end[2]))
