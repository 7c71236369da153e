"""The conservative loop: nobody computes a period before all that belongs to it is there, in any order."""

import asyncio
import contextlib
import logging
import random
import tempfile
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_robot import small

from cells.cell_process import CellProcess
from controller.process import ControllerProcess
from controller.stages.core import StageCore
from skinnet.clock import next_multiple
from skinnet.deployment import Deployment
from skinnet.errors import NameTakenError, ProtocolError, UpstreamLostError
from skinnet.protocol.channels import EXTERNAL, Keys, Role
from skinnet.protocol.messages import Command, Joints, PeriodEnd, Stimulus, decode, encode
from skinnet.runtime.loop import LogicalProcess, Put, run_loop
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.transport.in_memory import InMemoryHub
from skinnet.transport.interface import Delivery
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.zenoh_loop import join_loop, listen_for_loop

KEYS = Keys("bot")
PERIOD_NS = 1000

counts = st.lists(st.integers(0, 3), min_size=1, max_size=6)


@given(counts=counts, random=st.randoms(use_true_random=False))
def test_a_period_is_covered_when_its_frame_and_all_messages_so_far_are_there(
    counts: list[int], random: random.Random
) -> None:
    arrivals = ["period_end"] * len(counts) + ["message"] * sum(counts)
    random.shuffle(arrivals)
    upstream = Upstream("p", "host")
    frames = messages = 0
    for arrival in arrivals:
        if arrival == "period_end":
            upstream.end_period((frames + 1) * PERIOD_NS, counts[frames])
            frames += 1
        else:
            upstream.count_arrivals()
            messages += 1
        whole = [k for k in range(frames + 1) if sum(counts[:k]) <= messages]
        assert upstream.watermark_ns == max(whole) * PERIOD_NS
        assert upstream.n_missing == max(0, sum(counts[:frames]) - messages)
    assert upstream.watermark_ns == len(counts) * PERIOD_NS


@given(counts=counts, random=st.randoms(use_true_random=False))
def test_in_the_end_no_order_of_arrival_matters(counts: list[int], random: random.Random) -> None:
    upstream = Upstream("p", "host")
    arrivals = [*enumerate(counts), *((None, n) for n in counts)]
    random.shuffle(arrivals)
    for period, n in arrivals:
        if period is None:
            upstream.count_arrivals(n)
        else:
            upstream.end_period((period + 1) * PERIOD_NS, n)
    assert upstream.watermark_ns == len(counts) * PERIOD_NS
    assert upstream.n_missing == 0


class Talker:
    """A node that closes each period with a frame, and remembers which frames it had when it computed.

    Args:
        name: Of its process and of its patch.
        hears: The others; with a head start they cover one period before they have said a word.
        periods: How many it computes.
        silent_from: Period from which on it says nothing.
        tolerated_losses: Whom it can do without.
        follows_wall_clock: Its periods follow the wall clock.
    """

    role = "cells"

    def __init__(
        self,
        name: str,
        hears: Sequence[str] = (),
        *,
        periods: int = 5,
        silent_from: int = 99,
        tolerated_losses: Sequence[str] = (),
        follows_wall_clock: bool = False,
        peers: Sequence[str] = (),
    ) -> None:
        self.name = name
        self.subscriptions = tuple(KEYS.of("period_end", other) for other in hears)
        self.upstreams: Mapping[str, Upstream] = {
            other: Upstream(other, other, watermark_ns=PERIOD_NS) for other in hears
        }
        self.senders = frozenset(hears)
        self.tolerated_losses = frozenset(tolerated_losses)
        self.peers = frozenset({name, *hears, *peers})
        self.counters: Counter[str] = Counter()
        self.follows_wall_clock = follows_wall_clock
        self.periods, self.silent_from = periods, silent_from
        self.t_ns = 0
        self.received: list[tuple[int, str]] = []
        self.log: list[tuple[int, list[tuple[int, str]]]] = []
        self.lost: list[str] = []

    def start(self, put: Put) -> None: ...

    def needs(self) -> Mapping[str, int] | None:
        if self.t_ns >= self.periods * PERIOD_NS:
            return None
        return dict.fromkeys(self.upstreams, self.t_ns + PERIOD_NS)

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        frame = decode(payload, PeriodEnd)
        if frame.patch not in self.upstreams:
            raise ProtocolError("who is that?")
        self.received.append((frame.t_ns, frame.patch))
        self.upstreams[frame.patch].end_period(frame.watermark_ns)

    def on_upstream_lost(self, upstream: Upstream) -> None:
        self.lost.append(upstream.name)

    def due_ns(self) -> int:
        return self.t_ns + PERIOD_NS

    def step(self, put: Put) -> None:
        due = sorted(frame for frame in self.received if frame[0] < self.t_ns)
        self.log.append((self.t_ns, due))
        self.t_ns += PERIOD_NS
        if self.t_ns <= self.silent_from * PERIOD_NS:
            t_ns = self.t_ns - PERIOD_NS
            frame = PeriodEnd(patch=self.name, t_ns=t_ns, watermark_ns=self.t_ns + PERIOD_NS, n_events=0)
            put(KEYS.of("period_end", self.name), encode(frame))

    def best_effort_messages(self) -> list[tuple[str, bytes]]:
        return [(KEYS.of("state"), self.name.encode()), (KEYS.of("answer"), b"and more")]

    def result(self) -> ProcessResult:
        return ProcessResult(self.name, self.role)


