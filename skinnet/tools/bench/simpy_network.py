"""Benchmark network in SimPy: a process for each packet, a resource for each link.

SimPy is needed only here; routes are static, and packets are lost only to full queues.
"""

from collections.abc import Generator, Iterable
from typing import Any

from skinnet.network.records import Outcome
from skinnet.network.routes import NO_LINK, Routes
from skinnet.network.topology import Topology
from skinnet.tools.bench.reference_network import OfferedPacket, PacketOutcome

__all__ = ["simulate"]


def simulate(topology: Topology, routes: Routes, packets: Iterable[OfferedPacket]) -> list[PacketOutcome]:
    """Simulate all packets; return their outcomes by packet id.

    Raises:
        ModuleNotFoundError: SimPy is not installed.
    """
    import simpy  # not a dependency of the package

    env = simpy.Environment()
    wires = [simpy.Resource(env) for _ in range(topology.n_links)]
    columns = ("dst", "bits_per_s", "bits_per_byte", "delay_ns", "queue_packets")
    links = list(zip(*(getattr(topology, name).tolist() for name in columns), strict=True))
    entries = zip(routes.node.tolist(), routes.dest.tolist(), routes.link.tolist(), strict=True)
    way = {(node, dest): link for node, dest, link in entries}
    ends: list[PacketOutcome] = []

    def travel(node: int, dest: int, size: int, number: int) -> Generator[Any]:
        link = NO_LINK
        while node != dest:
            if (node, dest) not in way:
                ends.append((number, env.now, node, link, Outcome.NO_ROUTE))
                return
            link = way[node, dest]
            wire = wires[link]
            dst, bits_per_s, bits_per_byte, delay_ns, queue_packets = links[link]
            if len(wire.queue) >= queue_packets >= 0 and wire.count:
                ends.append((number, env.now, node, link, Outcome.QUEUE_FULL))
                return
            with wire.request() as turn:
                yield turn
                yield env.timeout(-(-size * bits_per_byte * 10**9 // bits_per_s))
            yield env.timeout(delay_ns)
            node = dst
        ends.append((number, env.now, node, link, Outcome.DELIVERED))

    def enter() -> Generator[Any]:
        for t_ns, node, dest, size, number, _ in packets:
            if t_ns > env.now:
                yield env.timeout(t_ns - env.now)
            env.process(travel(node, dest, size, number))

    env.process(enter())
    env.run()
    return sorted(ends)
