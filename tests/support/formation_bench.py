"""A bench for the agents of network formation: serial links of exact times, which break and lose packets."""

import heapq
import itertools
from collections import deque
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from cells.formation.cell_agent import CellAgent
from cells.formation.gateway_agent import FormationPhase, GatewayAgent
from cells.formation.packets import FormationPacket, FormationPacketKind
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import InterfaceSpec, LatticeSpec, PatchSpec
from skinnet.protocol.messages import Topology
from skinnet.skin.placement import place_patch

SERIAL_NS, DELAY_NS, REACTION_NS, DETECT_NS = 40_000, 185_000, 50_000, 500_000
RESEND_NS = 4 * (SERIAL_NS + DELAY_NS + REACTION_NS)
SETTLE_NS = 2 * RESEND_NS
End = tuple[int, int]
Wire = tuple[int, int, int, int]
GATEWAY = -1


@dataclass
class Bench:
    """Cells and a gateway; `dead` ends carry nothing outwards, nodes that are `off` have no power."""

    n_cells: int
    wires: list[Wire]
    interfaces: list[End]
    dead: set[End] = field(default_factory=set)
    off: set[int] = field(default_factory=set)
    delay_ns: dict[End, int] = field(default_factory=dict)
    loss: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        self.cells = [CellAgent(uid, RESEND_NS) for uid in range(self.n_cells)]
        ports = max(len(self.interfaces), 1)
        self.gateway = GatewayAgent(ports, retransmission_timeout_ns=RESEND_NS, settle_ns=SETTLE_NS)
        self.far: dict[End, End] = {}
        for a, port_a, b, port_b in self.wires:
            self.far[a, port_a], self.far[b, port_b] = (b, port_b), (a, port_a)
        for port, end in enumerate(self.interfaces):
            self.far[GATEWAY, port], self.far[end] = end, (GATEWAY, port)
        self.dead, self.off = set(self.dead), set(self.off)
        self.sent: list[FormationPacket] = []
        self.most_waiting = 0
        self.t_ns = self.complete_ns = 0
        self._dice = np.random.default_rng(self.seed)
        self._busy_ns: dict[End, int] = {}
        self._life: dict[int, int] = {}
        self._broken_ns: dict[End, int] = {}
        self.heap: list[tuple[int, int, int, int, FormationPacket | bool | None, int]] = []
        self._serial = itertools.count()
        self._deadline: dict[int, int | None] = {}

    def agent(self, node: int) -> CellAgent | GatewayAgent:
        return self.gateway if node == GATEWAY else self.cells[node]

    def start(self) -> "Bench":
        for end in self.far:
            if self._has_signal(end):
                self._hear(self.far[end], True)
        self.emit(GATEWAY, self.gateway.start(self.t_ns), self.t_ns)
        return self

    def run(self, for_ns: int = 3_000_000_000) -> "Bench":
        """Until silence, or so long."""
        until_ns = self.t_ns + for_ns
        while self.heap and self.heap[0][0] <= until_ns:
            self.t_ns, node, port, _, what, sent_ns = heapq.heappop(self.heap)
            if node in self.off:
                continue
            agent = self.agent(node)
            was_complete = self.gateway.phase is FormationPhase.COMPLETE
            if what is None:
                sends = agent.on_deadline(self.t_ns)
            elif isinstance(what, bool):
                sends = agent.set_carrier(port, what, self.t_ns)
            elif sent_ns <= self._broken_ns.get(self.far[node, port], -1):
                continue  # the link broke while the packet was on it
            else:
                sends = agent.handle(what, port, self.t_ns)
            if self.gateway.phase is FormationPhase.COMPLETE and not was_complete:
                self.complete_ns = self.t_ns
            self.emit(node, sends, self.t_ns + REACTION_NS)
        return self

    def formed(self) -> "Bench":
        return self.start().run()

    def change(self, *, dead: set[End] = frozenset(), off: set[int] = frozenset()) -> None:  # type: ignore[assignment]
        """From now on these ends are dead and these cells have no power, and all others are well."""
        before = {end for end in self.far if self._is_heard(end)}
        for cell in self.off - off:
            self._life[cell] = self._life.get(cell, 0) + 1
            self.cells[cell] = CellAgent(cell, RESEND_NS, self._life[cell])
            self._deadline[cell] = None
        self.dead, self.off = set(dead), set(off)
        after = {end for end in self.far if self._is_heard(end)}
        for end in sorted(before - after):
            self._broken_ns[end] = self.t_ns
            self._busy_ns[end] = self.t_ns
        for end in sorted(before ^ after):
            node, port = self.far[end]
            self._push(self.t_ns + DETECT_NS, node, port, end in after)
        for cell in self.off:
            self._deadline[cell] = None

    def _has_signal(self, end: End) -> bool:
        return end not in self.dead and end[0] not in self.off

    def _is_heard(self, end: End) -> bool:
        return self._has_signal(end) and self.far[end][0] not in self.off

    def _hear(self, end: End, present: bool) -> None:
        node, port = end
        if node not in self.off:
            self.emit(node, self.agent(node).set_carrier(port, present, self.t_ns), self.t_ns + REACTION_NS)

    def _push(self, t_ns: int, node: int, port: int, what: FormationPacket | bool | None) -> None:
        heapq.heappush(self.heap, (t_ns, node, port, next(self._serial), what, self.t_ns))

    def emit(self, node: int, sends: list[tuple[int, FormationPacket]], t_ns: int) -> None:
        for port, packet in sends:
            end = (node, port)
            if end not in self.far:
                continue
            self.sent.append(packet)
            assert FormationPacket.from_bytes(packet.to_bytes()) == packet
            busy_ns = self._busy_ns.get(end, 0)
            self.most_waiting = max(self.most_waiting, -(-(busy_ns - t_ns) // SERIAL_NS))
            left_ns = self._busy_ns[end] = max(t_ns, busy_ns) + SERIAL_NS
            if self._has_signal(end) and not (self.loss and self._dice.random() < self.loss):
                far = self.far[end]
                self._push(left_ns + self.delay_ns.get(end, DELAY_NS), *far, packet)
        deadline_ns = self.agent(node).next_deadline()
        if deadline_ns is not None and deadline_ns != self._deadline.get(node):
            self._push(deadline_ns, node, -1, None)
        self._deadline[node] = deadline_ns

    def working(self, node: int) -> dict[int, End]:
        """Truth: far ends of a node's ports whose link works both ways."""
        ports = range(4) if node != GATEWAY else range(len(self.interfaces))
        ends = {p: self.far[node, p] for p in ports if (node, p) in self.far}
        return {p: far for p, far in ends.items() if self._has_signal((node, p)) and self._has_signal(far)}

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

    def topology(self) -> Topology:
        return self.gateway.forest.topology_message("p", 0, self.n_cells, 1, self.t_ns)


def check(bench: Bench, *, alike: bool = True) -> Topology:
    """Everything that holds once a network has settled, whatever has happened before."""
    truth = bench.distances()
    topology, ids = bench.topology(), bench.topology().network_id
    assert bench.gateway.phase is (FormationPhase.COMPLETE if truth else FormationPhase.FAILED)
    assert {cell for cell in range(bench.n_cells) if ids[cell]} == set(truth)
    assert len({ids[cell] for cell in truth}) == len(truth)
    children: dict[End, list[int]] = {}
    for cell in range(bench.n_cells):
        if cell not in truth:
            assert topology.gateway[cell] == topology.parent[cell] == topology.master_port[cell] == -1
            assert topology.neighbours[cell] == [-1] * 4
            continue
        agent = bench.cells[cell]
        assert (agent.epoch, agent.network_id) == (bench.gateway.epoch, ids[cell])
        up_node, up_port = bench.far[cell, topology.master_port[cell]]
        assert topology.parent[cell] == up_node
        assert topology.master_port[cell] == agent.master_port
        children.setdefault((up_node, up_port), []).append(cell)
        works = bench.working(cell)
        assert topology.neighbours[cell] == [works[p][0] if p in works else -1 for p in range(4)]
        if alike:
            assert topology.depth[cell] == truth[cell]
    for cell in truth:  # routes, there and back
        root = topology.gateway[cell]
        assert bench.gateway.next_port(ids[cell]) == root
        for start, dest, end in ((bench.interfaces[root][0], ids[cell], cell), (cell, 0, GATEWAY)):
            node, hops = start, 0
            while node != GATEWAY and (port := bench.cells[node].next_port(dest)) is not None:
                assert port in bench.working(node)
                node, hops = bench.far[node, port][0], hops + 1
                assert hops <= bench.n_cells
            assert node == end
            assert hops == topology.depth[cell] - (dest != 0)
    bench_children = children  # the depths are what a walk down the trees counts
    for port in range(len(bench.interfaces)):
        stack = [(cell, 1) for cell in bench_children.get((GATEWAY, port), [])]
        while stack:
            cell, depth = stack.pop()
            assert (topology.depth[cell], topology.gateway[cell]) == (depth, port)
            stack += [(c, depth + 1) for p in range(4) for c in children.get((cell, p), [])]
    return topology


def check_first(bench: Bench) -> Topology:
    """What holds besides after a first formation that nothing disturbed."""
    topology, truth = check(bench), bench.distances()
    ids = topology.network_id
    assert sorted(ids[cell] for cell in truth) == list(range(1, len(truth) + 1))
    order = sorted(truth, key=lambda cell: ids[cell])
    expected: list[int] = []
    below: dict[int, list[tuple[int, int]]] = {}
    for cell in truth:
        node, port = bench.far[cell, topology.master_port[cell]]
        below.setdefault(node, []).append((port, cell))
    stack = [cell for _, cell in sorted(below.get(GATEWAY, []), reverse=True)]
    while stack:
        cell = stack.pop()
        expected.append(cell)
        stack += [child for _, child in sorted(below.get(cell, []), reverse=True)]
    assert order == expected  # IDs are what a walk of the trees, depth first and by port, numbers
    links = [(node, p) for node in (*truth, GATEWAY) for p in bench.working(node)]
    kinds = [
        packet.kind
        for packet in bench.sent
        if packet.kind not in (FormationPacketKind.HELLO, FormationPacketKind.ACK)
    ]
    assert kinds.count(FormationPacketKind.EXPLORE) + kinds.count(FormationPacketKind.DONE) == len(links)
    assert (
        kinds.count(FormationPacketKind.DONE)
        == kinds.count(FormationPacketKind.ASSIGN)
        == kinds.count(FormationPacketKind.COLLECT)
        == len(truth)
    )
    assert kinds.count(FormationPacketKind.IDENTITY) == len(links)
    assert kinds.count(FormationPacketKind.CELL_REPORT) == sum(topology.depth)
    assert kinds.count(FormationPacketKind.NEIGHBOUR_REPORT) == 2 * sum(topology.depth)
    assert bench.gateway.links.retransmitted == sum(cell.links.retransmitted for cell in bench.cells) == 0
    return topology


@cache
def lattice(columns: int, rows: int) -> tuple[list[Wire], list[End]]:
    """Wires and free ports of a hexagonal patch."""
    free = PatchSpec(
        name="p",
        body="b",
        lattice=LatticeSpec(columns=columns, rows=rows, origin_m=(0, 0, 0), normal=(0, 0, 1), up=(0, 1, 0)),
        interfaces=(InterfaceSpec(cell=0, port=2),),
    )
    wires = [tuple(map(int, row)) for row in place_patch(free, CellSpec()).wires]
    taken = {(a, p) for a, p, _, _ in wires} | {(b, p) for _, _, b, p in wires}
    ends = [(c, p) for c in range(columns * rows) for p in range(4) if (c, p) not in taken]
    return wires, ends  # type: ignore[return-value]


def line(n: int, interfaces: list[End], **kwargs: object) -> Bench:
    """Cells in a row: port 0 to the next, port 2 to the one before."""
    return Bench(n, [(i, 0, i + 1, 2) for i in range(n - 1)], interfaces, **kwargs)  # type: ignore[arg-type]
