"""One link between two nodes that loses packets, is cut and loses power: what its ends believe and hear."""

import heapq
import itertools
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from small_robot import patch
from streaming_skin import FAST, Streaming

from cells.formation.link_layer import LinkLayer
from cells.formation.packets import FormationPacket, FormationPacketKind

SERIAL_NS, DETECT_NS, REACTION_NS, LONGEST_NS = 40_000, 500_000, 50_000, 185_000
RESEND_NS = 4 * (SERIAL_NS + LONGEST_NS + REACTION_NS)
TRIES = 8
"""Repetitions before a link is given up."""
LINK = 0


@dataclass
class _Session:
    """From the moment when an end holds its link for up until it does no longer."""

    sent: list[int] = field(default_factory=list)
    received: list[int] = field(default_factory=list)


class Line:
    """Two ends of one serial line of random delays. Direction d leads from end d to the other.

    Attributes:
        sessions: Of each end, all so far.
        on_line: Every packet that was put on the line: (when, end, packet).
        most_waiting: Packets that an end had sent in a session and the other had not yet got.
        turns: When an end came to hold the link for up, or no longer: (when, end, is up).
    """

    def __init__(self, loss: float = 0.0, seed: int = 0) -> None:
        self.ends = [LinkLayer(1, RESEND_NS) for _ in range(2)]
        self.sessions: list[list[_Session]] = [[], []]
        self.on_line: list[tuple[int, int, FormationPacket]] = []
        self.turns: list[tuple[int, int, bool]] = []
        self.loss = loss
        self.most_waiting = [0, 0]
        self.t_ns = 0
        self._carries = [True, True]
        self._hears = [False, False]
        self._power = [True, True]
        self.lives = [0, 0]
        self._free_ns, self._arrived_ns, self._broken_ns = [0, 0], [0, 0], [-1, -1]
        self._heap: list[tuple[int, int, int, FormationPacket | bool | None, str]] = []
        self._serial, self._numbers = itertools.count(), itertools.count()
        self._dice = np.random.default_rng(seed)
        for end in (0, 1):
            self._push(0, end, True, "carrier")

    def is_up(self) -> list[bool]:
        return [end.is_up(LINK) for end in self.ends]

    def send(self, end: int, packets: int = 1) -> None:
        """An end that has its link sends numbered packets."""
        for _ in range(packets):
            if self._power[end] and self.ends[end].is_up(LINK):
                number = next(self._numbers)
                self.sessions[end][-1].sent.append(number)
                self.ends[end].send(
                    LINK, FormationPacket(FormationPacketKind.CELL_REPORT, value=number), self.t_ns
                )
                self.after(end)

    def set(self, carries: tuple[bool, bool], power: tuple[bool, bool] = (True, True)) -> None:
        """From now on these directions are whole, and these ends have power; one that gets it begins anew."""
        before = [self._has_signal(d) for d in (0, 1)]
        for end in (0, 1):
            if power[end] and not self._power[end]:
                self.lives[end] += 1
                self._hears[end] = False
                self.ends[end] = LinkLayer(1, RESEND_NS, self.lives[end])
        self._carries, self._power = list(carries), list(power)
        for d in (0, 1):
            if before[d] and not self._has_signal(d):
                self._broken_ns[d] = self.t_ns
            if before[d] != self._has_signal(d):
                self._push(self.t_ns + DETECT_NS, 1 - d, not before[d], "carrier")

    def run(self, for_ns: int = 3_000_000_000) -> "Line":
        """Lets time pass, by default enough for everything to end."""
        until_ns = self.t_ns + for_ns
        while self._heap and self._heap[0][0] <= until_ns:
            self.t_ns, _, end, what, how = heapq.heappop(self._heap)
            if not self._power[end]:
                continue
            node = self.ends[end]
            if how == "enters":
                assert isinstance(what, FormationPacket)
                self._transmit(end, what)
                continue
            if how == "carrier":
                self._hears[end] = bool(what)
                node.set_carrier(LINK, bool(what), self.t_ns)
            elif how == "deadline":
                if node.next_deadline() == self.t_ns:
                    node.on_deadline(self.t_ns)
            elif int(how) > self._broken_ns[1 - end]:  # else the line broke while the packet was on it
                assert isinstance(what, FormationPacket)
                new = node.receive(LINK, what, self.t_ns)
                if new is not None:
                    self.sessions[end][-1].received.append(new.value)
            self.after(end)
        self.t_ns = until_ns
        return self

    def _has_signal(self, direction: int) -> bool:
        return self._carries[direction] and all(self._power)

    def after(self, end: int) -> None:
        node = self.ends[end]
        assert self._hears[end] or not node.is_up(LINK)
        for _, is_up in node.link_changes:
            if is_up:
                self.sessions[end].append(_Session())
            self.turns.append((self.t_ns, end, is_up))
        node.link_changes.clear()
        for _, packet in node.outgoing:
            self._push(self.t_ns + REACTION_NS, end, packet, "enters")
        node.outgoing.clear()
        deadline_ns = node.next_deadline()
        if deadline_ns is not None:
            self._push(deadline_ns, end, None, "deadline")

    def _transmit(self, end: int, packet: FormationPacket) -> None:
        self.on_line.append((self.t_ns, end, packet))
        self._note_waiting(end, packet)
        self._free_ns[end] = left_ns = max(self.t_ns, self._free_ns[end]) + SERIAL_NS
        if self._has_signal(end) and self._dice.random() >= self.loss:
            delay_ns = int(self._dice.integers(1, LONGEST_NS))
            self._arrived_ns[end] = at_ns = max(self._arrived_ns[end], left_ns + delay_ns)
            self._push(at_ns, 1 - end, packet, str(self.t_ns))

    def _note_waiting(self, end: int, packet: FormationPacket) -> None:
        if packet.kind is FormationPacketKind.CELL_REPORT and packet.value in (
            sent := self.sessions[end][-1].sent
        ):
            got = next((s.received for s in self.sessions[1 - end] if s.received[:1] == sent[:1]), [])
            waiting = sent.index(packet.value) + 1 - len(got)
            self.most_waiting[end] = max(self.most_waiting[end], waiting)

    def _push(self, t_ns: int, end: int, what: FormationPacket | bool | None, how: str) -> None:
        heapq.heappush(self._heap, (t_ns, next(self._serial), end, what, how))

    def check(self) -> None:
        """A session hears the beginning of one session of the far end, in order, and of no other."""
        for end in (0, 1):
            heard = [session.received for session in self.sessions[1 - end] if session.received]
            told = iter(self.sessions[end])
            for received in heard:
                sent = next((session.sent for session in told if received[0] in session.sent), [])
                assert received == sent[: len(received)]

    def check_agreed(self) -> None:
        """At rest over a whole line: both ends are up, and have what was sent since."""
        self.check()
        assert self.is_up() == [True, True]
        for end in (0, 1):
            assert self.sessions[1 - end][-1].received == self.sessions[end][-1].sent
        assert [node.next_deadline() for node in self.ends] == [None, None]


