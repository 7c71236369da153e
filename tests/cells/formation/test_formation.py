import numpy as np
import pytest
from formation_bench import (
    DELAY_NS,
    DETECT_NS,
    GATEWAY,
    REACTION_NS,
    RESEND_NS,
    SERIAL_NS,
    SETTLE_NS,
    Bench,
    End,
    check,
    check_first,
    lattice,
    line,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from cells.formation.cell_agent import CellAgent
from cells.formation.gateway_agent import FormationPhase, GatewayAgent
from cells.formation.packets import FormationPacket, FormationPacketKind, is_newer, max_round_trip_ns
from skinnet.deployment.network import NetworkSpec
from skinnet.errors import DeploymentError, ProtocolError


@st.composite
def patches(draw: st.DrawFn, share: float | None = None) -> Bench:
    """A hexagonal patch with cut wires, wires broken in one direction, and one to five interfaces."""
    columns, rows = draw(st.integers(1, 7)), draw(st.integers(1, 6))
    wires, free = lattice(columns, rows)
    interfaces = draw(st.lists(st.sampled_from(free), min_size=1, max_size=5, unique=True))
    bench = Bench(columns * rows, wires, interfaces)
    share = draw(st.sampled_from([0.0, 0.1, 0.3])) if share is None else share
    dice = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    bench.dead = {end for end in sorted(bench.far) if dice.random() < share}
    return bench


@given(patches())
def test_every_reachable_cell_is_found_numbered_and_routed(bench: Bench) -> None:
    check_first(bench.formed())


@settings(max_examples=50)
@given(patches(), st.integers(0, 2**32 - 1))
def test_forms_whatever_the_delays_of_its_links(bench: Bench, seed: int) -> None:
    dice = np.random.default_rng(seed)
    bench.delay_ns = {end: int(dice.integers(1, DELAY_NS)) for end in bench.far}
    check(bench.formed(), alike=False)


@settings(max_examples=50)
@given(patches(), st.sampled_from([0.01, 0.1, 0.25]), st.integers(0, 2**32 - 1))
def test_forms_although_packets_are_lost(bench: Bench, loss: float, seed: int) -> None:
    bench.loss, bench.seed = loss, seed
    bench.__post_init__()
    bench.start().run(20_000_000_000)
    bench.loss = 0.0
    check(bench.run(), alike=False)


@st.composite
def lives(draw: st.DrawFn) -> tuple[Bench, list[tuple[int, set[End], set[int]]]]:
    """A patch, and what is dead and off from which moment on."""
    bench = draw(patches(share=0.0))
    ends = st.lists(st.sampled_from(sorted(bench.far)), max_size=4).map(set)
    cells = st.lists(st.integers(0, bench.n_cells - 1), max_size=3).map(set)
    wait = st.integers(0, 60_000_000)
    return bench, draw(st.lists(st.tuples(wait, ends, cells), min_size=1, max_size=4))


@settings(max_examples=150)
@given(lives())
def test_whatever_breaks_and_returns_the_network_is_right_in_the_end(
    life: tuple[Bench, list[tuple[int, set[End], set[int]]]],
) -> None:
    """Links and cells go and come, also in the middle of a formation: every cell with a path is back."""
    bench, changes = life
    bench.start()
    for wait_ns, dead, off in changes:
        bench.run(wait_ns)
        bench.change(dead=dead, off=off)
    check(bench.run(), alike=False)
    bench.change()
    check(bench.run(), alike=False)


@settings(max_examples=30)
@given(lives(), st.integers(0, 2**32 - 1))
def test_also_while_packets_are_lost(
    life: tuple[Bench, list[tuple[int, set[End], set[int]]]], seed: int
) -> None:
    bench, changes = life
    bench.loss, bench.seed = 0.1, seed
    bench.__post_init__()
    bench.start()
    for wait_ns, dead, off in changes:
        bench.run(wait_ns)
        bench.change(dead=dead, off=off)
    bench.run()
    bench.loss = 0.0
    check(bench.run(), alike=False)


@settings(max_examples=30)
@given(lives())
def test_cells_keep_their_ids(life: tuple[Bench, list[tuple[int, set[End], set[int]]]]) -> None:
    bench, changes = life
    before = check_first(bench.formed()).network_id
    for _, dead, off in changes:
        bench.change(dead=dead, off=off)
        after = check(bench.run(), alike=False).network_id
        assert all(new in (0, old) for old, new in zip(before, after, strict=True))
    bench.change()
    assert check(bench.run(), alike=False).network_id == before


def test_an_id_of_an_earlier_formation_is_void() -> None:
    """Behind a cut a cell keeps its ID while all others get new ones."""
    bench = Bench(4, [(0, 0, 1, 2), (0, 1, 2, 3), (2, 0, 3, 2)], [(0, 2)])
    assert check_first(bench.formed()).network_id == [1, 2, 3, 4]
    bench.change(dead={(0, 0), (1, 2)})
    bench.run()
    bench.emit(GATEWAY, bench.gateway.start(bench.t_ns), bench.t_ns)
    assert check(bench.run()).network_id == [1, 0, 2, 3]
    bench.change()
    assert check(bench.run()).network_id == [1, 4, 2, 3]


@settings(max_examples=30)
@given(lives())
def test_what_is_known_has_a_version_of_its_own(
    life: tuple[Bench, list[tuple[int, set[End], set[int]]]],
) -> None:
    """Whoever follows the versions misses nothing that a settled gateway learns."""
    bench, changes = life
    bench.start()
    known: dict[int, object] = {}
    for _, dead, off in [*changes, (0, set(), set())]:
        until_ns = bench.t_ns + 100_000_000
        while bench.heap and bench.heap[0][0] < until_ns:
            bench.run(max(bench.heap[0][0] - bench.t_ns, 300_000))
            if bench.gateway.phase in (FormationPhase.COMPLETE, FormationPhase.FAILED):
                now = bench.topology()
                told = (now.network_id, now.parent, now.depth, now.gateway, now.neighbours)
                assert known.setdefault(bench.gateway.version, told) == told
        bench.change(dead=dead, off=off)


def test_a_cell_that_is_added_gets_the_next_id_and_its_neighbours_are_told() -> None:
    bench = line(4, [(0, 2)], off={1, 2, 3})
    assert check_first(bench.formed()).network_id == [1, 0, 0, 0]
    bench.change(off={2, 3})
    assert check(bench.run()).network_id == [1, 2, 0, 0]
    bench.change()  # two at once: the second asks through the first, which has no ID itself yet
    assert check(bench.run()).network_id == [1, 2, 3, 4]


def test_a_cell_lives_with_one_port() -> None:
    """Of the middle of three by three cells, all links are cut but one, each in turn."""
    wires, _ = lattice(3, 3)
    bench = Bench(9, wires, [(0, 2)])
    bench.formed()
    for port in bench.working(4):
        ends = {(4, other) for other in range(4) if other != port and (4, other) in bench.far}
        bench.change(dead=ends | {bench.far[end] for end in ends})
        topology = check(bench.run())
        assert topology.master_port[4] == port


def test_back_within_a_few_hops() -> None:
    """A cut in the middle of ten by ten cells: detection, a token down, an answer up."""
    wires, _ = lattice(10, 10)
    bench = Bench(100, wires, [(0, 2)])
    check_first(bench.formed())
    cut_ns = bench.t_ns
    ends = {end for wire in wires if 44 in (wire[0], wire[2]) for end in (wire[:2], wire[2:])}
    bench.change(dead=ends)
    bench.run()
    topology = check(bench)
    assert topology.network_id[44] == 0
    hop_ns = SERIAL_NS + DELAY_NS + REACTION_NS
    joined_ns = max(cell.joined_ns or 0 for cell in bench.cells if cell.uid != 44) - cut_ns
    assert joined_ns <= DETECT_NS + (10 + max(topology.depth)) * (hop_ns + 4 * SERIAL_NS)
    assert bench.complete_ns - cut_ns < 50_000_000


def test_a_gateway_that_loses_its_only_port_knows_and_comes_back() -> None:
    bench = line(3, [(0, 2)])
    before = check_first(bench.formed()).network_id
    version = bench.gateway.version
    bench.change(dead={(0, 2), (GATEWAY, 0)})
    check(bench.run())
    assert (bench.gateway.phase, bench.gateway.version) == (FormationPhase.FAILED, version + 1)
    bench.change()
    assert check(bench.run()).network_id == before


def test_the_other_gateway_takes_over() -> None:
    bench = line(6, [(0, 2), (5, 0)])
    check_first(bench.formed())
    bench.change(dead={(0, 2), (GATEWAY, 0)})
    topology = check(bench.run())
    assert topology.gateway == [1] * 6
    assert topology.depth == [6, 5, 4, 3, 2, 1]


def test_trees_of_several_ports_meet_in_the_middle_and_continue_the_numbering() -> None:
    topology = check_first(line(6, [(0, 2), (5, 0)]).formed())
    assert topology.gateway == [0, 0, 0, 1, 1, 1]
    assert topology.network_id == [1, 2, 3, 6, 5, 4]
    assert topology.depth == [1, 2, 3, 3, 2, 1]


def test_a_ring_is_cut_where_its_tokens_meet() -> None:
    ring = [(i, 0, (i + 1) % 7, 2) for i in range(7)]
    topology = check_first(Bench(7, ring, [(0, 1)]).formed())
    assert topology.parent == [-1, 0, 1, 2, 5, 6, 0]
    assert topology.neighbours[3] == [4, -1, 2, -1]


def test_of_two_tokens_at_one_instant_the_lower_port_wins() -> None:
    bench = Bench(6, [(i, 0, (i + 1) % 6, 2) for i in range(6)], [(0, 1)])
    topology = check_first(bench.formed())
    assert (topology.master_port[3], topology.parent[3]) == (0, 4)


def test_two_interfaces_on_one_cell_make_one_tree() -> None:
    assert check_first(line(4, [(0, 1), (0, 2)]).formed()).gateway == [0, 0, 0, 0]


@pytest.mark.parametrize("broken", [(1, 0), (2, 2)])
def test_a_wire_broken_in_one_direction_is_no_link(broken: End) -> None:
    topology = check_first(line(4, [(0, 2)], dead={broken}).formed())
    assert topology.network_id == [1, 2, 0, 0]
    assert topology.depth == [1, 2, 0, 0]
    assert topology.neighbours[1] == [-1, -1, 0, -1]


def test_a_gateway_that_nobody_answers_fails_and_reaches_no_cell() -> None:
    bench = line(2, [(0, 2)], dead={(GATEWAY, 0)}).formed()
    check(bench)
    assert (bench.gateway.phase, bench.gateway.version) == (FormationPhase.FAILED, 1)


def test_epochs_count_round() -> None:
    bench = line(2, [(0, 2)]).formed()
    for i in range(4200):
        bench.change(dead={(1, 2)} if i % 2 else set())
        bench.run(20_000_000)
    bench.change()
    check(bench.run())
    assert bench.gateway.epoch < 4096
    assert is_newer(3, 4090)
    assert not is_newer(4090, 3)
    assert not is_newer(7, 7)


def test_the_largest_published_skin_forms_with_short_queues() -> None:
    wires, free = lattice(36, 35)
    interfaces = [next(end for end in free if end[0] == corner) for corner in (0, 35, 1224, 1259)]
    bench = Bench(1260, wires, interfaces).formed()
    check_first(bench)
    # COLLECT lets one cell report at a time, and a window bounds what waits: no queue of 16 overflows
    assert bench.most_waiting <= 8
    # a cell's turn takes the time of a few hops, as reports stream while COLLECT goes on
    assert bench.complete_ns < 1260 * 5 * (SERIAL_NS + DELAY_NS + REACTION_NS)


def test_a_round_trip_waits_behind_full_queues() -> None:
    network = NetworkSpec(queue_packets=3, hop_delay_us=100.0, jitter_us=10.0)
    assert max_round_trip_ns(network, 50_000) == 2 * ((3 + 2) * 115_000 + 110_000 + 50_000)


def test_packets_refuse_what_is_none_of_theirs() -> None:
    for payload in (b"", bytes(7), bytes(9), bytes([15]) + bytes(7)):
        with pytest.raises(ProtocolError, match="not a formation packet"):
            FormationPacket.from_bytes(payload)


packets = st.builds(
    FormationPacket,
    st.sampled_from(FormationPacketKind),
    st.integers(0, 2**12 - 1),
    st.integers(0, 2**14 - 1),
    st.integers(0, 15),
    st.integers(0, 2**28 - 1),
    st.integers(0, 3),
)


@given(packets)
def test_packets_have_64_bits(packet: FormationPacket) -> None:
    assert FormationPacket.from_bytes(packet.to_bytes()) == packet


@settings(max_examples=50)
@given(st.lists(st.tuples(st.sampled_from([-1, 0, 1, 2]), st.integers(0, 1), packets), max_size=30))
def test_no_packet_brings_an_agent_down(strangers: list[tuple[int, int, FormationPacket]]) -> None:
    """Nonsense from a broken neighbour is no exception."""
    bench = line(3, [(0, 2)]).formed()
    for node, port, packet in strangers:
        ports = sorted(p for n, p in bench.far if n == node)
        agent = bench.agent(node)
        bench.emit(node, agent.handle(packet, ports[port % len(ports)], bench.t_ns), bench.t_ns)
    bench.run()


def test_a_gateway_has_as_many_ports_as_its_packets_can_name() -> None:
    with pytest.raises(DeploymentError, match="1 to 16"):
        GatewayAgent(17, retransmission_timeout_ns=RESEND_NS, settle_ns=SETTLE_NS)


def test_a_fresh_cell_says_nothing_on_a_port_without_signal() -> None:
    cell = CellAgent(0, RESEND_NS)
    assert cell.next_deadline() is None
    sends = cell.set_carrier(2, True, 0)
    assert [(port, packet.kind) for port, packet in sends] == [(2, FormationPacketKind.HELLO)]
    assert cell.next_deadline() == RESEND_NS
