"""The one period loop that body, cells and controller all run.

A node says which source it needs up to which time before it can compute its next period. The loop takes in
messages until every source that is still alive has covered that time, lets the node compute, and so on: a
conservative, dataflow-driven parallel simulation. In lockstep that is all; in real time the body's periods
also wait for the wall clock and, past their deadline, for nobody.
"""

import logging
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Protocol, runtime_checkable

from skinnet.channels import ALIVE, OUTSIDE, RECORDER, Keys
from skinnet.clock import WallPace
from skinnet.errors import NameTakenError, ProtocolError, UpstreamLostError
from skinnet.part import Part
from skinnet.transport.base import Delivery, Transport
from skinnet.upstream import Upstream

__all__ = ["Keeping", "Node", "Put", "Reporter", "Sparing", "run_loop"]

log = logging.getLogger(__name__)

Put = Callable[[str, bytes], None]
"""Adds a message to those of the period: key and payload."""


class Node(Protocol):
    """The core of a process: decides, without I/O.

    Attributes:
        name: Name of the process.
        role: Its role, for the liveliness token.
        subscriptions: Key expressions that it reads.
        senders: Processes whose messages it reads.
        upstreams: Sources of frames by name.
        tolerated: Processes whose loss does not end this one.
        peers: Processes that must be there before the first period.
        counters: What was counted on the way, by name.
        paced: Its periods follow the wall clock when the run's pace is real time.
    """

    name: str
    role: str
    subscriptions: tuple[str, ...]
    senders: frozenset[str]
    upstreams: Mapping[str, Upstream]
    tolerated: frozenset[str]
    peers: frozenset[str]
    counters: Counter[str]
    paced: bool

    def start(self, put: Put) -> None:
        """Sends what has to be there before the first period."""

    def needs(self) -> Mapping[str, int] | None:
        """Time [ns] up to which each source must have covered; None when the node is finished."""

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Takes in a message; raises ProtocolError and changes nothing if it makes no sense."""

    def lose(self, upstream: Upstream) -> None:
        """A source is gone: go on without it, safely."""

    def due_ns(self) -> int:
        """Simulated time at which the next period ends, for the pace of real time."""

    def step(self, put: Put) -> None:
        """Computes the next period and sends what it brings."""

    def news(self) -> Iterable[tuple[str, bytes]]:
        """Keys and payloads of what is for watchers since the last period, and not part of the run."""

    def result(self) -> Part:
        """What the summary needs of this process, when the loop is over."""


@runtime_checkable
class Sparing(Protocol):
    """A node that does not send what nobody hears."""

    def listen_for(self, heard: Callable[[str], bool]) -> None:
        """From now on `heard` tells whether anybody hears what is put on a key."""


@runtime_checkable
class Keeping(Protocol):
    """A node that keeps something beyond the run, which is to be whole however the run ends."""

    def end(self) -> None:
        """The run is over, or ends here."""


@runtime_checkable
class Reporter(Protocol):
    """A node that reports to watchers now and then, by the clock on the wall and only if there are any.

    Attributes:
        reported: Key expression of its reports.
    """

    reported: str

    def report(self) -> Iterable[tuple[str, bytes]]:
        """Keys and payloads of a report."""


_REPORT_EVERY_S = 0.5
_RECORD_EVERY = 8
"""Periods of which the recorder hears at once: it has time, and each envelope costs three processes some."""
_GRACE_S = 0.2
"""Liveliness may overtake the last messages of a process, which come through another thread."""


class _Loop:
    def __init__(self, node: Node, transport: Transport, keys: Keys, deadline_s: float) -> None:
        self.node = node
        self.transport = transport
        self.keys = keys
        self.deadline_s = deadline_s
        self.present: set[str] = set()
        self.gone_s: dict[str, float] = {}
        self.heard_s = time.monotonic()
        self._blamed: set[str] = set()

    async def gather(self) -> None:
        """Waits until every peer has announced itself, be it that some are gone again."""
        while not self.node.peers <= self.present | self.gone_s.keys():
            self.take(await self.transport.receive(1.0))

    async def fulfil(self, pace: WallPace | None) -> None:
        """Takes in messages until the node has what it needs, or in real time until it is due."""
        self.heard_s = time.monotonic()
        while (needs := self.node.needs()) is not None:
            missing = self.missing(needs)
            if pace is None:
                if not missing:
                    return
                # every missing source still owes a frame at least
                self.take(await self.transport.receive(self.patience_s(missing), len(missing)))
            else:
                wait_s = pace.wait_s(self.node.due_ns())
                # who is late looks too: what came meanwhile would wait for a body that has caught up
                self.take(await self.transport.receive(max(wait_s, 0.0)))
                if wait_s <= 0.0:
                    self.node.counters["late_frames"] += bool(self.missing(needs))
                    return
            for up in missing:
                self.judge(up)

    def missing(self, needs: Mapping[str, int]) -> list[Upstream]:
        """Sources that live and have not covered what the node needs."""
        sources = self.node.upstreams
        return [up for name, t_ns in needs.items() if (up := sources[name]).covered_ns < t_ns and not up.lost]

    def patience_s(self, missing: list[Upstream]) -> float:
        """How long to wait for the next message before looking at who is missing."""
        return _GRACE_S / 4 if any(up.process in self.gone_s for up in missing) else self.deadline_s

    def judge(self, up: Upstream) -> None:
        """Gives up a missing source whose process is gone or silent for too long."""
        now_s = time.monotonic()
        if now_s - self.gone_s.get(up.process, now_s) > _GRACE_S:
            self.give_up(up, "is gone")
        elif now_s - self.heard_s >= self.deadline_s:
            self.give_up(up, f"sent no frame for {self.deadline_s:g} s")

    def take(self, batch: list[Delivery]) -> None:
        """Sorts what came in: liveliness here, messages to the node."""
        if batch:
            self.heard_s = time.monotonic()
        for key, payload in batch:
            if payload is None:
                process = key.rsplit("/", 1)[-1]
                self.present.discard(process)
                self.gone_s.setdefault(process, time.monotonic())
            elif payload == b"" and f"/{ALIVE}/" in key:
                self.present.add(key.rsplit("/", 1)[-1])
            else:
                self.accept(key, payload)

    def accept(self, key: str, payload: bytes) -> None:
        """Hands a message to the node; one that makes no sense is counted and dropped."""
        try:
            row, fields = self.keys.parse(key)
            self.node.accept(row.name, fields, payload)
        except ProtocolError as error:
            self.node.counters["malformed"] += 1
            if key not in self._blamed and len(self._blamed) < 1000:  # once per source
                self._blamed.add(key)
                log.warning("dropped a message on %s: %s", key, error)

    def give_up(self, up: Upstream, why: str) -> None:
        """Goes on without a source, or ends with a clear error."""
        if up.lost:
            return
        up.lost = True
        self.node.lose(up)
        self.node.counters["lost_upstreams"] += 1
        text = f"{up.process} (source of {up.name}) {why}"
        if up.process not in self.node.tolerated:
            raise UpstreamLostError(f"{self.node.name}: {text}")
        log.warning("%s; going on without it", text)


def _claim(name: str, transport: Transport, keys: Keys) -> None:
    """Makes sure that no other process speaks in the name of this one.

    First the token, then the look: of several that come at once at most one goes on, and perhaps none.
    """
    own = keys.claim(name, uuid.uuid4().hex)
    transport.announce(own)
    if transport.present(keys.claim(name, "*")) - {own}:
        raise NameTakenError(
            f"{name}: there is a process of this name in the loop already; only one may speak in it, "
            f"so this one leaves (end the other first)"
        )


class _Reports:
    """Sends the reports of a node that makes some."""

    def __init__(self, node: Node, transport: Transport) -> None:
        self._tell = transport.tell
        self._reporter = node if isinstance(node, Reporter) else None
        if self._reporter is not None:
            self._wanted = transport.audience(self._reporter.reported)
        self._due_s = time.monotonic()

    def tell(self) -> None:
        """Sends one if it is time, and somebody wants it."""
        if self._reporter is None or (now_s := time.monotonic()) < self._due_s:
            return
        self._due_s = now_s + _REPORT_EVERY_S
        if self._wanted():
            for key, payload in self._reporter.report():
                self._tell(key, payload)


async def run_loop(
    node: Node,
    transport: Transport,
    keys: Keys,
    *,
    deadline_s: float,
    realtime: bool = False,
    on_period: Callable[[int], None] | None = None,
) -> set[str]:
    """Runs `node` over `transport` until it is finished; returns the processes that are still there.

    After each period, `on_period` is called with the simulated time [ns] at which it ended.

    Raises:
        NameTakenError: there is a process of this name; it is not disturbed.
        UpstreamLostError: a source that is not tolerated to be lost is gone or silent.
    """
    _claim(node.name, transport, keys)
    transport.subscribe(node.subscriptions, sorted(node.senders | {OUTSIDE}))
    transport.watch_alive(keys.alive("*", "*"))
    if isinstance(node, Sparing):
        node.listen_for(transport.heard)
    transport.announce(keys.alive(node.role, node.name))
    if RECORDER in node.peers:
        transport.record(_RECORD_EVERY)
    loop = _Loop(node, transport, keys, deadline_s)
    await loop.gather()
    pace = WallPace() if realtime and node.paced else None
    reports = _Reports(node, transport)
    node.start(transport.put)
    transport.flush()
    while True:
        await loop.fulfil(pace)
        if node.needs() is None:
            transport.flush(last=True)
            return loop.present
        due_ns = node.due_ns()
        node.step(transport.put)
        transport.flush()
        if on_period is not None:
            on_period(due_ns)
        for key, payload in node.news():
            transport.tell(key, payload)
        reports.tell()
