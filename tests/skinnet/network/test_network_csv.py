"""`skinnet network simulate`: the same as the plain heap of events, and every bad file by file and line."""

import csv
import gzip
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skinnet.cli.main import main
from skinnet.errors import DeploymentError
from skinnet.network.csv import csv_tables as csv_files
from skinnet.network.csv.csv_simulation import SimulationFiles, simulate_csv
from skinnet.network.packet_ids import IdSet, PacketSlots
from skinnet.network.records import Outcome
from skinnet.network.routes import NO_LINK, Routes, min_hop_routes
from skinnet.network.topology import Topology
from skinnet.tools.bench.reference_network import simulate as plain

LINKS = "src,src_port,dst,dst_port,bits_per_s,bits_per_byte,delay_ns,queue_packets\n"
PACKETS = "id,t_ns,node,dest,size_bytes\n"
ROUTES = "node,dest,src_port\n"
GOOD = {
    # 1 — 2 — 3 in a row, port 0 forward and 1 back; a byte takes 1 µs
    "links.csv": LINKS + "1,0,2,1,10000000,10,0,\n2,1,1,0,10000000,10,0,-1\n"
    "2,0,3,1,10000000,10,0,\n3,1,2,0,10000000,10,0,3\n",
    "packets.csv": PACKETS + "7,0,1,3,5\n8,1,1,3,5\n9,1,3,1,5\n",
    "routes.csv": ROUTES + "1,3,0\n2,3,0\n3,1,1\n2,1,1\n",
}


def write(path: Path, text: str | bytes) -> Path:
    content = text.encode() if isinstance(text, str) else text
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def rows(path: Path) -> list[tuple[str, ...]]:
    content = path.read_bytes()
    text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode()
    return [tuple(row) for row in csv.reader(text.splitlines())]


def files(folder: Path, change: dict[str, str | bytes], *, routes: bool = True) -> SimulationFiles:
    written = {name: write(folder / name, text) for name, text in (GOOD | change).items()}
    return SimulationFiles(
        written["links.csv"],
        written["packets.csv"],
        folder / "delivered.csv",
        written["routes.csv"] if routes else None,
        folder / "drops.csv",
    )


def column(name: str, values: Any) -> list[str]:
    return [name, *(str(v) for v in np.asarray(values).tolist())]


def table(**columns: Any) -> str:
    lines = zip(*(column(name, values) for name, values in columns.items()), strict=True)
    return "".join(",".join(line) + "\n" for line in lines)


