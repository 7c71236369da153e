"""Delivery times and drops against ns-3, to the nanosecond: golden files, and ns-3 itself where it is wanted.

`SKINNET_NS3=1 pytest tests/skinnet/network/test_network_ns3.py` also builds and runs the program in tests/ns3
(Debian: apt-get install g++ libns3-dev).
"""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from ns3_cases import CASES, GOLDEN, INPUTS, UNTIL_NS, make

from skinnet.network.csv.csv_simulation import SimulationFiles, simulate_csv
from skinnet.network.packet_network import EndedPackets, PacketNetwork
from skinnet.network.records import Outcome
from skinnet.network.routes import NO_LINK
from skinnet.tools.bench import ns3_network, simpy_network
from skinnet.tools.bench.reference_network import OfferedPacket
from skinnet.tools.bench.workload import Workload

Rows = list[tuple[str, ...]]


def rows_in_order(path: Path) -> Rows:
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    return [tuple(line.split(",")) for line in text.splitlines()[1:]]


def rows(path: Path) -> Rows:
    return sorted(rows_in_order(path))


def run(work: Workload) -> tuple[PacketNetwork, EndedPackets]:
    network = PacketNetwork(work.topology)
    network.set_routes(0, work.routes)
    network.enqueue(work.t_ns, work.node, work.dest, work.size_bytes, np.arange(work.n_packets))
    return network, network.advance(UNTIL_NS)


def ours(inputs: Path, suffix: str, out: Path, routes: bool = True) -> tuple[Rows, Rows]:
    files = SimulationFiles(
        inputs / f"links.csv{suffix}",
        inputs / f"packets.csv{suffix}",
        out / "delivered.csv",
        inputs / f"routes.csv{suffix}" if routes else None,
        out / "drops.csv",
    )
    figures = simulate_csv(files, UNTIL_NS)
    assert figures["packets.conserved"]
    assert figures["packets.in_flight"] == 0
    drops = rows(out / "drops.csv")
    assert {row[3] for row in drops} <= {"queue_full", "no_route"}
    return rows(out / "delivered.csv"), [row[:3] for row in drops]


@pytest.mark.parametrize("case", CASES)
def test_equals_ns3_to_the_nanosecond_with_its_drops(case: str, tmp_path: Path) -> None:
    delivered, dropped = ours(GOLDEN / case, ".gz", tmp_path)
    assert delivered == rows(GOLDEN / case / "ns3_delivered.csv.gz")
    assert dropped == rows(GOLDEN / case / "ns3_drops.csv.gz")
    assert bool(dropped) == (case != "line")
    network, _ = run(make(case, 1))
    packets, size, waiting = np.array(rows_in_order(GOLDEN / case / "ns3_counters.csv.gz"), dtype=np.int64).T
    counters = network.link_counters
    assert np.array_equal(counters.packets, packets)
    assert np.array_equal(counters.bytes, size)
    sent_at_once = (packets > 0) & (counters.queue_high_water == 0)  # ns-3 puts these into the queue, too
    apart = np.abs(counters.queue_high_water + sent_at_once - waiting)
    # where a packet arrives as another's transmission ends, ns-3 may have both in the queue for that instant
    assert apart.sum() <= (1 if case == "mesh" else 0)
    # the routes in the file are those of fewest hops
    assert ours(GOLDEN / case, ".gz", tmp_path, routes=False) == (delivered, dropped)


@pytest.mark.parametrize("case", CASES)
def test_equals_simpy_with_its_drops(case: str) -> None:
    work = make(case, 1)
    columns = (work.t_ns, work.node, work.dest, work.size_bytes, np.arange(work.n_packets))
    offers: list[OfferedPacket] = [
        (*row, NO_LINK) for row in zip(*(c.tolist() for c in columns), strict=True)
    ]
    expected = simpy_network.simulate(work.topology, work.routes, offers)
    _, done = run(work)
    assert sorted(zip(*(column.tolist() for column in done), strict=True)) == expected
    assert {end[4] for end in expected} <= {Outcome.DELIVERED, Outcome.QUEUE_FULL, Outcome.NO_ROUTE}


@pytest.mark.skipif(not os.environ.get("SKINNET_NS3"), reason="set SKINNET_NS3=1 to build and run ns-3")
@pytest.mark.parametrize("case", CASES)
def test_ns3_itself_gives_the_golden_files_and_agrees_on_new_packets(
    case: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.getbasetemp()
    program: Path | None = folder / "skin_network"
    if not (folder / "skin_network").exists():
        program, why = ns3_network.build(folder)
        if program is None:
            pytest.skip(why)
    assert program is not None
    fresh = tmp_path_factory.mktemp(case)
    for name in INPUTS:
        (fresh / name).write_bytes(gzip.decompress((GOLDEN / case / f"{name}.gz").read_bytes()))
    ns3_network.run(program, fresh, UNTIL_NS)
    for name in ns3_network.OUTPUTS:
        assert (fresh / name).read_bytes() == gzip.decompress((GOLDEN / case / f"{name}.gz").read_bytes())
    for seed in range(100, 400, 60):
        ns3_network.write_inputs(fresh, make(case, seed))
        ns3_network.run(program, fresh, UNTIL_NS)
        assert ours(fresh, "", fresh) == (rows(fresh / "ns3_delivered.csv"), rows(fresh / "ns3_drops.csv"))
