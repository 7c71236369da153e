"""Networks that ns-3 and we must agree on; `python tests/support/ns3_cases.py` has ns-3 write golden files.

Rates are such that every transmission takes whole nanoseconds. ns-3 has no rule for what happens first at one
instant, so a case is used only if nothing in it hangs on that (`no_tie_matters`).
"""

import gzip
import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
from locations import DATA
from numpy.typing import NDArray

from skinnet.network.routes import NO_LINK, Routes, min_hop_routes
from skinnet.network.topology import Topology
from skinnet.tools.bench import ns3_network
from skinnet.tools.bench.reference_network import simulate
from skinnet.tools.bench.workload import Workload

GOLDEN = DATA / "ns3" / "golden"
UNTIL_NS = 200_000_000
RATES = (8_000_000, 10_000_000, 12_500_000)
INPUTS = ("links.csv", "packets.csv", "routes.csv")
LEAST_SIZE = 11  # the headers of the program


def workload(
    topology: Topology, t_ns: NDArray[np.int64], ends: NDArray[np.int64], rng: np.random.Generator
) -> Workload:
    """Packets of 11 to 80 bytes between these (node, dest), with routes of fewest hops."""
    order = np.argsort(t_ns, kind="stable")
    routes = min_hop_routes(topology, np.unique(ends[:, 1]))
    kept = routes.link != NO_LINK
    return Workload(
        topology,
        Routes(routes.node[kept], routes.dest[kept], routes.link[kept]),
        t_ns[order],
        ends[order, 0],
        ends[order, 1],
        rng.integers(LEAST_SIZE, 80, t_ns.size),
    )


def grid(n_rows: int, n_columns: int, queue_packets: int, rng: np.random.Generator) -> Topology:
    """A gateway, node 0, at the corner of a grid of cells with four ports."""
    number = 1 + np.arange(n_rows * n_columns).reshape(n_rows, n_columns)
    wires = [(0, 0, 1, 3)]
    wires += [(a, 0, b, 1) for a, b in zip(number[:, :-1].flat, number[:, 1:].flat, strict=True)]
    wires += [(a, 2, b, 3) for a, b in zip(number[:-1].flat, number[1:].flat, strict=True)]
    a, a_port, b, b_port = np.array(wires + [(b, q, a, p) for a, p, b, q in wires]).T
    return Topology(
        number.size + 1,
        src=a,
        src_port=a_port,
        dst=b,
        dst_port=b_port,
        bits_per_s=rng.choice(RATES, a.size),
        bits_per_byte=10,
        delay_ns=rng.integers(50_000, 150_000, a.size),
        queue_packets=queue_packets,
    )


def line(rng: np.random.Generator) -> Workload:
    """Ten nodes in a row, traffic from end to end both ways and between."""
    topology = Topology.from_wires(
        10, [(i, 0, i + 1, 1) for i in range(9)], bits_per_s=10_000_000, bits_per_byte=10, delay_ns=100_000
    )
    ends = np.array([(0, 9), (9, 0), (4, 7), (8, 2)])[rng.integers(4, size=600)]
    return workload(topology, rng.integers(100_000_000, size=600), ends, rng)


def tree(rng: np.random.Generator) -> Workload:
    """Forty cells that all send to one interface, in bursts for which the queues are too short."""
    topology = grid(5, 8, 4, rng)
    n = 40 * 25
    cell = np.tile(np.arange(1, 41), 25)
    t_ns = np.repeat(np.arange(25) * 4_000_000, 40) + rng.integers(600_000, size=n)
    return workload(topology, t_ns, np.stack([cell, cell * 0], axis=1), rng)


def mesh(rng: np.random.Generator) -> Workload:
    """Traffic between all cells of a patch, both ways on every wire."""
    n = 2500
    ends = rng.integers(41, size=(n, 2))
    return workload(grid(5, 8, 3, rng), rng.integers(12_000_000, size=n), ends, rng)