class Jumbled:
    """A transport that mixes what different senders sent; what one sent stays in its order."""

    def __init__(self, transport: LoopTransport, seed: int) -> None:
        self._transport, self._random = transport, random.Random(seed)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    async def receive(self, timeout_s: float | None = None, enough: int = 1) -> list[Delivery]:
        batch = await self._transport.receive(timeout_s, self._random.randint(1, enough))
        by_key: dict[str, deque[Delivery]] = {}
        for delivery in batch:
            by_key.setdefault(delivery.key, deque()).append(delivery)
        tickets = [delivery.key for delivery in batch]
        self._random.shuffle(tickets)
        return [by_key[key].popleft() for key in tickets]


async def meet(
    *nodes: LogicalProcess, deadline_s: float = 20.0, seed: int | None = None, leave: bool = True
) -> InMemoryHub:
    """Runs nodes together; each leaves when it is finished."""
    hub = InMemoryHub(KEYS)

    async def live(node: LogicalProcess) -> None:
        transport = hub.connect(node.name)
        jumbled: Any = transport if seed is None else Jumbled(transport, seed)
        await run_loop(node, jumbled, KEYS, deadline_s=deadline_s)
        if leave:
            transport.close()

    async with asyncio.TaskGroup() as group:
        for node in nodes:
            group.create_task(live(node))
    return hub


TRIO = {"a": ("b", "c"), "b": ("a", "c"), "c": ("a", "b")}


@pytest.mark.parametrize("seed", range(5))
async def test_what_a_period_knows_does_not_depend_on_the_order_of_arrival(seed: int) -> None:
    nodes = [Talker(name, hears, periods=12) for name, hears in TRIO.items()]
    await meet(*nodes, seed=seed, leave=False)
    for node in nodes:
        everything = [
            (t_ns, other) for t_ns in range(0, 12 * PERIOD_NS, PERIOD_NS) for other in TRIO[node.name]
        ]
        assert node.log == [
            (k * PERIOD_NS, [frame for frame in everything if frame[0] < k * PERIOD_NS]) for k in range(12)
        ]
        assert not node.counters


async def test_the_loop_begins_when_everybody_is_there() -> None:
    hub = InMemoryHub(KEYS)
    node = Talker("a", peers=("late",))
    task = asyncio.create_task(run_loop(node, hub.connect("a"), KEYS, deadline_s=20.0))
    for _ in range(10):
        await asyncio.sleep(0)
    assert not node.log
    hub.connect("late").session.declare_token(KEYS.liveliness(Role.CELLS, "late"))
    assert await task == {"a", "late"}
    assert len(node.log) == 5


