"""The network of a host: every packet is accounted for, and formed routes lead everywhere and back."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path
from small_robot import lattice, patch, small

from cells.networking.demultiplexer import DeliveredPackets
from cells.networking.packet_pool import PacketKind, PacketPool
from cells.networking.skin_network import SkinNetwork
from cells.networking.wiring import wire_cells
from cells.sensing.encoding import EncoderOutput
from skinnet.deployment import Deployment
from skinnet.network import kernel
from skinnet.network.records import NULL, KernelScratch, KernelState, Outcome
from skinnet.protocol.messages import Config, Topology
from skinnet.skin.placement import place_patch

PERIOD_NS = 4_000_000
PATCHES = (patch("arm", 4, 3, (0, 2), (11, 0)), patch("hand", 3, 1), patch("chest", 5, 4, (7, 0)))
PATCHES[2]["interfaces"] = [{"cell": 19, "port": 0}]


def network_of(*patches: dict[str, Any], **tables: Any) -> tuple[SkinNetwork, Deployment]:
    deployment = small(*(patches or PATCHES), **tables)
    placed = tuple(place_patch(patch, deployment.cells) for patch in deployment.patches)
    network = SkinNetwork(
        wire_cells([[p] for p in placed], deployment.network), deployment.cells, deployment.network, 1
    )
    network.start(0)
    return network, deployment


def formed(*patches: dict[str, Any], **tables: Any) -> tuple[SkinNetwork, Deployment]:
    """A network that has formed, at rest."""
    network, deployment = network_of(*patches, **tables)
    while None in network.membership.formed_ns:
        assert network.kernel.now_ns < 10**9
        assert network.advance(network.kernel.now_ns + PERIOD_NS) == ([], [])
    assert network.kernel.counters.in_flight == 0
    return network, deployment


def said(cells: Any, streaming: Any = ()) -> EncoderOutput:
    """An event of each of `cells`, and a full reading of each of those that stream."""
    cells = np.array(cells, dtype=np.int64)
    byte = (cells % 4).astype(np.uint8)
    value = cells.astype(np.float32) / 8
    return EncoderOutput(cells, byte, byte, byte % 2, byte, value, np.array(streaming, dtype=np.int64))


def send(network: SkinNetwork, t_ns: int, cells: Any, streaming: Any = ()) -> None:
    n = network.wiring.n_cells
    readings = np.arange(8 * n, dtype=np.float32).reshape(n, 8)
    network.send_samples(np.full(n, t_ns), said(cells, streaming), readings)


def assert_conserved(network: SkinNetwork) -> None:
    kernel, counters = network.kernel.counters, network.counters()
    assert kernel.offered == kernel.delivered + sum(kernel.dropped.values()) + kernel.in_flight
    for entry in counters.values():
        ended = sum(entry[outcome.name.lower()] for outcome in Outcome)
        assert entry["offered"] == ended + entry["in_flight"]
        assert entry["in_flight"] >= 0
    for ours, theirs in (("offered", kernel.offered), ("in_flight", kernel.in_flight)):
        assert sum(entry[ours] for entry in counters.values()) == theirs
    assert sum(entry["delivered"] for entry in counters.values()) == kernel.delivered


traffic = st.lists(
    st.tuples(st.integers(0, 3_000_000), st.lists(st.integers(0, 34), unique=True), st.booleans()), max_size=6
)


@settings(max_examples=30)
@given(traffic=traffic, queue=st.integers(0, 3), jitter=st.sampled_from([0.0, 40.0]))
def test_packets_are_conserved_at_every_moment(
    traffic: list[tuple[int, list[int], bool]], queue: int, jitter: float
) -> None:
    """While the network forms and after, with queues that run over."""
    network, _ = network_of(network={"queue_packets": queue, "jitter_us": jitter})
    assert network.wiring.n_cells == 35
    delivered = 0
    for wait_ns, cells, stream in traffic * 3:
        t_ns = network.kernel.now_ns + 1
        send(network, t_ns, cells, cells if stream else ())
        network.send_config(t_ns, 3, Config(patch="arm", cell=3))
        assert_conserved(network)
        data, _ = network.advance(t_ns + wait_ns)
        delivered += sum(len(one.rows) for one in data)
        assert_conserved(network)
    data, _ = network.advance(network.kernel.now_ns + 10**9)
    delivered += sum(len(one.rows) for one in data)
    assert_conserved(network)
    counters = network.counters()
    assert network.kernel.counters.in_flight == 0
    assert delivered == counters["event"]["delivered"] + counters["reading"]["delivered"]
    assert network.demultiplexer.latency_us.sum() == delivered


def hops(network: SkinNetwork, index: int) -> NDArray[np.int64]:
    """Fewest hops from each cell of a patch to its interface, by someone else's search."""
    placed = network.wiring.patches[index]
    n = placed.n_cells
    ends = [(a, b) for a, _, b, _ in placed.wires.tolist()] + [
        (cell, n) for cell, _ in placed.interfaces.tolist()
    ]
    a, b = np.array(ends).T
    graph = coo_array((np.ones(len(ends)), (a, b)), shape=(n + 1, n + 1))
    distance = shortest_path(graph, directed=False, unweighted=True, indices=n)
    steps: NDArray[np.int64] = distance[:n].astype(np.int64)
    return steps