@pytest.mark.parametrize(("given", "block_bytes", "suffix"), [(True, 2**23, ".csv"), (False, 700, ".csv.gz")])
def test_equals_the_heap_of_events_in_blocks_of_any_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: bool, block_bytes: int, suffix: str
) -> None:
    """All impairments, full queues, ids in no order; nodes huge, negative, sparse where nothing is drawn."""
    monkeypatch.setattr(csv_files, "_BLOCK_BYTES", block_bytes)
    rng = np.random.default_rng(11)
    n, n_links, n_packets = 12, 40, 1500
    ports = {name: rng.permutation(n_links) for name in ("src_port", "dst_port")}
    links: dict[str, Any] = {
        "src": rng.permutation(np.arange(n_links) % n),
        **ports,
        "dst": rng.permutation(np.arange(n_links) % n),
        "bits_per_s": rng.choice([9_000_000, 10_000_000], n_links),
        "bits_per_byte": rng.choice([8, 10], n_links),
        "delay_ns": rng.integers(0, 30_000, n_links),
        "queue_packets": rng.choice([-1, 1, 3], n_links),
    }
    impairments = {
        "loss_probability": rng.choice([0.0, 0.125], n_links),
        "jitter_ns": rng.choice([0, 9_000], n_links),
        "bit_error_rate": rng.choice([0.0, 2.0**-12], n_links),
    }
    topology = Topology(n, **links, **(impairments if given else {}))
    packets = {
        "t_ns": np.sort(rng.integers(0, 4_000_000, n_packets)),
        "node": rng.integers(n, size=n_packets),
        "dest": rng.integers(n, size=n_packets),
        "size_bytes": rng.integers(1, 70, n_packets),
    }
    ids = rng.permutation(n_packets) - 100
    routes = min_hop_routes(topology, range(n))
    kept = routes.link != NO_LINK
    if given:
        kept &= rng.random(kept.size) < 0.97  # without a way, here and there
    routes = Routes(routes.node[kept], routes.dest[kept], routes.link[kept])
    until_ns = 4_200_000
    offers = [(*row, NO_LINK) for row in zip(*packets.values(), ids, strict=True)]
    expected = [
        end
        for end in plain(topology, [tuple(map(int, o)) for o in offers], [(0, "set_routes", routes)], seed=3)  # type: ignore[misc]
        if end[1] < until_ns
    ]
    assert {end[4] for end in expected} >= {Outcome.QUEUE_FULL, Outcome.DELIVERED}

    names = np.arange(n) if given else np.sort(rng.integers(-(2**63), 2**63 - 1, n))
    links |= {"src": names[links["src"]], "dst": names[links["dst"]]} | (impairments if given else {})
    backwards = dict(reversed(links.items()))  # columns may stand in any order
    write(tmp_path / f"links{suffix}", table(**backwards).replace(",-1,", ",,"))
    named = {name: names[values] if name in ("node", "dest") else values for name, values in packets.items()}
    write(tmp_path / f"packets{suffix}", table(id=ids, **named).replace("\n", "\r\n"))
    route_table = table(
        node=names[routes.node], dest=names[routes.dest], src_port=topology.src_port[routes.link]
    )
    write(tmp_path / f"routes{suffix}", route_table.replace("\n", "\n\n"))
    figures = simulate_csv(
        SimulationFiles(
            tmp_path / f"links{suffix}",
            tmp_path / f"packets{suffix}",
            tmp_path / f"delivered{suffix}",
            tmp_path / f"routes{suffix}" if given else None,
            tmp_path / f"drops{suffix}",
        ),
        until_ns,
        seed=3,
    )
    got = rows(tmp_path / f"delivered{suffix}")
    assert got[0] == ("id", "t_delivered_ns")
    assert got[1:] == [(str(e[0]), str(e[1])) for e in expected if e[4] == Outcome.DELIVERED]
    lost = rows(tmp_path / f"drops{suffix}")
    assert lost[0] == ("id", "t_ns", "node", "cause")
    assert lost[1:] == [
        (str(e[0]), str(e[1]), str(names[e[2]]), Outcome(e[4]).name.lower())
        for e in expected
        if e[4] != Outcome.DELIVERED
    ]
    assert figures["packets.offered"] == n_packets
    assert figures["packets.in_flight"] == n_packets - len(expected) > 0
    assert (
        figures["packets.dropped"]
        == len(lost) - 1
        == sum(figures[f"packets.dropped.{outcome.name.lower()}"] for outcome in Outcome if outcome)
    )
    assert figures["packets.conserved"]
    entered = dict(zip(ids.tolist(), packets["t_ns"].tolist(), strict=True))
    latency_ms = np.array([e[1] - entered[e[0]] for e in expected if e[4] == Outcome.DELIVERED]) / 1e6
    assert figures["latency.mean_ms"] == pytest.approx(latency_ms.mean())
    assert figures["latency.largest_ms"] == latency_ms.max()
    for name, share in (("p50", 50), ("p99", 99)):
        exact = np.percentile(latency_ms, share, method="inverted_cdf")
        assert exact <= figures[f"latency.{name}_ms"] * (1 + 1e-9) <= exact * 1.006