async def test_watchers_hear_the_news() -> None:
    hub = InMemoryHub(KEYS)
    told: list[bytes] = []
    hub.connect("watcher").session.declare_subscriber(
        KEYS.prefix + "controller/**", lambda _key, payload: told.append(payload)
    )
    await run_loop(Talker("a"), hub.connect("a"), KEYS, deadline_s=20.0)
    assert told == [b"a", b"and more"] * 5


async def test_who_comes_under_a_name_that_is_taken_leaves_and_disturbs_nobody() -> None:
    hub = InMemoryHub(KEYS)
    said: Counter[str] = Counter()
    hub.connect("watcher").declare_loop_subscriber(
        KEYS.of("period_end", "*"), lambda key, _payload: said.update([key])
    )
    first, twin, other = Talker("a", ("b",)), Talker("a", ("b",)), Talker("b", ("a",))
    running = asyncio.create_task(run_loop(first, hub.connect("a"), KEYS, deadline_s=20.0))
    await asyncio.sleep(0)
    for _ in range(3):
        transport = hub.connect("a")
        with pytest.raises(NameTakenError, match=r"^a: a process of this name is already"):
            await run_loop(twin, transport, KEYS, deadline_s=20.0)
        transport.close()
    await run_loop(other, hub.connect("b"), KEYS, deadline_s=20.0)
    assert await running == {"a", "b"}
    assert twin.log == twin.received == []
    assert len(first.log) == len(other.log) == 5
    assert said == {KEYS.of("period_end", "a"): 5, KEYS.of("period_end", "b"): 5}
    assert not first.counters
    assert not other.counters


async def test_a_name_is_free_again_when_its_process_has_left() -> None:
    hub = InMemoryHub(KEYS)
    for _ in range(3):
        transport = hub.connect("a")
        await run_loop(Talker("a"), transport, KEYS, deadline_s=20.0)
        transport.close()


def test_of_several_that_come_at_once_at_most_one_goes_on() -> None:
    """Over Zenoh, where each has a connection of its own and none can be first by luck of a lock."""
    with tempfile.TemporaryDirectory(prefix="skin") as folder, ThreadPoolExecutor(3) as pool:
        endpoint = f"unixsock-stream/{folder}/hub"
        hub = listen_for_loop(KEYS, "hub", endpoint)
        for _ in range(10):
            transports = [join_loop(KEYS, "a", endpoint) for _ in range(3)]
            together = Barrier(len(transports))

            def live(transport: LoopTransport, together: Barrier = together) -> int:
                node = Talker("a")
                together.wait()
                with contextlib.suppress(NameTakenError):
                    asyncio.run(run_loop(node, transport, KEYS, deadline_s=20.0))
                return len(node.log)

            lived = sorted(pool.map(live, transports))
            assert lived in ([0, 0, 0], [0, 0, 5])
            for transport in transports:
                transport.close()
        hub.close()


async def test_a_lost_upstream_that_is_tolerated() -> None:
    a = Talker("a", ("b", "c"), periods=8, tolerated_losses=("b",))
    b, c = Talker("b", ("a", "c"), periods=3), Talker("c", ("a",), periods=8)
    await meet(a, b, c)
    assert a.lost == ["b"]
    assert a.counters == {"lost_upstreams": 1}
    assert len(a.log) == len(c.log) == 8
    # its last words were heard, those of the others further on
    assert {name: max(t for t, who in a.received if who == name) for name in "bc"} == {
        "b": 2000,
        "c": 6000,
    }


async def test_a_lost_upstream_that_is_needed() -> None:
    a, b = Talker("a", ("b",), periods=8), Talker("b", ("a",), periods=3)
    with pytest.RaisesGroup(pytest.RaisesExc(UpstreamLostError, match=r"^a: b \(source of b\) is gone$")):
        await meet(a, b)
    assert len(a.log) == 4  # the head start, and the three periods that were closed


async def test_a_silent_upstream_is_given_up_after_the_deadline() -> None:
    a, b = Talker("a", ("b",)), Talker("b", ("a",), silent_from=2, periods=99, tolerated_losses=("a",))
    with pytest.RaisesGroup(
        pytest.RaisesExc(UpstreamLostError, match=r"a: b .*is silent.* no period end for 0\.05 s")
    ):
        await meet(a, b, deadline_s=0.05)
    assert len(a.log) == 3


