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

from skinnet.clock import WallClockPace
from skinnet.errors import NameTakenError, ProtocolError, UpstreamLostError
from skinnet.protocol.channels import ALIVE, EXTERNAL, RECORDER, Keys
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.runtime.upstream_timeouts import UpstreamTimeouts
from skinnet.transport.interface import Delivery, PublicSession
from skinnet.transport.loop_transport import LoopTransport

__all__ = ["Closeable", "LogicalProcess", "Put", "SubscriptionAware", "TelemetrySource", "run_loop"]

log = logging.getLogger(__name__)

Put = Callable[[str, bytes], None]
"""Callback that adds a message (key, payload) to the batch of the period."""


class LogicalProcess(Protocol):
    """Logical process of the simulation: its logic without I/O.

    Attributes:
        name: Process name.
        role: Role, for the liveliness token.
        subscriptions: Key expressions that it subscribes to.
        senders: Names of the processes whose messages it receives.
        upstreams: Upstreams by name.
        tolerated_losses: Names of the processes whose loss does not end this one.
        peers: Names of the processes that must be present before the first period.
        counters: Event counts by name.
        follows_wall_clock: Periods follow the wall clock when the run's pace is real time.
    """

    name: str
    role: str
    subscriptions: tuple[str, ...]
    senders: frozenset[str]
    upstreams: Mapping[str, Upstream]
    tolerated_losses: frozenset[str]
    peers: frozenset[str]
    counters: Counter[str]
    follows_wall_clock: bool

    def start(self, put: Put) -> None:
        """Publish the messages that precede the first period."""

    def needs(self) -> Mapping[str, int] | None:
        """Return the watermark [ns] that each upstream must reach; None when the process is finished."""

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept a message.

        Raises:
            ProtocolError: the message is malformed; the state is unchanged.
        """

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Continue safely without an upstream that is lost."""

    def due_ns(self) -> int:
        """Return the simulated time [ns] at which the next period ends."""

    def step(self, put: Put) -> None:
        """Compute the next period and publish its messages."""

    def best_effort_messages(self) -> Iterable[tuple[str, bytes]]:
        """Return keys and payloads for best-effort publication to observers, outside the loop."""

    def result(self) -> ProcessResult:
        """Return the facts and arrays of this process for the summary, after the loop."""


@runtime_checkable
class SubscriptionAware(Protocol):
    """Logical process that skips publications without a subscriber."""

    def use_subscriber_check(self, has_subscribers: Callable[[str], bool]) -> None:
        """Take `has_subscribers`, which returns whether a key has a subscriber."""


@runtime_checkable
class Closeable(Protocol):
    """Logical process with a resource to close, however the run ends (a file that must be complete)."""

    def close(self) -> None:
        """Close the resource, at the end of the run or on an error."""


@runtime_checkable
class TelemetrySource(Protocol):
    """Logical process that publishes telemetry by the wall clock, only while an observer subscribes.

    Attributes:
        telemetry_key: Key expression of the telemetry.
    """

    telemetry_key: str

    def telemetry(self) -> Iterable[tuple[str, bytes]]:
        """Return keys and payloads of the telemetry."""


_TELEMETRY_PERIOD_S = 0.5
_RECORDER_BATCH_PERIODS = 8
"""Periods per batch to the recorder: it has no deadline, and each batch costs CPU time in three processes."""