def test_the_end_is_open_and_later_packets_are_counted_apart(tmp_path: Path) -> None:
    given = files(tmp_path, {})
    figures = simulate_csv(given, 10_000)  # the first packet arrives at 2 × 5 µs sharp
    assert rows(given.delivered) == [("id", "t_delivered_ns")]
    assert (figures["packets.offered"], figures["packets.in_flight"]) == (3, 3)
    figures = simulate_csv(given, 10_001)
    assert rows(given.delivered)[1:] == [("7", "10000")]
    figures = simulate_csv(given, 1)
    assert (figures["packets.offered"], figures["packets.not_before_until"]) == (1, 2)
    assert figures["packets.conserved"]
    figures = simulate_csv(files(tmp_path, {"packets.csv": PACKETS}), 10**9)
    assert figures["packets.offered"] == 0
    assert figures["latency.mean_ms"] is None


def test_quotes_spaces_signs_and_byte_order_mark_are_read(tmp_path: Path) -> None:
    odd = '\ufeff"id", "t_ns","node","dest","size_bytes"\r\n"7",0 ,+1, 3,5\r\n\r\n  \n"8","1",1,3,"5"'
    given = files(tmp_path, {"packets.csv": odd}, routes=False)
    assert simulate_csv(given, 10**9)["packets.delivered"] == 2
    assert rows(given.delivered)[1:] == [("7", "10000"), ("8", "15000")]


def links_with(row: str) -> dict[str, str | bytes]:
    return {"links.csv": str(GOOD["links.csv"]) + row + "\n"}


def packets_with(row: str) -> dict[str, str | bytes]:
    return {"packets.csv": str(GOOD["packets.csv"]) + row + "\n"}


def routes_with(row: str) -> dict[str, str | bytes]:
    return {"routes.csv": str(GOOD["routes.csv"]) + row + "\n"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"links.csv": "src,src_port,dst\n"}, "links.csv:1: missing column dst_port"),
        ({"packets.csv": "id,t_ns,node,dest,size_bytes,colour\n"}, "packets.csv:1: unknown column 'colour'"),
        ({"packets.csv": "id,t_ns,node,dest,id\n"}, "packets.csv:1: column id is duplicated"),
        ({"packets.csv": ""}, "packets.csv:1: no header"),
        ({"links.csv": LINKS}, "links.csv:2: no link"),
        ({"links.csv": b"\x00\xff\x89PNG" * 9}, "links.csv:1: not a line of text"),
        ({"packets.csv": gzip.compress(b"id,t_ns\n")}, "packets.csv:1: not a line of text"),
        ({"packets.csv": PACKETS.encode() + b"\x00\xfe\x89" * 9}, "packets.csv:2: 1 fields; allowed are 5"),
        (links_with("3,0,1,7,0,10,0,"), "links.csv:6: bits_per_s is 0; allowed are whole numbers from 1 to"),
        (links_with("3,0,1,7,-5,10,0,"), "links.csv:6: bits_per_s is -5"),
        (
            links_with("3,0,1,7,5,0,0,"),
            "links.csv:6: bits_per_byte is 0; allowed are whole numbers from 1 to 64",
        ),
        (links_with("3,0,1,7,5,8,-1,"), "links.csv:6: delay_ns is -1"),
        (links_with("3,0,1,7,5,8,0,-2"), "links.csv:6: queue_packets is -2"),
        (links_with("3,-1,1,7,5,8,0,"), "links.csv:6: src_port is -1"),
        (links_with("3,,1,7,5,8,0,"), "links.csv:6: src_port is empty"),
        (
            links_with("3,0,1,0,5,8,0,"),
            "links.csv:6: a second link arrives at port 0 of node 1, the first is on line 3",
        ),
        (
            links_with("3,1,1,7,5,8,0,"),
            "links.csv:6: a second link leaves port 1 of node 3, the first is on line 5",
        ),
        (links_with("3,0,1,7,5,8,0"), "links.csv:6: 7 fields; allowed are 8"),
        (links_with("3,0,1,7,5,8,0,,"), "links.csv:6: 9 fields; allowed are 8"),
        (packets_with("10,0,1,3,5"), "packets.csv:5: t_ns is 0 after 1; packets must be in order of time"),
        (packets_with("7,2,1,3,5"), "packets.csv:5: id 7 is duplicated"),
        (packets_with("10,2,4,3,5"), "packets.csv:5: node 4 has no link"),
        (packets_with("10,2,1,-3,5"), "packets.csv:5: dest -3 has no link"),
        (packets_with("10,2,1,3,0"), "packets.csv:5: size_bytes is 0; allowed are whole numbers from 1 to"),
        (packets_with("10,2,1,3,5.0"), "packets.csv:5: size_bytes is '5.0'"),
        (packets_with("10,2,1,3,1_0"), "packets.csv:5: size_bytes is '1_0'"),
        (packets_with("ten,2,1,3,5"), "packets.csv:5: id is 'ten'"),
        (packets_with("-,2,1,3,5"), "packets.csv:5: id is '-'"),
        (packets_with("1 0,2,1,3,5"), "packets.csv:5: id is '1 0'"),
        (packets_with("-"), "packets.csv:5: 1 fields; allowed are 5"),
        (packets_with("9223372036854775808,2,1,3,5"), "packets.csv:5: id is '9223372036854775808'"),
        (packets_with("10,4611686018427387903,1,3,5"), "packets.csv:5: packets up to this line"),
        (packets_with("10,2,1,3"), "packets.csv:5: 4 fields; allowed are 5"),
        (packets_with("\n\n10,2,1,x,5"), "packets.csv:7: dest is 'x'"),
        (routes_with("1,2,5"), "routes.csv:6: no link leaves port 5 of node 1; its links leave ports 0"),
        (routes_with("1,4,0"), "routes.csv:6: dest 4 has no link"),
        (routes_with("1,3,0"), "routes.csv:6: a route from 1 to 3 is already on line 2"),
        (
            links_with("8,0,9,0,5,8,0,") | routes_with("1,9,0"),
            "routes.csv:6: no path between node 1 and dest 9",
        ),
        (links_with("8,0,9,0,5,8,0,") | routes_with("9,8,0"), "no link leaves this node"),
        (
            {"routes.csv": ROUTES + "3,1,1\n1,3,0\n2,3,1\n"},
            "routes.csv:3: the routes to 3 form a loop: 1 → 2 → 1;",
        ),
    ],
)
def test_a_bad_file_is_refused_by_line_and_nothing_is_written(
    tmp_path: Path, change: dict[str, str | bytes], message: str
) -> None:
    given = files(tmp_path, change)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(DeploymentError) as refused:
        simulate_csv(given, 10**9)
    assert str(refused.value).startswith(str(tmp_path)) or message.startswith("no link leaves this")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert sorted(tmp_path.iterdir()) == before