async def test_who_waits_for_a_tolerated_upstream_is_not_silent_to_others() -> None:
    """A waits for C, which may be lost, until its deadline; B, which waits for A just as long, goes on."""
    a = Talker("a", ("b", "c"), tolerated_losses=("c",))
    b = Talker("b", ("a",), tolerated_losses=("c",))
    c = Talker("c", ("a",), silent_from=2, periods=3)
    await meet(a, b, c, deadline_s=0.2, leave=False)
    assert (a.lost, b.lost) == (["c"], [])
    assert len(a.log) == len(b.log) == 5


async def test_who_keeps_talking_does_not_hide_a_silent_upstream() -> None:
    """Messages of an external client come all the time, and count for nobody's period end."""
    hub = InMemoryHub(KEYS)
    node = Talker("a", ("b",))
    hub.connect("b").session.declare_token(KEYS.liveliness(Role.CELLS, "b"))
    client = hub.connect(EXTERNAL)

    async def chat() -> None:
        while True:
            client.put(KEYS.of("period_end", "b"), b"nonsense")
            client.flush()
            await asyncio.sleep(0)

    chatting = asyncio.create_task(chat())
    async with asyncio.timeout(20.0):
        with pytest.raises(UpstreamLostError, match=r"b .source of b. is silent"):
            await run_loop(node, hub.connect("a"), KEYS, deadline_s=0.1)
    chatting.cancel()


async def test_a_silent_upstream_that_is_tolerated() -> None:
    a = Talker("a", ("b",), tolerated_losses=("b",))
    b = Talker("b", ("a",), silent_from=2, periods=3)
    await meet(a, b, deadline_s=0.05, leave=False)
    assert a.lost == ["b"]
    assert len(a.log) == 5


async def test_a_message_without_sense_is_counted_and_its_source_named_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    strays = [Delivery(KEYS.prefix + "no/channel", b"x")] * 2

    class Strayed(Jumbled):
        async def receive(self, timeout_s: float | None = None, enough: int = 1) -> list[Delivery]:
            batch = await self._transport.receive(timeout_s, enough)
            return [*batch, *(strays.pop() for _ in strays[:1])]

    hub = InMemoryHub(KEYS)
    stranger = hub.connect(EXTERNAL)
    node = Talker("a", ("b",), periods=3)
    node.subscriptions = (KEYS.of("period_end", "*"),)
    node.peers = frozenset({"a"})
    transport: Any = Strayed(hub.connect("a"), 0)
    task = asyncio.create_task(run_loop(node, transport, KEYS, deadline_s=20.0))
    await asyncio.sleep(0)
    good = [PeriodEnd(patch="b", t_ns=t, watermark_ns=t + PERIOD_NS, n_events=0) for t in (1000, 2000)]
    other = encode(PeriodEnd(patch="z", t_ns=0, watermark_ns=10**9, n_events=0))
    with caplog.at_level(logging.WARNING, "skinnet.runtime.loop"):
        for frame in good:
            stranger.put(KEYS.of("period_end", "b"), b"\xc1 no message")
            stranger.put(KEYS.of("period_end", "b"), encode(Joints(t_ns=0, watermark_ns=0, position_rad=[])))
            stranger.put(KEYS.of("period_end", "z"), other)
            stranger.put(KEYS.of("period_end", "b"), encode(frame))
            stranger.flush()
        await task
    assert node.counters == {"malformed_messages": 8}
    assert len(caplog.records) == 3
    for key in (KEYS.of("period_end", "b"), KEYS.of("period_end", "z"), KEYS.prefix + "no/channel"):
        assert sum(f" {key}: " in record.getMessage() for record in caplog.records) == 1
    assert [frame[0] for frame in node.received] == [1000, 2000]


class Behind:
    """A wall clock that is always past the deadline."""

    def wait_s(self, t_ns: int) -> float:
        return -1.0


