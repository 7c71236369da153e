"""Plays the traffic of a plan on the packet kernel: what the bounds and means of a plan are held against."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.network import NetworkSpec
from skinnet.network.packet_network import PacketNetwork
from skinnet.network.records import Outcome
from skinnet.network.routes import min_hop_routes
from skinnet.network.topology import Topology
from skinnet.tools.plan.routing_forest import RoutingForest

Ints = NDArray[np.int64]


class Played(NamedTuple):
    """Packets in the order of offering, and the queue of every cell's link.

    Attributes:
        latency_ns: (packets,) from the sample to the gateway.
        t_delivered_ns: (packets,) when each arrived.
        backlog: (cells,) most packets that waited behind the one in transmission.
    """

    latency_ns: Ints
    t_delivered_ns: Ints
    backlog: Ints


def play(
    forest: RoutingForest,
    wires: Ints,
    gateways: Ints,
    network: NetworkSpec,
    t_ns: Ints,
    cell: Ints,
    size: Ints,
) -> Played:
    """Lets `cell` (packets,) send packets of `size` at `t_ns` over links whose queues have no end."""
    n = len(forest.parent)
    computer = np.column_stack([np.full(len(gateways), n), np.arange(len(gateways)), gateways])
    topology = Topology.from_wires(
        n + 1,
        np.vstack([wires, computer]),
        bits_per_s=network.bits_per_s,
        bits_per_byte=network.bits_per_byte,
        delay_ns=round(network.hop_delay_us * 1e3),
        jitter_ns=round(network.jitter_us * 1e3),
    )
    kernel = PacketNetwork(topology, seed=1)
    kernel.set_routes(0, min_hop_routes(topology, [n]))
    ids = np.arange(len(cell))
    kernel.enqueue(t_ns, cell, np.full(len(cell), n), size, ids)
    ended = kernel.advance(int(t_ns.max()) + 10**12)
    assert (ended.outcome == Outcome.DELIVERED).all()
    assert len(ended.t_ns) == len(cell)
    delivered = np.empty(len(cell), dtype=np.int64)
    delivered[ended.packet_id] = ended.t_ns
    link_of = {
        (int(s), int(p)): i for i, (s, p) in enumerate(zip(topology.src, topology.src_port, strict=True))
    }
    uplink = [link_of[c, int(p)] for c, p in enumerate(forest.port)]
    high = kernel.link_counters.queue_high_water
    return Played(delivered - t_ns, delivered, np.asarray(high[uplink], dtype=np.int64))