def queues(rng: np.random.Generator) -> Workload:
    """A star of six nodes whose hub answers on slow links with queues of 1 to 6."""
    hub, leaves = 0, np.arange(1, 7)
    src, dst = np.concatenate((leaves, leaves * 0)), np.concatenate((leaves * 0, leaves))
    topology = Topology(
        7,
        src=src,
        src_port=np.where(src == hub, dst, 0),
        dst=dst,
        dst_port=np.where(dst == hub, src, 0),
        bits_per_s=np.where(src == hub, 2_000_000, 50_000_000),
        bits_per_byte=10,
        delay_ns=rng.integers(70, 5_000, 12),
        queue_packets=np.where(src == hub, dst, 3),
    )
    ends = np.stack([rng.integers(1, 7, 1500), rng.integers(1, 7, 1500)], axis=1)
    return workload(topology, rng.integers(60_000_000, size=1500), ends, rng)


def random(rng: np.random.Generator) -> Workload:
    """Directed links of many rates, delays and queues between 25 nodes, traffic from anywhere to anywhere."""
    n_nodes, n_links, n = 25, 90, 3000
    topology = Topology(
        n_nodes,
        src=rng.permutation(np.arange(n_links) % n_nodes),
        src_port=rng.permutation(n_links),
        dst=rng.permutation(np.arange(n_links) % n_nodes),
        dst_port=rng.permutation(n_links),
        bits_per_s=rng.choice([2_000_000, 5_000_000, 10_000_000, 20_000_000], n_links),
        bits_per_byte=rng.choice([8, 10], n_links),
        delay_ns=rng.integers(1, 300_000, n_links),
        queue_packets=rng.choice([-1, 1, 2, 5], n_links),
    )
    return workload(topology, rng.integers(80_000_000, size=n), rng.integers(n_nodes, size=(n, 2)), rng)


CASES: dict[str, Callable[[np.random.Generator], Workload]] = {
    case.__name__: case for case in (line, tree, mesh, queues, random)
}


def no_tie_matters(work: Workload) -> bool:
    """Whether all ends the same way with other rules for what happens first at one instant."""
    topology = work.topology
    columns = (work.t_ns, work.node, work.dest, work.size_bytes, np.arange(work.n_packets))
    offers = [(*row, NO_LINK) for row in zip(*(column.tolist() for column in columns), strict=True)]
    last_port_first = Topology(
        **{f.name: getattr(topology, f.name) for f in fields(Topology)}
        | {"dst_port": topology.dst_port.max() - topology.dst_port}
    )
    ends = [
        sorted(simulate(network, offers, [(0, "set_routes", work.routes)], arrivals_first=arrivals_first))
        for network, arrivals_first in ((topology, False), (topology, True), (last_port_first, False))
    ]
    return ends[0] == ends[1] == ends[2]


def make(case: str, seed: int) -> Workload:
    """The first workload of this kind from `seed` on in which no tie matters."""
    for number in range(seed, seed + 50):
        work = CASES[case](np.random.default_rng(number))
        if no_tie_matters(work):
            return work
    raise AssertionError(f"{case}: there is always a tie")


def _write_golden() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program, why = ns3_network.build(folder)
        if program is None:
            raise SystemExit(why)
        for case in CASES:
            ns3_network.write_inputs(folder, make(case, 1))
            done = ns3_network.run(program, folder, UNTIL_NS)
            goal = GOLDEN / case
            goal.mkdir(parents=True, exist_ok=True)
            for file in (*INPUTS, *ns3_network.OUTPUTS):
                (goal / f"{file}.gz").write_bytes(gzip.compress((folder / file).read_bytes(), mtime=0))
            print(f"{case}: {len(done.delivered)} delivered, {len(done.dropped)} dropped, {done.hops} hops")  # noqa: T201


if __name__ == "__main__":
    _write_golden()