async def alone(monkeypatch: pytest.MonkeyPatch, node: Talker, frames: int) -> None:
    """Runs a node in real time that is behind; all frames of its only source came before it began."""
    monkeypatch.setattr("skinnet.runtime.loop.WallClockPace", Behind)
    hub = InMemoryHub(KEYS)
    node.peers = frozenset({node.name})
    transport = hub.connect(node.name)
    transport.subscribe(node.subscriptions, ["b"])
    node.subscriptions = ()
    source = hub.connect("b")
    for k in range(frames):
        frame = PeriodEnd(patch="b", t_ns=k * PERIOD_NS, watermark_ns=(k + 2) * PERIOD_NS, n_events=0)
        source.put(KEYS.of("period_end", "b"), encode(frame))
    source.flush()
    await run_loop(node, transport, KEYS, deadline_s=20.0, realtime=True)


async def test_who_is_behind_waits_for_nobody_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    node = Talker("a", ("b",), periods=6, follows_wall_clock=True)
    await alone(monkeypatch, node, frames=0)
    assert len(node.log) == 6
    assert node.counters["deadline_misses"] == 5  # all but the head start
    assert not node.lost


async def test_who_is_behind_still_takes_in_what_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    node = Talker("a", ("b",), periods=6, follows_wall_clock=True)
    await alone(monkeypatch, node, frames=3)
    assert len(node.received) == 3
    assert node.counters["deadline_misses"] == 2  # periods 0 to 3 were covered


async def test_a_body_that_is_behind_lets_the_others_of_its_process_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("skinnet.runtime.loop.WallClockPace", Behind)
    hub = InMemoryHub(KEYS)
    fast, steady = Talker("a", ("b",), periods=200, follows_wall_clock=True), Talker("b", ("a",), periods=20)
    async with asyncio.TaskGroup() as group:
        for node in (fast, steady):
            group.create_task(run_loop(node, hub.connect(node.name), KEYS, deadline_s=20.0, realtime=True))
    assert len(fast.received) == 20
    assert len(steady.log) == 20
    assert steady.counters["deadline_misses"] == 0  # only the body follows the wall clock