Life = list[tuple[int, tuple[str, Any, Any]]]
both = st.tuples(st.booleans(), st.booleans())
sends = st.tuples(st.just("send"), st.integers(0, 1), st.integers(1, 9))
waits = st.one_of(st.integers(0, 3_000_000), st.integers(0, 50_000_000))
lives = st.lists(st.tuples(waits, st.one_of(sends, st.tuples(st.just("set"), both, both))), max_size=20)
losses = st.sampled_from([0.0, 0.05, 0.3, 0.6])
seeds = st.integers(0, 2**32 - 1)


def lived(life: Life, loss: float, seed: int) -> Line:
    line = Line(loss, seed)
    for wait_ns, (what, first, second) in life:
        line.run(wait_ns)
        if what == "send":
            line.send(first, second)
        else:
            line.set(first, second)
        line.check()
    return line


def ask(line: Line) -> Line:
    """Whoever believes in a link finds out by using it."""
    line.loss = 0.0
    line.run()
    for end in (0, 1):
        line.send(end, 7)
    return line.run()


@settings(max_examples=300)
@given(lives, losses, seeds)
def test_whatever_happens_packets_arrive_once_in_order_and_in_their_session(
    life: Life, loss: float, seed: int
) -> None:
    line = lived(life, loss, seed)
    line.set((True, True))
    ask(line).check_agreed()