def test_probabilities_are_numbers_from_0_to_1(tmp_path: Path) -> None:
    head = LINKS.replace("\n", ",bit_error_rate,loss_probability\n")
    for last, wrong in (
        ("nan,0", "bit_error_rate is nan"),
        ("0,2", "loss_probability is 2.0"),
        ("0,x", "is 'x'"),
    ):
        given = files(tmp_path, {"links.csv": f"{head}1,0,2,1,9,8,0,,1e-9,.5\n2,0,1,0,9,8,0,,{last}\n"})
        with pytest.raises(DeploymentError, match=f"links.csv:3: .*{wrong}; allowed are numbers from 0 to 1"):
            simulate_csv(given, 10**9)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("packets.csv.gz", b"id,t_ns,node,dest,size_bytes\n", "invalid or truncated gzip file"),
        ("packets.csv.gz", gzip.compress(PACKETS.encode() * 999)[:-9], "invalid or truncated gzip file"),
        ("no/such/packets.csv", None, "No such file"),
        (".", None, "Is a directory"),
    ],
)
def test_a_file_that_cannot_be_read(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    given = files(tmp_path, {})
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(DeploymentError, match=message) as refused:
        simulate_csv(SimulationFiles(given.links, tmp_path / name, given.delivered), 10**9)
    assert str(tmp_path / name) in str(refused.value)


def test_long_ways_round_are_found_and_long_ways_are_not(tmp_path: Path) -> None:
    n = 1000
    nodes = np.arange(n)
    ring = table(
        src=nodes, src_port=nodes * 0, dst=(nodes + 1) % n, dst_port=nodes * 0 + 1,
        bits_per_s=nodes * 0 + 10**9, bits_per_byte=nodes * 0 + 1,
        delay_ns=nodes * 0, queue_packets=nodes * 0,
    )  # fmt: skip
    packets = f"id,t_ns,node,dest,size_bytes\n1,0,0,{n - 1},3\n"
    longest = table(node=nodes[:-1], dest=nodes[:-1] * 0 + n - 1, src_port=nodes[:-1] * 0)
    given = files(tmp_path, {"links.csv": ring, "packets.csv": packets, "routes.csv": longest})
    simulate_csv(given, 10**9)
    assert rows(given.delivered)[1:] == [("1", str(3 * (n - 1)))]
    endless = table(node=nodes, dest=nodes * 0 + 5_000, src_port=nodes * 0)
    spur = "0,7,5000,7,1000000000,1,0,\n"
    given = files(tmp_path, {"links.csv": ring + spur, "packets.csv": packets, "routes.csv": endless})
    with pytest.raises(
        DeploymentError, match=r"routes.csv:2: the routes to 5000 form a loop: 0 → 1 → .* → 999 → 0;"
    ):
        simulate_csv(given, 10**9)


def test_files_that_would_overwrite_each_other_are_refused(tmp_path: Path) -> None:
    given = files(tmp_path, {})
    for out, drops in ((given.packets, None), (given.delivered, given.delivered), (tmp_path, None)):
        with pytest.raises(DeploymentError, match=r"used more than once|is a directory"):
            simulate_csv(SimulationFiles(given.links, given.packets, out, None, drops), 10**9)


def test_ids_are_remembered_as_runs() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        ids = rng.integers(-20, 200, rng.integers(1, 60))
        seen, first = IdSet(), None
        for start in range(0, ids.size, 7):
            again = seen.add(ids[start : start + 7])
            if again is not None:
                first = start + again
                break
        repeated = [i for i in range(ids.size) if ids[i] in ids[:i]]
        assert first == (repeated[0] if repeated else None)
    dense, nobody = IdSet(), np.empty(0, dtype=np.int64)
    assert dense.add(nobody) is None
    for block in np.array_split(np.random.default_rng(1).permutation(1000), 9):
        assert dense.add(block) is None
    assert dense.add(nobody) is None
    assert dense.n_intervals == 1


def test_numbers_of_packets_that_have_left_are_used_again() -> None:
    ledger = PacketSlots()
    for k in range(100):
        numbers = ledger.allocate(np.arange(10) + k, np.arange(10))
        assert numbers.max() < 10
        ids, t_ns = ledger.release(numbers[::-1])
        assert ids.tolist() == list(range(k + 9, k - 1, -1))
        assert t_ns.tolist() == list(range(9, -1, -1))


def test_the_command_prints_a_table_and_exits_with_2_for_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = files(tmp_path, packets_with("10,20,1,1,70000000000"))

    def call(*more: str) -> Any:
        monkeypatch.setattr(
            sys, "argv", ["skinnet", "network", "simulate", "--links", str(given.links), *more]
        )
        with pytest.raises(SystemExit) as left:
            main()
        return left.value.code, *capsys.readouterr()

    rest = ("--packets", str(given.packets), "--until-ns", "20000", "--out", str(given.delivered))
    code, out, err = call(*rest)
    assert code == 2
    assert out == ""
    assert err.startswith(f"skinnet: {given.packets}:5: size_bytes is 70000000000; allowed are")
    write(given.packets, GOOD["packets.csv"])
    code, out, _ = call(*rest)
    assert code in (0, None)
    assert "offered = delivered + dropped + in flight" in out
    code, out, err = call(*rest, "--json", "-")
    assert '"packets.delivered": 3' in out
    assert "offered" in err