async def test_who_is_in_time_waits_for_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock moves only while somebody waits for it."""

    class Asked:
        now_s = 0.0

        def wait_s(self, t_ns: int) -> float:
            return t_ns * 1e-6 - Asked.now_s  # a period lasts a millisecond

    class Waiting(Jumbled):
        async def receive(self, timeout_s: float | None = None, enough: int = 1) -> list[Delivery]:
            assert timeout_s is not None
            if timeout_s < 1.0:  # not the wait for peers
                waits.append(timeout_s)
                Asked.now_s += timeout_s
            return await self._transport.receive(0.0)

    monkeypatch.setattr("skinnet.runtime.loop.WallClockPace", Asked)
    waits: list[float] = []
    node = Talker("a", periods=4, follows_wall_clock=True)
    transport: Any = Waiting(InMemoryHub(KEYS).connect("a"), 0)
    await run_loop(node, transport, KEYS, deadline_s=20.0, realtime=True)
    assert sum(waits) == pytest.approx(4e-3)
    assert node.counters["deadline_misses"] == 0


class RestingBody:
    """A body that does not move: what it sends and when it waits is what matters."""

    role = Role.BODY.value
    follows_wall_clock = True

    def __init__(self, deployment: Deployment) -> None:
        self.name = "body"
        self._spec = deployment
        control = deployment.controller
        self._controller = Upstream("controller", "controller", watermark_ns=control.command_delay_ns)
        self.upstreams: Mapping[str, Upstream] = {"controller": self._controller}
        self.subscriptions = (KEYS.of("command"),)
        self.peers = frozenset({"body", "controller", *deployment.patches_by_process()})
        self.senders, self.tolerated_losses = frozenset({"controller"}), frozenset[str]()
        self.counters: Counter[str] = Counter()
        self.t_ns, self.end_ns = 0, deployment.max_duration_ns
        self._pending: deque[Command] = deque()
        self._configs: Counter[str] = Counter()
        self._said_end: int | None = None
        self._cells = {patch.name: patch.n_cells for patch in deployment.patches}

    def start(self, put: Put) -> None:
        self._publish(put)

    def needs(self) -> dict[str, int] | None:
        return {"controller": self.due_ns()} if self.t_ns < self.end_ns else None

    def due_ns(self) -> int:
        body, control = self._spec.body, self._spec.controller
        return min(
            next_multiple(self.t_ns, body.stimulus_period_ns),
            next_multiple(self.t_ns, control.period_ns),
            next_multiple(self.t_ns, control.period_ns, control.command_delay_ns),
        )

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        command = decode(payload, Command)
        self._controller.end_period(command.watermark_ns)
        self._pending.append(command)

    def on_upstream_lost(self, upstream: Upstream) -> None: ...

    def step(self, put: Put) -> None:
        end_ns = self.due_ns()
        while self._pending and self._pending[0].effect_ns <= self.t_ns:
            command = self._pending.popleft()
            self._configs.update(command.config_counts)
            if command.end_ns is not None:
                self.end_ns = self._said_end = command.end_ns
        self.t_ns = end_ns
        self._publish(put)

    def _publish(self, put: Put) -> None:
        t_ns = self.t_ns
        if t_ns % self._spec.body.stimulus_period_ns == 0:
            for host, patches in self._spec.patches_by_process().items():
                felt = np.zeros((sum(self._cells[patch] for patch in patches), 8), dtype="<f4")
                frame = Stimulus(
                    process=host,
                    t_ns=t_ns,
                    watermark_ns=t_ns,
                    values=felt.tobytes(),
                    n_configs=sum(self._configs.pop(patch, 0) for patch in patches),
                    end_ns=self._said_end,
                )
                put(KEYS.of("stimulus", host), encode(frame))
        if t_ns % self._spec.body.joint_state_period_ns == 0:
            put(KEYS.of("joints"), encode(Joints(t_ns=t_ns, watermark_ns=t_ns, position_rad=[0.1, 0.2])))

    def best_effort_messages(self) -> tuple[()]:
        return ()

    def result(self) -> ProcessResult:
        return ProcessResult(self.name, self.role)


def robot(stimulus_period_ms: int, control_ms: int, delay_ms: int) -> list[Any]:
    """All nodes of a small robot, real but for the body."""
    deployment = small(
        cell_processes="per_patch",
        run={"max_s": 0.2},
        body={"stimulus_period_ms": stimulus_period_ms, "joint_state_period_ms": control_ms},
        cells={"period_ms": stimulus_period_ms},
        controller={"period_ms": control_ms, "command_delay_ms": delay_ms},
    )
    sizes = {patch.name: patch.n_cells for patch in deployment.patches}
    hosts = [CellProcess(deployment, name) for name in deployment.patches_by_process()]
    core = StageCore(deployment.controller, sizes)
    return [RestingBody(deployment), *hosts, ControllerProcess(deployment, "controller", core)]


@pytest.mark.parametrize("periods_ms", [(4, 5, 3), (5, 4, 4), (4, 4, 1), (6, 4, 4), (4, 6, 2), (7, 1, 6)])
async def test_cells_controller_and_body_need_no_longer_delay_than_is_asked_for(
    periods_ms: tuple[int, int, int],
) -> None:
    nodes = robot(*periods_ms)
    async with asyncio.timeout(60.0):  # and nobody sits out a deadline, not even at the end
        await meet(*nodes, deadline_s=3600.0, leave=False)
    assert nodes[-1].result().facts["done"]
    assert nodes[0].t_ns == nodes[0].end_ns < 200_000_000
    assert all(not node.counters for node in nodes)


@pytest.mark.parametrize("periods_ms", [(4, 5, 2), (5, 4, 3), (6, 4, 3), (7, 1, 5)])
async def test_with_a_shorter_delay_they_wait_for_each_other(periods_ms: tuple[int, int, int]) -> None:
    """What `checks` refuses, and why."""
    nodes = robot(*periods_ms)
    with pytest.raises(ExceptionGroup) as group:
        await meet(*nodes, deadline_s=0.2, leave=False)
    for error in group.value.exceptions:  # who sees it first, and perhaps another
        assert isinstance(error, UpstreamLostError)
        assert "sent no period end" in str(error)
        assert error.silent
    assert nodes[0].t_ns < 40_000_000