def test_what_the_cells_find_out_is_how_they_are_wired() -> None:
    network, _ = formed()
    assert network.membership.is_member.all()
    for index, placed in enumerate(network.wiring.patches):
        found = network.membership.topology_message(index, 7)
        assert (found.patch, found.t_ns, found.version) == (placed.name, 7, 1)
        assert sorted(found.network_id) == list(range(1, placed.n_cells + 1))
        assert found.depth == hops(network, index).tolist()
        wired = np.full((placed.n_cells, 4), -1)
        for a, port_a, b, port_b in placed.wires.tolist():
            wired[a, port_a], wired[b, port_b] = b, a
        assert found.neighbours == wired.tolist()
        for cell, (parent, port) in enumerate(zip(found.parent, found.master_port, strict=True)):
            if parent < 0:
                assert [cell, port] == placed.interfaces[found.gateway[cell]].tolist()
            else:
                assert wired[cell, port] == parent
                assert found.gateway[cell] == found.gateway[parent]
                assert found.depth[cell] == found.depth[parent] + 1


def hop_ns(deployment: Deployment, size_bytes: int) -> int:
    """Serialisation and delay of one hop, with nobody else on the link."""
    spec = deployment.network
    return size_bytes * spec.bits_per_byte * 10**9 // spec.bits_per_s + round(spec.hop_delay_us * 1000)


@pytest.mark.parametrize("stream", [False, True])
def test_a_lone_packet_takes_its_hops(stream: bool) -> None:
    """From every cell to the gateway of its tree: depth × (size × bits / rate + delay), to the nanosecond."""
    network, deployment = formed()
    spec = deployment.network
    one_ns = hop_ns(deployment, spec.stream_bytes if stream else spec.event_bytes)
    for index, placed in enumerate(network.wiring.patches):
        found = network.membership.topology_message(index, 0)
        for cell in range(placed.n_cells):
            number = int(network.wiring.first_cell[index]) + cell
            t_ns = network.kernel.now_ns
            send(network, t_ns, [] if stream else [number], [number] if stream else [])
            data, configs = network.advance(t_ns + 100_000_000)
            assert not configs
            (one,) = data
            assert one.patch == index
            assert one.kind == (PacketKind.READING if stream else PacketKind.EVENT)
            assert one.rows["cell"].tolist() == [number]
            assert one.t_ns.tolist() == [t_ns + found.depth[cell] * one_ns]
            assert one.gateway.tolist() == [found.gateway[cell]]
            if stream:
                assert one.rows["values"][0].tolist() == list(range(8 * number, 8 * number + 8))
            else:
                assert one.rows["value"][0] == np.float32(number / 8)
    assert network.demultiplexer.latency_max_ns == max(hops(network, i).max() for i in range(3)) * one_ns


def test_configurations_reach_every_cell() -> None:
    network, deployment = formed()
    one_ns = hop_ns(deployment, deployment.network.control_bytes)
    for index, placed in enumerate(network.wiring.patches):
        for cell, depth in enumerate(network.membership.topology_message(index, 0).depth):
            number = int(network.wiring.first_cell[index]) + cell
            config = Config(patch=placed.name, cell=cell, stream=True)
            t_ns = network.kernel.now_ns
            network.send_config(t_ns, number, config)
            assert network.advance(t_ns + depth * one_ns) == ([], [])  # up to, but not with, that instant
            assert network.advance(t_ns + depth * one_ns + 1) == ([], [(number, config)])
    assert network.counters()["config"]["delivered"] == 35


def test_packets_of_one_link_queue_behind_each_other() -> None:
    """Two hexagons in a row: both send at once, and the inner one's packet is first on the last wire."""
    network, deployment = formed(patch("hand", 2, 1), network={"hop_delay_us": 100.0})
    wire_ns, delay_ns = 40_000, 100_000  # 8 bytes × 10 bits at 2 Mbit/s
    t_ns = network.kernel.now_ns
    send(network, t_ns, [0, 1, 0])
    (one,), _ = network.advance(t_ns + PERIOD_NS)
    assert one.rows["cell"].tolist() == [0, 0, 1]
    assert (one.t_ns - t_ns).tolist() == [
        wire_ns + delay_ns,
        2 * wire_ns + delay_ns,
        2 * (wire_ns + delay_ns),
    ]
    assert hop_ns(deployment, 8) == wire_ns + delay_ns