class _Loop:
    def __init__(
        self, process: LogicalProcess, transport: LoopTransport, keys: Keys, deadline_s: float
    ) -> None:
        self.process = process
        self.transport = transport
        self.keys = keys
        self.timeouts = UpstreamTimeouts(process.name, deadline_s, process.tolerated_losses)
        self.present: set[str] = set()
        self.gone: set[str] = set()
        self._checked_s = time.monotonic()
        self._logged_keys: set[str] = set()

    async def wait_for_peers(self) -> None:
        """Wait until every peer has declared its liveliness token, including those gone again.

        The launcher sees to it that all peers come, or ends the run.
        """
        while not self.process.peers <= self.present | self.gone:
            self.dispatch(await self.transport.receive(1.0))

    async def wait_for_watermarks(self, pace: WallClockPace | None) -> None:
        """Receive messages until the needed watermarks are reached or, in real time, the period is due."""
        if pace is None:
            self._checked_s = time.monotonic()
        while (needs := self.process.needs()) is not None:
            missing = self.missing(needs)
            if pace is None:
                if not missing:
                    return
                # every missing upstream still owes one period end at least
                timeout_s = self.timeouts.timeout_s(missing, self.gone)
                await self._receive(missing, timeout_s, len(missing))
            else:
                wait_s = pace.wait_s(self.process.due_ns())
                # receive even when late, or messages would stay unread until the body has caught up
                await self._receive(missing, max(wait_s, 0.0))
                if wait_s <= 0.0:
                    self.process.counters["deadline_misses"] += bool(self.missing(needs))
                    return

    async def _receive(self, missing: list[Upstream], timeout_s: float, min_count: int = 1) -> None:
        """Receive messages for at most `timeout_s` [s]; drop missing upstreams that are gone or silent."""
        before_ns = [up.watermark_ns for up in missing]
        self.dispatch(await self.transport.receive(timeout_s, min_count))
        now_s = time.monotonic()
        passed_s, self._checked_s = now_s - self._checked_s, now_s
        for up, watermark_ns in zip(missing, before_ns, strict=True):
            if up.watermark_ns > watermark_ns:
                self.timeouts.reset(up)
            elif self.timeouts.is_over(up, passed_s, gone=(gone := up.process in self.gone)):
                self.drop_upstream(up, silent=not gone)

    def missing(self, needs: Mapping[str, int]) -> list[Upstream]:
        """Return the live upstreams whose watermark is below the needed time."""
        sources = self.process.upstreams
        return [
            up for name, t_ns in needs.items() if (up := sources[name]).watermark_ns < t_ns and not up.lost
        ]

    def dispatch(self, deliveries: list[Delivery]) -> None:
        """Dispatch deliveries: liveliness changes to the loop, messages to the process."""
        for key, payload in deliveries:
            if payload is None:
                process = key.rsplit("/", 1)[-1]
                self.present.discard(process)
                self.gone.add(process)
            elif payload == b"" and f"/{ALIVE}/" in key:
                self.present.add(key.rsplit("/", 1)[-1])
            else:
                self.accept(key, payload)

    def accept(self, key: str, payload: bytes) -> None:
        """Pass a message to the process; count and drop a malformed one."""
        try:
            row, fields = self.keys.parse(key)
            self.process.accept(row.name, fields, payload)
        except ProtocolError as error:
            self.process.counters["malformed_messages"] += 1
            if key not in self._logged_keys and len(self._logged_keys) < 1000:  # once per source
                self._logged_keys.add(key)
                log.warning("dropped a malformed message on %s: %s", key, error)

    def drop_upstream(self, upstream: Upstream, *, silent: bool) -> None:
        """Continue without an upstream, gone or silent, if its loss is tolerated.

        Raises:
            UpstreamLostError: it is not.
        """
        if upstream.lost:
            return
        upstream.lost = True
        self.process.on_upstream_lost(upstream)
        self.process.counters["lost_upstreams"] += 1
        reason = self.timeouts.silence_text(upstream) if silent else "is gone"
        text = f"{upstream.process} (source of {upstream.name}) {reason}"
        if upstream.process not in self.process.tolerated_losses:
            raise UpstreamLostError(f"{self.process.name}: {text}", upstream.process, silent=silent)
        log.warning("%s; continuing without it", text)
        if silent:
            self.transport.session.put(self.keys.silent(upstream.process), text.encode())


def _claim_name(name: str, session: PublicSession, keys: Keys) -> None:
    """Claim the process name `name` by a liveliness token.

    The token is declared before the others are read: of several simultaneous claimants at most one succeeds,
    and possibly none.

    Raises:
        NameTakenError: another process holds the name.
    """
    own = keys.name_claim(name, uuid.uuid4().hex)
    session.declare_token(own)
    if session.liveliness_tokens(keys.name_claim(name, "*")) - {own}:
        raise NameTakenError(
            f"{name}: a process of this name is already in the loop; names must be unique, "
            f"so this process exits (stop the other one first)"
        )


class _TelemetryPublisher:
    """Telemetry publisher of a process that is a `TelemetrySource`."""

    def __init__(self, process: LogicalProcess, session: PublicSession) -> None:
        self._session = session
        self._source = process if isinstance(process, TelemetrySource) else None
        if self._source is not None:
            self._has_subscribers = session.matching_listener(self._source.telemetry_key)
        self._due_s = time.monotonic()

    def publish_if_due(self) -> None:
        """Publish telemetry if it is due and an observer subscribes."""
        if self._source is None or (now_s := time.monotonic()) < self._due_s:
            return
        self._due_s = now_s + _TELEMETRY_PERIOD_S
        if self._has_subscribers():
            for key, payload in self._source.telemetry():
                self._session.put(key, payload)


async def run_loop(
    process: LogicalProcess,
    transport: LoopTransport,
    keys: Keys,
    *,
    deadline_s: float,
    realtime: bool = False,
    on_period: Callable[[int], None] | None = None,
) -> set[str]:
    """Run the logical process `process` over `transport` until it is finished.

    After each period, `on_period` is called with the simulated time [ns] at which it ended.

    Returns:
        Names of the processes that are still present.

    Raises:
        NameTakenError: a process of this name is in the loop; it is not disturbed.
        UpstreamLostError: an upstream whose loss is not tolerated is gone or silent.
    """
    session = transport.session
    _claim_name(process.name, session, keys)
    transport.subscribe(process.subscriptions, sorted(process.senders | {EXTERNAL}))
    transport.subscribe_liveliness(keys.liveliness("*", "*"))
    if isinstance(process, SubscriptionAware):
        process.use_subscriber_check(transport.has_subscribers)
    session.declare_token(keys.liveliness(process.role, process.name))
    if RECORDER in process.peers:
        transport.enable_recording(_RECORDER_BATCH_PERIODS)
    loop = _Loop(process, transport, keys, deadline_s)
    await loop.wait_for_peers()
    pace = WallClockPace() if realtime and process.follows_wall_clock else None
    reports = _TelemetryPublisher(process, session)
    process.start(transport.put)
    transport.flush()
    while True:
        await loop.wait_for_watermarks(pace)
        if process.needs() is None:
            transport.flush(last=True)
            return loop.present
        due_ns = process.due_ns()
        process.step(transport.put)
        transport.flush()
        if on_period is not None:
            on_period(due_ns)
        for key, payload in process.best_effort_messages():
            session.put(key, payload)
        reports.publish_if_due()