@settings(max_examples=100)
@given(lives, losses, seeds, st.integers(0, 1))
def test_a_link_that_is_broken_in_one_direction_is_up_at_neither_end(
    life: Life, loss: float, seed: int, broken: int
) -> None:
    line = lived(life, loss, seed)
    line.set((broken != 0, broken != 1))
    assert ask(line).is_up() == [False, False]


@settings(max_examples=50)
@given(losses.filter(lambda loss: loss < 0.5), seeds)
def test_over_a_link_that_stays_up_all_arrive_and_three_wait_at_most(loss: float, seed: int) -> None:
    line = Line(loss, seed)
    line.run()
    for _ in range(10):
        for end in (0, 1):
            line.send(end, 6)
        line.run(20_000_000)
    line.run()
    line.check()
    assert loss > 0.05 or len(line.turns) == 2
    if len(line.turns) == 2:
        line.check_agreed()
        assert all(len(sessions[-1].received) == 60 for sessions in line.sessions)
    for end in (0, 1):
        assert line.most_waiting[end] == 3
    assert loss > 0.0 or line.ends[0].retransmitted == line.ends[1].retransmitted == 0


def test_a_link_that_is_whole_comes_up_with_three_greetings_of_each_end_and_is_silent_then() -> None:
    line = Line().run()
    assert [(end, is_up) for _, end, is_up in line.turns] in ([(0, True), (1, True)], [(1, True), (0, True)])
    assert len(line.on_line) <= 6
    line.check_agreed()
    before = len(line.on_line)
    line.run()
    assert len(line.on_line) == before
    line.send(0, 5)
    line.run()
    assert [(end, packet.kind) for _, end, packet in line.on_line[before:]].count(
        (0, FormationPacketKind.CELL_REPORT)
    ) == 5
    assert len(line.on_line) == before + 10  # each is acknowledged once, and nothing is repeated
    assert [node.retransmitted for node in line.ends] == [0, 0]


