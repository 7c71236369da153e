import heapq
import itertools
from collections import Counter, deque
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cells.formation import CellFormation
from cells.formation_gateway import GatewayFormation, Phase
from cells.formation_packets import FormationPacket, Kind, handshake_ns, is_newer
from skinnet.deployment.schema import CellSpec, InterfaceSpec, LatticeSpec, NetworkSpec, PatchSpec
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.skin.placement import place

SERIAL_NS, DELAY_NS, REACTION_NS = 40_000, 185_000, 50_000
HANDSHAKE_NS = 4 * (SERIAL_NS + DELAY_NS + REACTION_NS)
End = tuple[int, int]
GATEWAY = -1


@dataclass
class Bench:
    """Cells and a gateway on serial links of exact times; `dead` ends carry nothing outwards."""

    n_cells: int
    wires: list[tuple[int, int, int, int]]
    interfaces: list[End]
    dead: set[End] = field(default_factory=set)
    delay_ns: dict[End, int] = field(default_factory=dict)
    lost: set[int] = field(default_factory=set)
    patience_ns: int = 10_000_000_000
    attempts: int = 1

    def __post_init__(self) -> None:
        self.cells = [CellFormation(uid, HANDSHAKE_NS) for uid in range(self.n_cells)]
        self.gateway = GatewayFormation(
            max(len(self.interfaces), 1), HANDSHAKE_NS, self.patience_ns, self.attempts
        )
        self.far: dict[End, End] = {}
        for a, port_a, b, port_b in self.wires:
            self.far[a, port_a], self.far[b, port_b] = (b, port_b), (a, port_a)
        for port, end in enumerate(self.interfaces):
            self.far[GATEWAY, port], self.far[end] = end, (GATEWAY, port)
        self.sent: list[FormationPacket] = []
        self.most_waiting = 0
        self._busy_ns: dict[End, int] = {}
        self._heap: list[tuple[int, int, int, int, FormationPacket | None]] = []
        self._serial = itertools.count()
        self._deadline: dict[int, int | None] = {}
        self.t_ns = self.complete_ns = 0

    def agent(self, node: int) -> CellFormation | GatewayFormation:
        return self.gateway if node == GATEWAY else self.cells[node]

    def _emit(self, node: int, sends: list[tuple[int, FormationPacket]], t_ns: int) -> None:
        for port, packet in sends:
            end = (node, port)
            if end not in self.far:
                continue
            self.sent.append(packet)
            busy_ns = self._busy_ns.get(end, 0)
            self.most_waiting = max(self.most_waiting, -(-(busy_ns - t_ns) // SERIAL_NS))
            left_ns = self._busy_ns[end] = max(t_ns, busy_ns) + SERIAL_NS
            if end not in self.dead and len(self.sent) not in self.lost:
                arrival_ns = left_ns + self.delay_ns.get(end, DELAY_NS)
                heapq.heappush(self._heap, (arrival_ns, *self.far[end], next(self._serial), packet))
        deadline_ns = self.agent(node).next_deadline()
        if deadline_ns is not None and deadline_ns != self._deadline.get(node):
            heapq.heappush(self._heap, (deadline_ns, node, -1, next(self._serial), None))
        self._deadline[node] = deadline_ns

    def start(self) -> None:
        self._emit(GATEWAY, self.gateway.start(self.t_ns), self.t_ns)

    def run(self, until: int | None = None) -> "Bench":
        """Until silence, or until so many packets were sent."""
        while self._heap and (until is None or len(self.sent) < until):
            self.t_ns, node, port, _, packet = heapq.heappop(self._heap)
            agent = self.agent(node)
            was_complete = self.gateway.phase is Phase.COMPLETE
            if packet is None:
                sends = agent.on_deadline(self.t_ns)
            else:
                if was_complete and packet.epoch == self.gateway.epoch:
                    # cells beyond a one-way wire may still greet each other; all others are silent
                    assert packet.kind is Kind.HELLO
                    ends = {node, self.far[node, port][0]}
                    assert self.lost or not ends <= {GATEWAY, *self.distances()}
                sends = agent.handle(packet, port, self.t_ns)
            if self.gateway.phase is Phase.COMPLETE and not was_complete:
                self.complete_ns = self.t_ns
            self._emit(node, sends, self.t_ns + REACTION_NS)
        return self

    def formed(self) -> "Bench":
        self.start()
        return self.run()

    def working(self, node: int) -> dict[int, End]:
        """Truth: far ends of a node's ports whose link works both ways."""
        ports = range(4) if node != GATEWAY else range(len(self.interfaces))
        ends = {p: self.far[node, p] for p in ports if (node, p) in self.far}
        return {p: far for p, far in ends.items() if (node, p) not in self.dead and far not in self.dead}

    def distances(self) -> dict[int, int]:
        """Truth: hops to the gateway of every cell that can be reached."""
        hops, queue = {GATEWAY: 0}, deque([GATEWAY])
        while queue:
            node = queue.popleft()
            for far, _ in self.working(node).values():
                if far not in hops:
                    hops[far] = hops[node] + 1
                    queue.append(far)
        del hops[GATEWAY]
        return hops


def check(bench: Bench, *, alike: bool = True) -> None:
    """Everything that holds once a formation is complete."""
    truth = bench.distances()
    assert bench.gateway.phase is (Phase.COMPLETE if truth else Phase.FAILED)
    assert bench.gateway.next_deadline() is None
    assert bench.gateway.n_reached == len(truth)
    topology = bench.gateway.forest().topology("p", bench.n_cells, 1, bench.t_ns)
    ids = topology.network_id
    assert {cell for cell in range(bench.n_cells) if ids[cell]} == set(truth)
    assert sorted(ids[cell] for cell in truth) == list(range(1, len(truth) + 1))
    # a cell that is cut off cannot know of the new epoch; whoever heard of it agrees with the computer
    heard = [cell for cell in bench.cells if cell.epoch == bench.gateway.epoch]
    assert {cell.uid for cell in heard} >= set(truth)
    assert all(cell.network_id == ids[cell.uid] for cell in heard)

    children: dict[End, list[int]] = {}
    for cell in range(bench.n_cells):
        if cell not in truth:
            assert topology.gateway[cell] == topology.parent[cell] == topology.master_port[cell] == -1
            assert topology.neighbours[cell] == [-1] * 4
            continue
        up_node, up_port = bench.far[cell, topology.master_port[cell]]
        assert topology.parent[cell] == up_node
        assert topology.master_port[cell] == bench.cells[cell].master_port
        children.setdefault((up_node, up_port), []).append(cell)
        works = bench.working(cell)
        expected = [works[p][0] if p in works else -1 for p in range(4)]
        assert topology.neighbours[cell] == expected
        if alike:
            assert topology.depth[cell] == truth[cell]

    # the IDs are what a recursive walk of the tree, by port, numbers; and the depths what it counts
    expected_ids: dict[int, int] = {}
    for root_port in range(len(bench.interfaces)):
        stack = [(cell, 1) for cell in children.get((GATEWAY, root_port), [])]
        while stack:
            cell, depth = stack.pop()
            expected_ids[cell] = len(expected_ids) + 1
            assert topology.depth[cell] == depth
            assert topology.gateway[cell] == root_port
            below = [c for port in range(4) for c in children.get((cell, port), [])]
            stack += [(c, depth + 1) for c in reversed(below)]
    assert expected_ids == {cell: ids[cell] for cell in truth}

    for cell in truth:  # interval routing, there and back
        for start, dest, end in (
            (bench.interfaces[topology.gateway[cell]][0], ids[cell], cell),
            (cell, 0, GATEWAY),
        ):
            node, hops = start, 0
            while node != GATEWAY and (port := bench.cells[node].next_port(dest)) is not None:
                node, hops = bench.far[node, port][0], hops + 1
            assert node == end
            assert hops == topology.depth[cell] - (dest != 0)

    one_epoch = Counter(packet.kind for packet in bench.sent if packet.epoch == bench.gateway.epoch)
    links = [(node, p) for node in (*truth, GATEWAY) for p in bench.working(node)]
    assert one_epoch[Kind.HELLO] <= 2 * len(bench.far)
    assert one_epoch[Kind.EXPLORE] + one_epoch[Kind.DONE] == len(links)
    assert one_epoch[Kind.DONE] == one_epoch[Kind.ASSIGN] == one_epoch[Kind.COLLECT] == len(truth)
    assert one_epoch[Kind.IDENTITY] == len(links)
    assert one_epoch[Kind.UNIT] == sum(topology.depth)
    assert one_epoch[Kind.LINKS] == 2 * sum(topology.depth)
    for packet in set(bench.sent):
        assert FormationPacket.from_bytes(packet.to_bytes()) == packet


@cache
def lattice(columns: int, rows: int) -> tuple[list[tuple[int, int, int, int]], list[End]]:
    """Wires and free ports of a hexagonal patch."""
    free = PatchSpec(
        name="p",
        body="b",
        lattice=LatticeSpec(columns=columns, rows=rows, origin_m=(0, 0, 0), normal=(0, 0, 1), up=(0, 1, 0)),
        interfaces=(InterfaceSpec(cell=0, port=2),),
    )
    wires = [tuple(map(int, row)) for row in place(free, CellSpec()).wires]
    taken = {(a, p) for a, p, _, _ in wires} | {(b, p) for _, _, b, p in wires}
    ends = [(c, p) for c in range(columns * rows) for p in range(4) if (c, p) not in taken]
    return wires, ends  # type: ignore[return-value]


@st.composite
def patches(draw: st.DrawFn) -> Bench:
    """A hexagonal patch with cut wires, wires broken in one direction, and one to five interfaces."""
    columns, rows = draw(st.integers(1, 7)), draw(st.integers(1, 6))
    wires, free = lattice(columns, rows)
    interfaces = draw(st.lists(st.sampled_from(free), min_size=1, max_size=5, unique=True))
    ends = [end for a, p, b, q in wires for end in ((a, p), (b, q))] + interfaces
    ends += [(GATEWAY, port) for port in range(len(interfaces))]
    share = draw(st.sampled_from([0.0, 0.1, 0.3]))
    dice = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    dead = {end for end in ends if dice.random() < share}
    return Bench(columns * rows, wires, interfaces, dead)


@given(patches())
def test_every_reachable_cell_is_found_numbered_and_routed(bench: Bench) -> None:
    check(bench.formed())


@given(patches(), st.integers(0, 2**32 - 1))
def test_forms_whatever_the_delays_of_its_links(bench: Bench, seed: int) -> None:
    dice = np.random.default_rng(seed)
    bench.delay_ns = {end: int(dice.integers(1, DELAY_NS)) for end in bench.far}
    check(bench.formed(), alike=False)


@given(patches(), st.floats(0.0, 1.0), st.data())
def test_a_new_epoch_forms_again_round_broken_links(bench: Bench, share: float, data: st.DataObject) -> None:
    total = len(Bench(bench.n_cells, bench.wires, bench.interfaces, bench.dead).formed().sent)
    bench.start()
    bench.run(until=int(share * total))
    bench.dead |= set(data.draw(st.lists(st.sampled_from(sorted(bench.far)), max_size=3)))
    bench.start()  # in the middle, with packets of the old epoch still on their way
    check(bench.run())


@given(patches(), st.floats(0.0, 1.0))
def test_a_lost_packet_costs_another_epoch_at_most(bench: Bench, share: float) -> None:
    total = len(Bench(bench.n_cells, bench.wires, bench.interfaces, bench.dead).formed().sent)
    lost = {1 + int(share * (total - 1))}
    bench = replace(bench, lost=lost, attempts=2, patience_ns=10**9).formed()
    assert bench.gateway.phase is (Phase.COMPLETE if bench.distances() else Phase.FAILED)
    reached = {
        cell
        for cell, agent in enumerate(bench.cells)
        if agent.epoch == bench.gateway.epoch and agent.network_id
    }
    assert bench.gateway.n_reached == len(reached)
    if bench.gateway.epoch > 1:
        check(bench)


def line(n: int, interfaces: list[End], **kwargs: object) -> Bench:
    return Bench(n, [(i, 0, i + 1, 2) for i in range(n - 1)], interfaces, **kwargs)  # type: ignore[arg-type]


@pytest.mark.parametrize("slow_ns", [DELAY_NS, 600_000])
def test_a_lost_hello_costs_no_epoch(slow_ns: int) -> None:
    wires = [(i, 0, (i + 1) % 5, 2) for i in range(5)]
    ring = Bench(5, wires, [(0, 1), (1, 1)], delay_ns={(GATEWAY, 1): slow_ns}, attempts=2)
    greetings = [i for i, packet in enumerate(replace(ring).formed().sent, 1) if packet.kind is Kind.HELLO]
    for lost in greetings:
        bench = replace(ring, lost={lost}).formed()
        assert (bench.gateway.phase, bench.gateway.epoch) == (Phase.COMPLETE, 1)
        assert bench.gateway.n_reached == 5


def test_a_token_waits_until_the_links_are_known_and_a_due_deadline_comes_first() -> None:
    cell = CellFormation(0, HANDSHAKE_NS)
    token = FormationPacket(Kind.EXPLORE, 1)
    greetings = cell.handle(FormationPacket(Kind.HELLO, 1), 2, t_ns=10)
    assert [(port, packet.value) for port, packet in greetings] == [(0, 0), (1, 0), (2, 1), (3, 0)]
    assert cell.handle(token, 2, t_ns=20) == []
    cell.handle(FormationPacket(Kind.HELLO, 1, value=1), 0, t_ns=30)
    assert cell.next_deadline() == 10 + HANDSHAKE_NS
    assert cell.on_deadline(10 + HANDSHAKE_NS - 1) == []
    crossing = cell.handle(token, 0, t_ns=10 + HANDSHAKE_NS)
    assert crossing == [(0, token), (2, FormationPacket(Kind.DONE, 1, value=1))]
    assert (cell.master_port, cell.next_deadline()) == (2, None)


def test_complete_only_when_the_slowest_port_has_told_who_is_there() -> None:
    check(line(1, [(0, 1), (0, 2)], delay_ns={(0, 2): 2 * DELAY_NS}).formed())


def test_gives_up_after_its_attempts_and_can_start_again() -> None:
    bench = line(3, [(0, 2)], attempts=2, patience_ns=10**9)
    bench.lost = set(range(20, 10_000))
    bench.formed()
    assert bench.gateway.phase is Phase.FAILED
    assert bench.gateway.epoch == 2
    assert bench.gateway.next_deadline() is None
    bench.lost = set()
    bench.start()
    check(bench.run())


def test_trees_of_several_ports_meet_in_the_middle_and_continue_the_numbering() -> None:
    bench = line(6, [(0, 2), (5, 0)])
    check(bench.formed())
    topology = bench.gateway.forest().topology("p", 6, 1, 0)
    assert topology.gateway == [0, 0, 0, 1, 1, 1]
    assert topology.network_id == [1, 2, 3, 6, 5, 4]
    assert topology.depth == [1, 2, 3, 3, 2, 1]


def test_a_ring_is_cut_where_its_tokens_meet() -> None:
    ring = [(i, 0, (i + 1) % 7, 2) for i in range(7)]
    bench = Bench(7, ring, [(0, 1)])
    check(bench.formed())
    topology = bench.gateway.forest().topology("p", 7, 1, 0)
    assert topology.parent == [-1, 0, 1, 2, 5, 6, 0]
    assert topology.neighbours[3] == [4, -1, 2, -1]


def test_of_two_tokens_at_one_instant_the_lower_port_wins() -> None:
    bench = Bench(6, [(i, 0, (i + 1) % 6, 2) for i in range(6)], [(0, 1)])
    check(bench.formed())
    topology = bench.gateway.forest().topology("p", 6, 1, 0)
    assert (topology.master_port[3], topology.parent[3]) == (0, 4)


def test_two_interfaces_on_one_cell_make_one_tree() -> None:
    bench = line(4, [(0, 1), (0, 2)])
    check(bench.formed())
    assert bench.gateway.forest().topology("p", 4, 1, 0).gateway == [0, 0, 0, 0]


@pytest.mark.parametrize("broken", [(1, 0), (2, 2)])
def test_a_wire_broken_in_one_direction_is_no_link(broken: End) -> None:
    bench = line(4, [(0, 2)], dead={broken})
    check(bench.formed())
    topology = bench.gateway.forest().topology("p", 4, 7, 0)
    assert topology.network_id == [1, 2, 0, 0]
    assert topology.depth == [1, 2, 0, 0]
    assert topology.neighbours[1] == [-1, -1, 0, -1]


def test_a_gateway_that_nobody_answers_fails_and_reaches_no_cell() -> None:
    bench = line(2, [(0, 2)], dead={(GATEWAY, 0)})
    check(bench.formed())
    assert bench.gateway.phase is Phase.FAILED
    assert bench.gateway.forest().topology("p", 2, 1, 0).network_id == [0, 0]


def test_epochs_count_round() -> None:
    bench = line(2, [(0, 2)])
    for _ in range(300):
        bench.sent.clear()
        check(bench.formed())
    assert bench.gateway.epoch == 300 % 256
    assert is_newer(3, 250)
    assert not is_newer(250, 3)
    assert not is_newer(7, 7)


def test_the_largest_published_skin_forms_with_short_queues() -> None:
    wires, free = lattice(36, 35)
    interfaces = [next(end for end in free if end[0] == corner) for corner in (0, 35, 1224, 1259)]
    bench = Bench(1260, wires, interfaces).formed()
    check(bench)
    # COLLECT lets one cell report at a time: a queue of 16 never overflows
    assert bench.most_waiting <= 4
    # and a cell's turn takes the time of three hops, as reports stream while COLLECT goes on
    assert bench.complete_ns < 1260 * 3 * (SERIAL_NS + DELAY_NS + REACTION_NS)


def test_the_handshake_waits_for_answers_behind_full_queues() -> None:
    network = NetworkSpec(queue_packets=3, hop_delay_us=100.0, jitter_us=10.0)
    trip_ns = (3 + 2) * 115_000 + 110_000 + 50_000
    assert handshake_ns(network, 50_000) == 3 * trip_ns


def test_packets_refuse_what_is_none_of_theirs() -> None:
    for payload in (b"", bytes(7), bytes([15]) + bytes(7), bytes(7) + b"\xff"):
        with pytest.raises(ProtocolError, match="no packet of network formation"):
            FormationPacket.from_bytes(payload)


OUT_OF_TURN = (Kind.DONE, Kind.ASSIGN, Kind.COLLECT, Kind.UNIT, Kind.LINKS)


def test_packets_out_of_turn_or_of_another_epoch_change_nothing() -> None:
    bench = line(3, [(0, 2)]).formed()
    cell, before = bench.cells[1], bench.gateway.forest()
    strangers = [FormationPacket(kind, 1, cell=9, value=5) for kind in OUT_OF_TURN]
    strangers += [FormationPacket(kind, 0, cell=9, value=5) for kind in Kind]
    for packet in strangers:
        assert cell.handle(packet, 3, bench.t_ns) == []
        assert bench.gateway.handle(packet, 0, bench.t_ns) == []
    assert cell.ignored == bench.gateway.ignored == len(strangers)
    assert (cell.network_id, cell.next_port(3), cell.next_port(0)) == (2, 0, 2)
    assert bench.gateway.forest() == before


def test_a_gateway_has_as_many_ports_as_its_packets_can_name() -> None:
    with pytest.raises(DeploymentError, match="1 to 16"):
        GatewayFormation(17, HANDSHAKE_NS)


def test_more_cells_than_ids_are_refused() -> None:
    gateway = GatewayFormation(1, HANDSHAKE_NS)
    gateway.start(0)
    gateway.handle(FormationPacket(Kind.HELLO, 1, value=1), 0, 1)
    gateway.on_deadline(HANDSHAKE_NS)
    with pytest.raises(DeploymentError, match="16384 cells"):
        gateway.handle(FormationPacket(Kind.DONE, 1, value=2**14), 0, HANDSHAKE_NS + 1)


def test_hardware_numbers_must_be_those_of_the_patch() -> None:
    forest = line(3, [(0, 2)]).formed().gateway.forest()
    with pytest.raises(ProtocolError, match="hardware numbers"):
        forest.topology("p", 2, 1, 0)
