"""The packet kernel against closed forms, a plain heap of events, SimPy, and its own conservation law."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
import simpy
from hypothesis import given, settings
from hypothesis import strategies as st

from skinnet.network import kernel
from skinnet.network.packet_network import EndedPackets, PacketNetwork
from skinnet.network.records import NULL, KernelScratch, KernelState, Outcome
from skinnet.network.routes import NO_LINK, Routes, min_hop_routes
from skinnet.network.topology import Topology
from skinnet.tools.bench.reference_network import simulate

NS = 1_000_000_000
END_NS = 10**12
# one bit on the wire per byte at 1 Gbit/s: a packet of n bytes takes n ns
BYTE_PER_NS = {"bits_per_s": NS, "bits_per_byte": 1}
UART = {"bits_per_s": 12_000_000, "bits_per_byte": 10}  # [T11], [UCD]

Offer = tuple[int, int, int, int, int, int]
Change = tuple[Any, ...]
Scenario = tuple[Topology, list[Offer], list[Change], int]


def offer(network: PacketNetwork, packets: Iterable[Offer]) -> None:
    t_ns, node, dest, size, packet_id, link = np.array(list(packets), dtype=np.int64).reshape(-1, 6).T
    network.enqueue(t_ns, node, dest, size, packet_id, link)


def schedule(network: PacketNetwork, changes: list[Change]) -> None:
    for t_ns, method, *arguments in changes:
        if method == "impair_link":
            link, values = arguments
            network.impair_link(t_ns, link, **values)
        else:
            getattr(network, method)(t_ns, *arguments)


def rows(finished: EndedPackets) -> list[tuple[int, ...]]:
    return list(zip(*(column.tolist() for column in finished), strict=True))


def run(scenario: Scenario, cuts: Iterable[int] = (), *, move: bool = False) -> list[tuple[int, ...]]:
    """Ends of all packets, with everything offered in the stretch in which it enters.

    If they shall `move`, another object carries on at every cut, from a snapshot.
    """
    topology, packets, changes, hop_limit = scenario
    networks = [PacketNetwork(topology, seed=5, hop_limit=hop_limit) for _ in range(2)]
    network = networks[0]
    schedule(network, changes)
    ends: list[tuple[int, ...]] = []
    for turn, until_ns in enumerate([*sorted(cuts), END_NS]):
        if move:
            snapshot = network.snapshot()
            network = networks[turn % 2]
            network.restore(snapshot)
        offer(network, [packet for packet in packets if network.now_ns <= packet[0] < until_ns])
        done = rows(network.advance(until_ns))
        assert all(end[1] < until_ns for end in done)
        ends += done
        now = network.counters
        assert now.offered == now.delivered + sum(now.dropped.values()) + now.in_flight
        assert now.offered - now.in_flight == len(ends)
    assert network.counters.in_flight == 0
    return ends


def line(n_nodes: int, delay_ns: int = 0, **wire: int) -> Topology:
    """Nodes in a row; port 0 looks to the next, port 1 to the one before."""
    return Topology.from_wires(
        n_nodes, [(i, 0, i + 1, 1) for i in range(n_nodes - 1)], delay_ns=delay_ns, **(BYTE_PER_NS | wire)
    )


def patch(n_rows: int, n_columns: int, **wire: int) -> Topology:
    """A gateway, node 0, behind a grid of cells that are wired to their neighbours by four ports."""
    number = 1 + np.arange(n_rows * n_columns).reshape(n_rows, n_columns)
    wires: list[tuple[Any, ...]] = [(0, 0, 1, 3)]
    wires += [(a, 0, b, 1) for a, b in zip(number[:, :-1].flat, number[:, 1:].flat, strict=True)]
    wires += [(a, 2, b, 3) for a, b in zip(number[:-1].flat, number[1:].flat, strict=True)]
    return Topology.from_wires(number.size + 1, wires, **wire)


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """Small networks with every feature, times so small that many things happen at one instant."""
    n_nodes = draw(st.integers(1, 6))
    n_links = draw(st.integers(1, 12))
    nodes = st.integers(0, n_nodes - 1)
    links = st.integers(0, n_links - 1)
    times = st.integers(0, draw(st.sampled_from([4, 30, 300])))

    def column(values: st.SearchStrategy[Any]) -> list[Any]:
        return draw(st.lists(values, min_size=n_links, max_size=n_links))

    topology = Topology(
        n_nodes,
        src=column(nodes),
        src_port=draw(st.permutations(range(n_links))),
        dst=column(nodes),
        dst_port=draw(st.permutations(range(n_links))),
        bits_per_s=column(st.sampled_from([NS, NS, 333_333_333, 2 * NS])),
        bits_per_byte=column(st.sampled_from([1, 1, 3])),
        delay_ns=column(st.integers(0, 4)),
        queue_packets=column(st.sampled_from([-1, -1, 0, 1, 2])),
        loss_probability=column(st.sampled_from([0.0, 0.0, 0.0, 0.3, 1.0])),
        jitter_ns=column(st.sampled_from([0, 0, 3, 9])),
        bit_error_rate=column(st.sampled_from([0.0, 0.0, 0.0, 0.01, 1.0])),
    )

    def one_route() -> st.SearchStrategy[Routes]:
        ways = [
            (int(topology.src[link]), dest, link)
            for link in range(n_links)
            for dest in np.flatnonzero(topology.component == topology.component[topology.src[link]])
        ]
        entries = st.tuples(st.sampled_from(ways), st.booleans())
        return entries.map(
            lambda e: Routes(*(np.array([x]) for x in (e[0][0], e[0][1], e[0][2] if e[1] else NO_LINK)))
        )

    impairment = st.fixed_dictionaries(
        {},
        optional={
            "loss_probability": st.sampled_from([0.0, 0.5]),
            "jitter_ns": st.integers(0, 5),
            "bit_error_rate": st.sampled_from([0.0, 0.02]),
        },
    )
    change = st.one_of(
        st.tuples(times, st.just("fail_link"), links),
        st.tuples(times, st.just("repair_link"), links),
        st.tuples(times, st.just("impair_link"), links, impairment),
        st.tuples(times, st.just("set_routes"), one_route()),
    )
    changes = [
        (0, "set_routes", min_hop_routes(topology, range(n_nodes))),
        *draw(st.lists(change, max_size=6)),
    ]
    packets = []
    for number, (t_ns, node, dest, size, choice) in enumerate(
        draw(st.lists(st.tuples(times, nodes, nodes, st.integers(1, 4), st.integers(0, 20)), max_size=40))
    ):
        leaving = np.flatnonzero(topology.src == node)
        packets.append(
            (t_ns, node, dest, size, number, leaving[choice] if choice < leaving.size else NO_LINK)
        )
    return topology, packets, changes, draw(st.sampled_from([1, 4, 255]))


@settings(max_examples=300, deadline=None)
@given(scenarios(), st.lists(st.integers(0, 320), max_size=5), st.booleans())
def test_equals_the_heap_of_events_however_time_is_cut(
    scenario: Scenario, cuts: list[int], move: bool
) -> None:
    topology, packets, changes, hop_limit = scenario
    expected = simulate(topology, packets, changes, seed=5, hop_limit=hop_limit)
    assert run(scenario, cuts, move=move) == expected


def crowded_patch(seed: int) -> Scenario:
    """A patch of 40 cells; 6000 packets up, across and to neighbours, every impairment, full queues."""
    rng = np.random.default_rng(seed)
    wires = patch(5, 8, **UART, delay_ns=30_000)
    n_nodes, n_links = wires.n_nodes, wires.n_links
    topology = Topology(
        n_nodes,
        src=wires.src,
        src_port=wires.src_port,
        dst=wires.dst,
        dst_port=wires.dst_port,
        **UART,
        delay_ns=30_000,
        queue_packets=rng.choice([-1, 4, 30], n_links),
        loss_probability=rng.choice([0.0, 0.01], n_links),
        jitter_ns=rng.choice([0, 7_000], n_links),
        bit_error_rate=rng.choice([0.0, 1e-4], n_links),
    )
    packets = []
    for number in range(6000):
        node = int(rng.integers(1, n_nodes))
        dest = int(rng.integers(n_nodes)) if rng.random() < 0.3 else 0
        link = int(rng.choice(np.flatnonzero(topology.src == node))) if rng.random() < 0.1 else NO_LINK
        t_ns = int(rng.integers(100)) * 1_000_000
        packets.append((t_ns, node, dest, int(rng.choice([8, 23])), number, link))
    changes: list[Change] = [(0, "set_routes", min_hop_routes(topology, range(n_nodes)))]
    for t_ns in range(5_000_000, 90_000_000, 5_000_000):
        link = int(rng.integers(n_links))
        changes.append((t_ns, "fail_link", link))
        changes.append((t_ns, "set_routes", min_hop_routes(topology, range(n_nodes), dead_links=[link])))
        changes.append((t_ns + 4_000_000, "repair_link", link))
    return topology, packets, changes, 255


def test_equals_the_heap_of_events_in_a_crowded_patch() -> None:
    scenario = crowded_patch(1)
    topology, packets, changes, hop_limit = scenario
    expected = simulate(topology, packets, changes, seed=5, hop_limit=hop_limit)
    assert {end[4] for end in expected} == {
        Outcome.DELIVERED,
        Outcome.QUEUE_FULL,
        Outcome.LINK_FAILED,
        Outcome.LOSS,
        Outcome.CORRUPTED,
    }
    assert run(scenario, range(0, 120_000_000, 777_777)) == expected


def test_all_cells_at_one_instant_equal_the_heap_of_events() -> None:
    # 300 arrivals in one bucket: too many to be sorted by rank
    n_cells = 300
    star = Topology.from_wires(
        n_cells + 1, [(i, 0, 0, n_cells - i) for i in range(1, n_cells + 1)], delay_ns=7, **BYTE_PER_NS
    )
    packets = [(i % 2, i, 0, 1 + i % 5, i, NO_LINK) for i in range(1, n_cells + 1)]
    changes: list[Change] = [(0, "set_routes", min_hop_routes(star, [0]))]
    assert run((star, packets, changes, 255)) == simulate(star, packets, changes, seed=5)


def test_line_of_k_hops_takes_k_times_transmission_and_delay() -> None:
    k, size, delay_ns = 9, 23, 300_000
    network = PacketNetwork(line(k + 1, delay_ns, **UART))
    network.set_routes(0, min_hop_routes(network.topology, [k]))
    offer(network, [(17, 0, k, size, 4, NO_LINK)])
    transmission_ns = -(-size * 10 * NS // 12_000_000)
    assert rows(network.advance(END_NS)) == [
        (4, 17 + k * (transmission_ns + delay_ns), k, 2 * (k - 1), Outcome.DELIVERED)
    ]


def test_rounding_of_a_transmission_is_up_to_the_next_nanosecond() -> None:
    network = PacketNetwork(line(2, bits_per_s=3 * NS))
    network.fail_link(10, 1)
    offer(network, [(0, 0, 0, size, size, 0) for size in (3, 4)])
    assert network.advance(END_NS).t_ns.tolist() == [1, 1 + 2]


def test_equal_branches_merge_in_the_order_of_ports() -> None:
    # three sources, equally far from node 0, whose one output queue decides their order
    wires = [(0, 9, 4, 0), (1, 0, 0, 2), (2, 0, 0, 0), (3, 0, 0, 1)]
    topology = Topology.from_wires(5, wires, delay_ns=5, **BYTE_PER_NS)
    network = PacketNetwork(topology)
    network.set_routes(0, min_hop_routes(topology, [4]))
    arrival_ns = 10 + 5
    # while the first of node 0's own packets ends its transmission, the rest arrive at the same instant
    offer(network, [(0, node, 4, 10, node, NO_LINK) for node in (3, 1, 2)])
    offer(network, [(arrival_ns - 10, 0, 4, 10, 5, NO_LINK), (arrival_ns, 0, 4, 10, 6, NO_LINK)])
    done = network.advance(END_NS)
    assert done.packet_id.tolist() == [5, 6, 2, 3, 1]
    assert done.t_ns.tolist() == [arrival_ns + 5 + 10 * i for i in range(5)]


def test_transmissions_end_before_a_packet_of_the_same_instant_enters() -> None:
    network = PacketNetwork(line(2, queue_packets=0))
    offer(network, [(0, 0, 1, 10, 1, 0), (9, 0, 1, 10, 2, 0), (10, 0, 1, 10, 3, 0)])
    done = network.advance(END_NS)
    assert dict(zip(done.packet_id.tolist(), done.outcome.tolist(), strict=True)) == {
        1: Outcome.DELIVERED,
        2: Outcome.QUEUE_FULL,
        3: Outcome.DELIVERED,
    }


def test_a_queue_of_n_holds_n_behind_the_one_in_transmission() -> None:
    network = PacketNetwork(line(2, queue_packets=3))
    offer(network, [(0, 0, 1, 10, i, 0) for i in range(7)])
    done = network.advance(END_NS)
    assert done.packet_id[done.outcome == Outcome.QUEUE_FULL].tolist() == [4, 5, 6]
    assert done.t_ns[done.outcome == Outcome.DELIVERED].tolist() == [10, 20, 30, 40]
    counters = network.link_counters
    assert (counters.queue_high_water[0], counters.dropped[0], counters.packets[0]) == (3, 3, 4)


def test_published_worst_case_of_eight_cells_behind_one_uart() -> None:
    # [T11]: 8 cells behind one UART, 3 transactions queued first, 300 µs a hop: 7 × 3 × 300 µs = 6.3 ms.
    # The 300 µs are store-and-forward under full load, so the serial link is held for all of them.
    hop_ns, n_cells, transactions = 300_000, 8, 3
    topology = line(n_cells + 1, bits_per_s=NS, bits_per_byte=1)
    network = PacketNetwork(topology)
    network.set_routes(0, min_hop_routes(topology, [0]))
    packets = [
        (0, cell, 0, hop_ns, 10 * cell + i, NO_LINK)
        for cell in range(1, n_cells + 1)
        for i in range(transactions)
    ]
    offer(network, packets)
    done = network.advance(END_NS)
    # the cell at the interface waits for the transactions of the seven behind it: theirs follow its own
    last_own_ns = int(done.t_ns[done.packet_id // 10 == 1].max())
    assert last_own_ns == transactions * hop_ns
    assert int(done.t_ns.max()) - last_own_ns == 7 * 3 * 300_000 == 6_300_000
    assert network.link_counters.busy_ns[1] == n_cells * transactions * hop_ns


def test_mean_wait_is_that_of_an_m_d_1_queue() -> None:
    load, service_ns, n = 0.7, 1000, 200_000
    rng = np.random.default_rng(3)
    t_ns = np.cumsum(rng.exponential(service_ns / load, n)).astype(np.int64)
    network = PacketNetwork(line(2))
    ids = np.arange(n)
    network.enqueue(t_ns, ids * 0, ids * 0, ids * 0 + service_ns, ids, link=ids * 0)
    done = network.advance(END_NS)
    wait_ns = done.t_ns - t_ns[done.packet_id] - service_ns
    # Pollaczek and Khinchine; the error of the mean from 50 batches, which hardly depend on each other
    expected_ns = load * service_ns / (2 * (1 - load))
    batches = wait_ns.reshape(50, -1).mean(axis=1)
    error_ns = batches.std(ddof=1) / np.sqrt(50)
    assert error_ns < 0.05 * expected_ns
    assert abs(wait_ns.mean() - expected_ns) < 4 * error_ns


def test_equals_a_simpy_model_of_a_patch_of_fifty_cells() -> None:
    topology = patch(5, 10, **UART, delay_ns=120_000)
    routes = min_hop_routes(topology, [0])
    ahead = dict(zip(routes.node.tolist(), routes.link.tolist(), strict=True))
    rng = np.random.default_rng(2)
    phase_ns = rng.integers(4_000_000, size=51)
    packets = [
        (int(phase_ns[cell]) + 4_000_000 * k, cell, 0, int(size), 100 * cell + k, NO_LINK)
        for cell in range(1, 51)
        for k, size in enumerate(rng.choice([8, 16, 23, 69], 40))
    ]
    env = simpy.Environment()
    wires = [simpy.Resource(env) for _ in range(topology.n_links)]
    arrived: dict[int, int] = {}

    def travel(t_ns: int, node: int, size: int, packet_id: int) -> Any:
        yield env.timeout(t_ns)
        while node != 0:
            link = ahead[node]
            with wires[link].request() as turn:
                yield turn
                yield env.timeout(-(-size * 10 * NS // 12_000_000))
            yield env.timeout(120_000)
            node = int(topology.dst[link])
        arrived[packet_id] = int(env.now)

    for t_ns, node, _, size, packet_id, _ in packets:
        env.process(travel(t_ns, node, size, packet_id))
    env.run()

    network = PacketNetwork(topology)
    network.set_routes(0, routes)
    offer(network, packets)
    done = network.advance(END_NS)
    assert max(network.link_counters.queue_high_water) > 2
    assert dict(zip(done.packet_id.tolist(), done.t_ns.tolist(), strict=True)) == arrived


def test_a_failure_ends_what_is_on_the_link_and_a_repair_starts_empty() -> None:
    network = PacketNetwork(line(2, delay_ns=100))
    network.fail_link(110, 0)
    network.repair_link(150, 0)
    # the first would arrive at the instant of the failure; then one under way, one in transmission,
    # one waiting, one at the dead link, one after the repair
    offer(network, [(t_ns, 0, 0, 10, t_ns, 0) for t_ns in (0, 90, 101, 102, 140, 150)])
    offer(network, [(9, 1, 1, 100, 9, 1)])
    assert network.advance(110).t_ns.size == 0
    failed, delivered = Outcome.LINK_FAILED, Outcome.DELIVERED
    assert rows(network.advance(END_NS)) == [
        (0, 110, 0, 0, failed),
        (90, 110, 0, 0, failed),
        (101, 110, 0, 0, failed),
        (102, 110, 0, 0, failed),
        (140, 140, 0, 0, failed),
        (9, 209, 0, 1, delivered),
        (150, 260, 1, 0, delivered),
    ]
    counters = network.link_counters
    # 10 ns each for the first two, 9 of 10 for the third, nothing for the fourth, 10 after the repair
    assert (counters.packets[0], counters.bytes[0], counters.busy_ns[0]) == (1, 10, 10 + 10 + 9 + 10)
    assert counters.dropped[0] == 5


def test_a_packet_that_arrived_before_the_failure_is_safe() -> None:
    network = PacketNetwork(line(2, delay_ns=100))
    network.fail_link(111, 0)
    offer(network, [(0, 0, 0, 10, 1, 0)])
    assert rows(network.advance(END_NS)) == [(1, 110, 1, 0, Outcome.DELIVERED)]
    assert network.link_up.tolist() == [False, True]


def test_drops_name_their_cause() -> None:
    topology = line(3)
    network = PacketNetwork(topology, hop_limit=6)
    loop = Routes(np.array([0, 1]), np.array([2, 2]), np.array([0, 1]))
    network.set_routes(0, loop)
    offer(network, [(0, 0, 2, 5, 1, NO_LINK), (0, 0, 1, 5, 2, NO_LINK), (0, 2, 2, 5, 3, NO_LINK)])
    assert rows(network.advance(END_NS)) == [
        (2, 0, 0, NO_LINK, Outcome.NO_ROUTE),
        (3, 0, 2, NO_LINK, Outcome.DELIVERED),
        (1, 30, 0, 1, Outcome.TTL),
    ]


def test_another_component_cannot_be_reached() -> None:
    topology = Topology.from_wires(4, [(0, 0, 1, 0), (2, 0, 3, 0)], **BYTE_PER_NS)
    network = PacketNetwork(topology)
    network.set_routes(0, min_hop_routes(topology, range(4)))
    offer(network, [(0, 0, 3, 1, 7, NO_LINK)])
    assert network.advance(END_NS).outcome.tolist() == [Outcome.NO_ROUTE]
    with pytest.raises(ValueError, match="another connected component"):
        network.set_routes(END_NS, Routes(np.array([0]), np.array([3]), np.array([0])))


def test_snapshot_continues_as_the_network_itself_would() -> None:
    topology, packets, changes, hop_limit = crowded_patch(7)
    network, other = (PacketNetwork(topology, seed=5, hop_limit=hop_limit) for _ in range(2))
    schedule(network, changes)
    offer(network, packets)
    network.advance(42_000_000)
    snapshot = network.snapshot()
    rest = rows(network.advance(END_NS))
    assert network.counters.in_flight == 0
    for again in (network, other):
        again.restore(snapshot)
        assert rows(again.advance(END_NS)) == rest
        assert again.counters == network.counters


def test_random_draws_follow_the_keys_not_the_object_that_holds_the_nodes() -> None:
    # two patches in one network, and each in its own; keys say who is who
    wires = [(i, 0, i + 1, 1) for i in range(4)]
    noise = {"loss_probability": 0.2, "jitter_ns": 50}

    def network(patches: list[int]) -> PacketNetwork:
        ends = np.array([(a + 5 * k, p, b + 5 * k, q) for k in range(len(patches)) for a, p, b, q in wires])
        topology = Topology(
            5 * len(patches),
            src=ends[:, 0],
            src_port=ends[:, 1],
            dst=ends[:, 2],
            dst_port=ends[:, 3],
            **BYTE_PER_NS,
            **noise,
        )
        keys = np.array([100 * p + i for p in patches for i in range(5)], dtype=np.uint64)
        made = PacketNetwork(topology, seed=3, node_keys=keys)
        made.set_routes(0, min_hop_routes(topology, np.arange(len(patches)) * 5 + 4))
        return made

    def ends_of(made: PacketNetwork, place: int, patch_number: int) -> list[tuple[int, int, int]]:
        packets = [
            (10 * i, 5 * place, 5 * place + 4, 7, 1000 * patch_number + i, NO_LINK) for i in range(200)
        ]
        offer(made, packets)
        done = made.advance(END_NS)
        return list(zip(done.packet_id.tolist(), done.t_ns.tolist(), done.outcome.tolist(), strict=True))

    def own(ends: list[tuple[int, int, int]], patch_number: int) -> list[tuple[int, int, int]]:
        return [end for end in ends if end[0] // 1000 == patch_number]

    together = network([8, 9])
    offer(together, [(10 * i, 0, 4, 7, 8000 + i, NO_LINK) for i in range(200)])
    both = ends_of(together, 1, 9)
    alone = {number: ends_of(network([number]), 0, number) for number in (8, 9)}
    assert own(both, 8) == alone[8]
    assert own(both, 9) == alone[9]
    assert [end[1:] for end in alone[8]] != [end[1:] for end in alone[9]]


def test_loss_and_jitter_have_their_distribution() -> None:
    n, jitter_ns = 20_000, 9
    network = PacketNetwork(line(2, delay_ns=3))
    network.impair_link(0, 0, loss_probability=0.25, jitter_ns=jitter_ns)
    ids = np.arange(n)
    network.enqueue(100 * ids, ids * 0, ids * 0, ids * 0 + 1, ids, link=ids * 0)
    done = network.advance(END_NS)
    lost = np.count_nonzero(done.outcome == Outcome.LOSS)
    assert abs(lost - 0.25 * n) < 4 * np.sqrt(n * 0.25 * 0.75)
    extra_ns = done.t_ns - 100 * done.packet_id - 1 - 3
    counts = np.bincount(extra_ns, minlength=jitter_ns + 1)
    assert counts.size == jitter_ns + 1
    assert np.abs(counts - n / 10).max() < 5 * np.sqrt(n / 10)


def test_bit_errors_hit_a_packet_by_its_bits_and_a_link_independently_of_loss() -> None:
    n, rate, loss = 20_000, 1e-3, 0.25
    network = PacketNetwork(line(2))
    network.impair_link(0, 0, bit_error_rate=rate)
    network.impair_link(0, 0, loss_probability=loss)  # leaves the other as it is
    ids = np.arange(n)
    sizes = np.where(ids % 2 == 0, 8, 69)
    network.enqueue(1000 * ids, ids * 0, ids * 0, sizes, ids, link=ids * 0)
    done = network.advance(END_NS)
    for size in (8, 69):
        of_size = done.outcome[sizes[done.packet_id] == size]
        survived = of_size[of_size != Outcome.LOSS]
        hit = 1 - (1 - rate) ** (8 * size)
        spread = np.sqrt(survived.size * hit * (1 - hit))
        assert abs(np.count_nonzero(survived == Outcome.CORRUPTED) - hit * survived.size) < 4 * spread
        assert abs(survived.size - (1 - loss) * n / 2) < 4 * np.sqrt(n / 2 * loss * (1 - loss))
    assert network.link_counters.dropped[0] == np.count_nonzero(done.outcome != Outcome.DELIVERED)
    assert network.link_counters.packets[0] == n  # they all arrived, in whatever state
    with pytest.raises(ValueError, match=r"bit_error_rate is 1.5; allowed are 0 to 1"):
        network.impair_link(END_NS, 0, bit_error_rate=1.5)


def test_offers_in_any_order_and_far_ahead_enter_in_time() -> None:
    network = PacketNetwork(line(2))
    offer(network, [(50_000, 0, 0, 1, 1, NO_LINK), (400, 0, 0, 1, 2, NO_LINK)])
    offer(network, [(700, 0, 0, 1, 3, NO_LINK), (400, 0, 0, 1, 4, NO_LINK), (900, 0, 0, 1, 5, NO_LINK)])
    offer(network, [(650, 0, 0, 1, 6, NO_LINK), (3, 0, 0, 1, 7, NO_LINK), (50_000, 0, 0, 1, 8, NO_LINK)])
    assert network.next_event_ns == 3
    assert network.advance(401).packet_id.tolist() == [7, 2, 4]
    offer(network, [(660, 0, 0, 1, 9, NO_LINK)])
    assert network.advance(END_NS).packet_id.tolist() == [6, 9, 3, 5, 1, 8]


def test_records_are_used_again_and_grow_only_with_the_packets_in_flight() -> None:
    network = PacketNetwork(line(2))
    for k in range(50):
        offer(network, [(1000 * k + i, 0, 0, 1, i, NO_LINK) for i in range(100)])
        assert network.advance(1000 * (k + 1)).packet_id.tolist() == list(range(100))
    assert network.snapshot().arrays.packets.size < 2000
    offer(network, [(10**6, 0, 0, 1, i, NO_LINK) for i in range(5000)])
    assert network.counters.in_flight == 5000
    assert network.advance(END_NS).packet_id.tolist() == list(range(5000))


def test_routes_take_room_for_their_own_component_only() -> None:
    n_patches, size = 2000, 50
    first = size * np.arange(n_patches)[:, None]
    near = (first + np.arange(size - 1)).ravel()
    topology = Topology.from_wires(
        n_patches * size,
        np.stack([near, near * 0, near + 1, near * 0 + 1], axis=1),
        delay_ns=10,
        **BYTE_PER_NS,
    )
    network = PacketNetwork(topology)
    network.set_routes(0, min_hop_routes(topology, first.ravel()))
    last = first.ravel() + size - 1
    network.enqueue(last * 0, last, first.ravel(), last * 0 + 5, last)
    done = network.advance(END_NS)
    assert np.all(done.outcome == Outcome.DELIVERED)
    assert np.all(done.t_ns == (size - 1) * 15)
    assert network.snapshot().arrays.routes.size < 2 * n_patches * size


def test_fewest_hops_are_those_of_scipy_and_prefer_the_lowest_port() -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import shortest_path

    rng = np.random.default_rng(4)
    n_nodes, n_links = 30, 70
    topology = Topology(
        n_nodes,
        src=rng.integers(n_nodes, size=n_links),
        src_port=rng.permutation(n_links),
        dst=rng.integers(n_nodes, size=n_links),
        dst_port=rng.permutation(n_links),
        **BYTE_PER_NS,
    )
    dead = np.array([3, 5, 8])
    alive = np.setdiff1d(np.arange(n_links), dead)
    graph = coo_array((np.ones(alive.size), (topology.src[alive], topology.dst[alive])), (n_nodes, n_nodes))
    hops = shortest_path(graph, unweighted=True)
    routes = min_hop_routes(topology, range(n_nodes), dead_links=dead)
    reached = 0
    for node, dest, link in zip(routes.node, routes.dest, routes.link, strict=True):
        leads = alive[
            (topology.src[alive] == node) & (hops[topology.dst[alive], dest] == hops[node, dest] - 1)
        ]
        if np.isinf(hops[node, dest]):
            assert link == NO_LINK
        else:
            assert link == leads[np.argmin(topology.src_port[leads])]
            reached += 1
    assert reached > 200


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("t_ns", 4, "t_ns of packets"),
        ("node", 2, "node of packets"),
        ("dest", -1, "dest of packets"),
        ("size_bytes", 0, "size_bytes of packets"),
        ("link", 1, "does not leave its node"),
    ],
)
def test_an_offer_outside_its_range_changes_nothing(column: str, value: int, message: str) -> None:
    network = PacketNetwork(line(2))
    network.advance(5)
    packet = {"t_ns": 5, "node": 0, "dest": 1, "size_bytes": 1, "packet_id": 1, "link": NO_LINK} | {
        column: value
    }
    good = {"t_ns": 5, "node": 0, "dest": 0, "size_bytes": 1, "packet_id": 2, "link": NO_LINK}
    with pytest.raises(ValueError, match=message):
        network.enqueue(**{name: np.array([good[name], packet[name]]) for name in packet})
    assert network.counters.offered == 0
    assert network.advance(END_NS).t_ns.size == 0


def test_a_port_has_one_link_in_each_direction() -> None:
    with pytest.raises(ValueError, match="two links arrive at port 1 of node 2"):
        Topology(3, src=[0, 1], src_port=0, dst=2, dst_port=1, **BYTE_PER_NS)
    with pytest.raises(ValueError, match="delay_ns of link 1 is -1"):
        Topology(3, src=[0, 1], src_port=0, dst=2, dst_port=[0, 1], delay_ns=[0, -1], **BYTE_PER_NS)


def test_a_link_ends_at_nodes_that_exist() -> None:
    for ends in ({"src": [0, 3], "dst": 1}, {"src": [0, 0], "dst": [1, 3]}, {"src": [0, -1], "dst": 1}):
        with pytest.raises(ValueError, match=r"of link 1 is (3|-1); allowed are 0 to 2"):
            Topology(3, **ends, src_port=[0, 1], dst_port=[0, 1], **BYTE_PER_NS)


def lose_first_pending(until_ns: int, hop_limit: int, state: KernelState, scratch: KernelScratch) -> int:
    """Kernel step of a broken kernel: forgets the first packet of the first queue that has any."""
    for link in state.links:
        if link["head"] != NULL:
            link["head"] = state.packets[link["head"]]["next"]
            break
    return real_advance(until_ns, hop_limit, state, scratch)


def deliver_twice(until_ns: int, hop_limit: int, state: KernelState, scratch: KernelScratch) -> int:
    """Kernel step of a broken kernel: reports the last ended packet once more."""
    next_ns = real_advance(until_ns, hop_limit, state, scratch)
    n = int(scratch.n_ended[0])
    if n:
        scratch.ended[n] = scratch.ended[n - 1]
        state.outcome_counts[scratch.ended[n - 1]["outcome"]] += 1
        scratch.n_ended[0] = n + 1
    return next_ns


real_advance = kernel.advance


@pytest.mark.parametrize("broken_advance", [lose_first_pending, deliver_twice])
def test_counters_show_a_kernel_that_loses_or_repeats_a_packet(
    broken_advance: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    network = PacketNetwork(line(4))
    network.set_routes(0, min_hop_routes(network.topology, range(4)))
    offer(network, [(0, 0, 3, 5, i, NO_LINK) for i in range(6)])
    network.advance(22)
    assert network.counters.are_conserved
    assert 0 < network.counters.in_flight < 6
    assert sorted(network.pending_packet_id) == list(range(6 - network.counters.in_flight, 6))
    monkeypatch.setattr(kernel, "advance", broken_advance)
    network.advance(40)
    assert not network.counters.are_conserved