def collected(parts: list[list[DeliveredPackets]]) -> list[Any]:
    rows = [
        (one.patch, int(one.kind), t, g, row.tobytes())
        for part in parts
        for one in part
        for t, g, row in zip(one.t_ns.tolist(), one.gateway.tolist(), one.rows, strict=True)
    ]
    return sorted(rows, key=lambda row: row[:3])


@settings(max_examples=20)
@given(cuts=st.lists(st.integers(1, 5_000_000), max_size=5))
def test_how_time_is_cut_makes_no_difference(cuts: list[int]) -> None:
    def run(cuts: list[int]) -> tuple[list[Any], Any]:
        network, _ = formed(network={"queue_packets": 2, "jitter_us": 30.0})
        start_ns = network.kernel.now_ns
        send(network, start_ns, range(35), range(0, 35, 2))
        parts = []
        for cut in [*sorted(cuts), 10**9]:
            data, _ = network.advance(start_ns + cut)
            parts.append(data)
        return collected(parts), network.counters()

    whole = run([])
    assert whole[1]["event"]["queue_full"] > 0
    assert run(cuts) == whole


def test_a_cell_that_no_wire_leads_to_stays_unreached() -> None:
    apart = patch("arm", 2, 1)
    apart["lattice"] = None
    apart["cells"] = [
        {"position_m": (x, 0.0, 0.0), "normal": (0, 0, 1), "x_axis": (1, 0, 0)} for x in (0.0, 0.0242, 0.1)
    ]
    network, _ = formed(apart, patch("hand", 2, 2))
    assert network.membership.is_member.tolist() == [True, True, False, True, True, True, True]
    found = network.membership.topology_message(0, 0)
    assert found.network_id[2] == 0
    assert found.neighbours[2] == [-1] * 4
    network.send_config(network.kernel.now_ns, 2, Config(patch="arm", cell=2))
    send(network, network.kernel.now_ns, [2])
    assert network.advance(network.kernel.now_ns + PERIOD_NS) == ([], [])
    counters = network.counters()
    assert counters["config"]["no_route"] == counters["event"]["no_route"] == 1
    assert_conserved(network)


def test_one_row_of_cells_uses_two_ports_of_four() -> None:
    """The cells call on all of their ports; most lead nowhere."""
    for columns in (1, 2, 6):
        network, _ = formed({**patch("hand"), "lattice": lattice(columns, 1)})
        assert network.membership.topology_message(0, 0).depth == list(range(1, columns + 1))


def test_the_same_seed_forms_the_same_network() -> None:
    def form(jitter: float) -> list[Topology]:
        network, _ = formed(network={"jitter_us": jitter})
        return [network.membership.topology_message(i, 0) for i in range(3)]

    assert form(50.0) == form(50.0)


@given(st.lists(st.one_of(st.integers(0, 700), st.none()), max_size=30))
def test_rows_of_the_pool_belong_to_one_packet_at_a_time(steps: list[int | None]) -> None:
    """None gives back what was taken first."""
    pool = PacketPool(capacity=4)
    taken: list[NDArray[np.int64]] = []
    for n in steps:
        if n is not None:
            taken.append(pool.allocate(n))
        elif taken:
            pool.free(taken.pop(0))
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *taken])
        assert len(set(rows.tolist())) == len(rows)
        assert not len(rows) or (rows.min() >= 0 and rows.max() < len(pool.rows))
    most = 4
    while most < sum(n for n in steps if n):
        most *= 2
    assert len(pool.rows) <= most


def test_contents_go_with_their_rows() -> None:
    pool = PacketPool(capacity=2)
    rows = [pool.allocate_object(PacketKind.CONFIG, cell, f"config {cell}") for cell in range(5)]
    assert [pool.objects[row] for row in rows] == [f"config {cell}" for cell in range(5)]
    assert pool.rows["cell"][rows].tolist() == list(range(5))
    assert (pool.rows["kind"][rows] == PacketKind.CONFIG).all()
    pool.free(np.array(rows))
    assert not pool.objects


def test_a_lost_packet_shows_in_the_counters(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel forgets a queued packet: offered no longer equals what ended and what is in the queues."""
    network, _ = formed()
    send(network, network.kernel.now_ns + 1, range(10))
    network.advance(network.kernel.now_ns + 300_000)
    assert_conserved(network)
    assert network.counters()["event"]["in_flight"] > 0
    real_advance = kernel.advance

    def forgetful_advance(until_ns: int, hop_limit: int, state: KernelState, scratch: KernelScratch) -> int:
        busy = np.flatnonzero(state.links["head"] != NULL)
        if busy.size:
            state.links["head"][busy[0]] = state.packets["next"][state.links["head"][busy[0]]]
        return real_advance(until_ns, hop_limit, state, scratch)

    monkeypatch.setattr(kernel, "advance", forgetful_advance)
    network.advance(network.kernel.now_ns + PERIOD_NS)
    with pytest.raises(AssertionError):
        assert_conserved(network)