def test_greetings_without_an_answer_come_less_and_less_often_and_never_end() -> None:
    node = LinkLayer(1, RESEND_NS)
    node.set_carrier(LINK, True, 0)
    times_ns = [0]
    for _ in range(20):
        assert [packet.kind for _, packet in node.outgoing] == [FormationPacketKind.HELLO]
        node.outgoing.clear()
        deadline_ns = node.next_deadline()
        assert deadline_ns is not None
        node.on_deadline(deadline_ns - 1)
        assert not node.outgoing
        node.on_deadline(deadline_ns)
        times_ns.append(deadline_ns)
    assert [gap // RESEND_NS for gap in np.diff(times_ns)] == [min(2**i, 64) for i in range(20)]
    t_ns = times_ns[-1]
    node.set_carrier(LINK, False, t_ns)
    while (deadline_ns := node.next_deadline()) is not None:
        t_ns = deadline_ns
        node.on_deadline(t_ns)
    node.set_carrier(LINK, True, t_ns)
    assert node.next_deadline() == t_ns + RESEND_NS  # a line that comes back is greeted as a new one


def test_an_end_that_hears_nothing_any_more_says_so_three_times_and_then_is_silent() -> None:
    line = Line().run()
    cut_ns, before = line.t_ns, len(line.on_line)
    line.set((True, False))
    line.run()
    assert [(end, up, t_ns <= cut_ns + DETECT_NS + 500_000) for t_ns, end, up in line.turns[2:]] == [
        (0, False, True),
        (1, False, True),
    ]
    farewells = [packet for _, end, packet in line.on_line[before:] if end == 0]
    assert [packet.kind for packet in farewells] == [FormationPacketKind.HELLO] * 3
    assert line.ends[0].next_deadline() is None
    assert line.ends[1].next_deadline() is not None  # it still hears the other, and goes on greeting


def test_an_end_that_is_not_answered_repeats_eight_times_and_gives_the_link_up() -> None:
    line = Line().run()
    line.loss = 1.0
    sent_ns, before = line.t_ns, len(line.on_line)
    line.send(0)
    line.run()
    of_end = [packet.kind for _, end, packet in line.on_line[before:] if end == 0]
    assert of_end[: 1 + TRIES] == [FormationPacketKind.CELL_REPORT] * (1 + TRIES)
    assert set(of_end[1 + TRIES :]) == {FormationPacketKind.HELLO}
    assert line.turns[2:] == [(sent_ns + (1 + TRIES) * RESEND_NS, 0, False)]
    line.loss = 0.0
    line.run()
    line.check_agreed()  # the other end went down, and up again with it


def test_a_node_that_is_switched_on_again_has_a_new_session_and_gets_nothing_of_the_old() -> None:
    for life in (1, 2, 15):
        line = Line().run()
        line.send(1, 3)
        line.run(SERIAL_NS)  # on their way
        line.lives[0] = life - 1
        line.set((True, True), (False, True))
        line.set((True, True))
        line.run()
        line.send(1, 2)
        line.run()
        line.check_agreed()
        assert len(line.sessions[0][-1].received) == 2


def test_a_greeting_that_answers_an_earlier_session_makes_no_link() -> None:
    """It was on its way while this end gave the link up; what follows it is of that session, too."""
    line = Line().run()
    node = line.ends[0]
    node.send(LINK, FormationPacket(FormationPacketKind.CELL_REPORT), line.t_ns)
    node.outgoing.clear()
    t_ns = line.t_ns
    while node.is_up(LINK):
        t_ns += RESEND_NS
        node.on_deadline(t_ns)
    greeting = FormationPacket(FormationPacketKind.HELLO, value=1 << 16)  # both of session 0
    node.receive(LINK, greeting, t_ns)
    assert not node.is_up(LINK)
    assert node.receive(LINK, FormationPacket(FormationPacketKind.CELL_REPORT, value=7), t_ns) is None
    (_, answer) = node.outgoing[-1]
    node.receive(
        LINK, FormationPacket(FormationPacketKind.HELLO, value=1 << 16 | (answer.value & 0xFF) << 8), t_ns
    )
    assert node.is_up(LINK)


def test_a_node_that_begins_anew_unnoticed_makes_the_other_end_begin_anew() -> None:
    """So short a reset that its line never breaks: only the session tells."""
    line = Line().run()
    line.send(0, 2)
    line.send(1, 3)
    line.run()
    line.ends[0] = LinkLayer(1, RESEND_NS, boot_count=1)
    line.ends[0].set_carrier(LINK, True, line.t_ns)
    line.after(0)  # its power never went, and it hears the line at once
    line.run()
    for end in (0, 1):
        line.send(end, 2)
    line.run()
    line.check_agreed()
    assert [len(sessions) for sessions in line.sessions] == [2, 2]
    assert all(len(sessions[-1].received) == 2 for sessions in line.sessions)


def test_what_a_node_says_leaves_it_in_that_order() -> None:
    """Answers to packets and to deadlines take alike: a new session may not overtake the one before."""
    life = Streaming(patch("p", 4, 3), network=FAST | {"loss": 0.3})
    kernel, said_ns = life.network.kernel, defaultdict[int, list[int]](list)
    offer = kernel.enqueue

    def overheard(t_ns: Any, node: Any, dest: Any, *more: Any) -> None:
        if len(more) == 3:  # over a link that the sender names
            for at_ns, sender in zip(t_ns.tolist(), node.tolist(), strict=True):
                said_ns[sender].append(at_ns)
        offer(t_ns, node, dest, *more)

    kernel.enqueue = overheard  # type: ignore[assignment, method-assign]
    life.run(100_000_000)
    assert len(said_ns) == 13
    assert life.network.formation_driver.retransmitted > 0
    assert all(times_ns == sorted(times_ns) for times_ns in said_ns.values())
