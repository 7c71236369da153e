"""Conservative synchronisation (Chandy-Misra-Bryant) of the logical processes of a run.

A process states the time up to which it needs each upstream before it can compute its next period. The loop
receives messages until the watermark of every live upstream has reached that time, lets the process compute,
and repeats. In lockstep that is all; in real time the periods of the body also wait for the wall clock and,
past their deadline, start without the upstreams that are late.
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
"""Callback that adds a message (key, payload) to the batch of the period."""


class Node(Protocol):
    """Logical process of the simulation: its logic without I/O.

    Attributes:
        name: Process name.
        role: Role, for the liveliness token.
        subscriptions: Key expressions that it subscribes to.
        senders: Names of the processes whose messages it receives.
        upstreams: Upstreams by name.
        tolerated: Names of the processes whose loss does not end this one.
        peers: Names of the processes that must be present before the first period.
        counters: Event counts by name.
        paced: Periods follow the wall clock when the run's pace is real time.
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
        """Publish the messages that precede the first period."""

    def needs(self) -> Mapping[str, int] | None:
        """Return the watermark [ns] that each upstream must reach; None when the process is finished."""

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept a message.

        Raises:
            ProtocolError: the message is malformed; the state is unchanged.
        """

    def lose(self, upstream: Upstream) -> None:
        """Continue safely without an upstream that is lost."""

    def due_ns(self) -> int:
        """Return the simulated time [ns] at which the next period ends."""

    def step(self, put: Put) -> None:
        """Compute the next period and publish its messages."""

    def news(self) -> Iterable[tuple[str, bytes]]:
        """Return keys and payloads for best-effort publication to observers, outside the loop."""

    def result(self) -> Part:
        """Return the facts and arrays of this process for the summary, after the loop."""


@runtime_checkable
class Sparing(Protocol):
    """Logical process that skips publications without a subscriber."""

    def listen_for(self, heard: Callable[[str], bool]) -> None:
        """Take `heard`, which returns whether a key has a subscriber."""


@runtime_checkable
class Keeping(Protocol):
    """Logical process with a resource to close, however the run ends (a file that must be complete)."""

    def end(self) -> None:
        """Close the resource, at the end of the run or on an error."""


@runtime_checkable
class Reporter(Protocol):
    """Logical process that publishes telemetry by the wall clock, only while an observer subscribes.

    Attributes:
        reported: Key expression of the telemetry.
    """

    reported: str

    def report(self) -> Iterable[tuple[str, bytes]]:
        """Return keys and payloads of the telemetry."""


_REPORT_EVERY_S = 0.5
_RECORD_EVERY = 8
"""Periods per batch to the recorder: it has no deadline, and each batch costs CPU time in three processes."""
_GRACE_S = 0.2
"""Grace period [s]: the loss of a token may overtake the last messages, which come through another thread."""


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
        """Wait until every peer has declared its liveliness token, including those gone again."""
        while not self.node.peers <= self.present | self.gone_s.keys():
            self.take(await self.transport.receive(1.0))

    async def fulfil(self, pace: WallPace | None) -> None:
        """Receive messages until the needed watermarks are reached or, in real time, the period is due."""
        self.heard_s = time.monotonic()
        while (needs := self.node.needs()) is not None:
            missing = self.missing(needs)
            if pace is None:
                if not missing:
                    return
                # every missing upstream still owes one period end at least
                self.take(await self.transport.receive(self.patience_s(missing), len(missing)))
            else:
                wait_s = pace.wait_s(self.node.due_ns())
                # receive even when late, or messages would stay unread until the body has caught up
                self.take(await self.transport.receive(max(wait_s, 0.0)))
                if wait_s <= 0.0:
                    self.node.counters["late_frames"] += bool(self.missing(needs))
                    return
            for up in missing:
                self.judge(up)

    def missing(self, needs: Mapping[str, int]) -> list[Upstream]:
        """Return the live upstreams whose watermark is below the needed time."""
        sources = self.node.upstreams
        return [up for name, t_ns in needs.items() if (up := sources[name]).covered_ns < t_ns and not up.lost]

    def patience_s(self, missing: list[Upstream]) -> float:
        """Return the timeout [s] for the next message before the missing upstreams are checked."""
        return _GRACE_S / 4 if any(up.process in self.gone_s for up in missing) else self.deadline_s

    def judge(self, up: Upstream) -> None:
        """Drop a missing upstream whose process is gone, or silent beyond the deadline."""
        now_s = time.monotonic()
        if now_s - self.gone_s.get(up.process, now_s) > _GRACE_S:
            self.give_up(up, "is gone")
        elif now_s - self.heard_s >= self.deadline_s:
            self.give_up(up, f"sent no frame for {self.deadline_s:g} s")

    def take(self, batch: list[Delivery]) -> None:
        """Dispatch deliveries: liveliness changes to the loop, messages to the process."""
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
        """Pass a message to the process; count and drop a malformed one."""
        try:
            row, fields = self.keys.parse(key)
            self.node.accept(row.name, fields, payload)
        except ProtocolError as error:
            self.node.counters["malformed"] += 1
            if key not in self._blamed and len(self._blamed) < 1000:  # once per source
                self._blamed.add(key)
                log.warning("dropped a message on %s: %s", key, error)

    def give_up(self, up: Upstream, why: str) -> None:
        """Continue without an upstream if its loss is tolerated.

        Raises:
            UpstreamLostError: it is not.
        """
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
    """Claim the process name `name` by a liveliness token.

    The token is declared before the others are read: of several simultaneous claimants at most one succeeds,
    and possibly none.

    Raises:
        NameTakenError: another process holds the name.
    """
    own = keys.claim(name, uuid.uuid4().hex)
    transport.announce(own)
    if transport.present(keys.claim(name, "*")) - {own}:
        raise NameTakenError(
            f"{name}: there is a process of this name in the loop already; only one may speak in it, "
            f"so this one leaves (end the other first)"
        )


class _Reports:
    """Telemetry publisher of a process that is a `Reporter`."""

    def __init__(self, node: Node, transport: Transport) -> None:
        self._tell = transport.tell
        self._reporter = node if isinstance(node, Reporter) else None
        if self._reporter is not None:
            self._wanted = transport.audience(self._reporter.reported)
        self._due_s = time.monotonic()

    def tell(self) -> None:
        """Publish telemetry if it is due and an observer subscribes."""
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
    """Run the logical process `node` over `transport` until it is finished.

    After each period, `on_period` is called with the simulated time [ns] at which it ended.

    Returns:
        Names of the processes that are still present.

    Raises:
        NameTakenError: a process of this name is in the loop; it is not disturbed.
        UpstreamLostError: an upstream whose loss is not tolerated is gone or silent.
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
