"""Recorder process: subscribes to all recorded channels and writes one ordered MCAP file.

Messages of different senders arrive in any order. They are written once the watermark of every sender has
passed their time, sorted by simulated time, then by source (external clients, body, skin, controller,
recorder), then by channel, then in the order in which their sender sent them. So the file does not depend
on how the run was spread over processes.
"""

import os
from bisect import bisect_left
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.errors import ProtocolError
from skinnet.network.faults.fault_schedule import fault_schedule
from skinnet.protocol.channels import BODY, CONTROLLER, EXTERNAL, Keys, Role
from skinnet.protocol.channels import channel as channel_of
from skinnet.protocol.messages import FOREVER_NS, decode, encode, header
from skinnet.protocol.recorded_messages import FaultEvent
from skinnet.recording.format import FILE_NAME, recorded_channels
from skinnet.recording.foxglove import FoxgloveConverter
from skinnet.recording.writer import RecordingWriter
from skinnet.runtime.loop import Put
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.runtime.wiring import WiredProcess, wiring_of
from skinnet.skin.placement import place_patches

__all__ = ["RecorderProcess", "build"]

_PERIOD_END_CHANNELS = ("joints", "stream", "period_end", "regions", "command", "fault")
_HYPERPERIODS_PER_WRITE = 5
"""Hyperperiods (`hyperperiod_ns`) per write; several of them need fewer wake-ups than one."""
_OTHER_CHANNELS = [
    row.name for row in recorded_channels() if row.name not in (*_PERIOD_END_CHANNELS, "topology")
]
_CHANNEL_ORDER = ("topology", *_OTHER_CHANNELS, *_PERIOD_END_CHANNELS)
"""Channel order at equal time and source; channels that end a period come last."""
_CHANNEL_RANK = {name: i for i, name in enumerate(_CHANNEL_ORDER)}
_SENDER_NAMES = {None: EXTERNAL, Role.BODY: BODY, Role.CONTROLLER: CONTROLLER}
"""Names of the senders of which a run has one."""
_FREQUENT_CHANNELS = {
    name: header(channel_of(name).message, *fields)
    for name, fields in {
        "events": ("patch", "cell"),
        "bundle": ("patch", "cell"),
        "stream": ("patch", "t_ns", "watermark_ns", "n_events"),
        "period_end": ("patch", "t_ns", "watermark_ns", "n_events"),
    }.items()
}
"""Types by which messages of the cells are decoded: only the fields that the recorder needs."""


_MESSAGES_PER_YIELD = 20
"""Messages after which the recorder yields the core to waiting processes."""
_sched_yield = getattr(os, "sched_yield", lambda: None)
_PendingMessage = tuple[int, int, int, int, str, bytes]
"""Pending message as (time [ns], source rank, channel rank, arrival number, key, payload).

The sort order of these tuples is the order of the file.
"""


class RecorderProcess(WiredProcess):
    """Recorder as a logical process; others wait only for its start and for room in its queue."""

    def __init__(
        self, deployment: Deployment, name: str, writer: RecordingWriter, conversion: FoxgloveConverter
    ) -> None:
        super().__init__(wiring_of(deployment, name))
        keys = Keys(deployment.robot)
        self._skin = dict(self.upstreams)
        self._body, self._controller = self._skin.pop(BODY), self._skin.pop(CONTROLLER)
        patches = [patch.name for patch in deployment.patches]
        processes = deployment.patches_by_process()
        sources = [EXTERNAL, BODY, *patches, BOARD_PROCESS, *processes, CONTROLLER, name]
        self._rank = {source: i for i, source in enumerate(sources)}
        self._writer, self._converter = writer, conversion
        self._span_ns = _HYPERPERIODS_PER_WRITE * deployment.hyperperiod_ns
        self._joints_ns, self._control_ns = (
            deployment.body.joint_state_period_ns,
            deployment.controller.period_ns,
        )
        self._t_ns, self._end_ns = 0, deployment.max_duration_ns
        self._finished = False
        self._file_consistent = False
        self._keys = keys
        self._key_cache: dict[tuple[str, tuple[str, ...]], str] = {}
        self._pending: list[_PendingMessage] = []
        self._n_arrivals = self._n_handled = 0
        self._events: dict[str, list[tuple[str, str, bytes]]] = {name: [] for name in self._skin}
        self._requests: dict[int, tuple[str, bytes]] = {}
        for fault in _fault_events(deployment):
            self._enqueue(fault.t_ns, name, "fault", keys.of("fault"), encode(fault))

    def start(self, put: Put) -> None:
        """Create the file; at this point no other process waits for this one."""
        self._writer.open()
        self._converter.declare_topics()
        self._file_consistent = True

    def needs(self) -> dict[str, int] | None:
        """Watermarks required of all upstreams for the next write."""
        if self._finished:
            return None
        until_ns = self._span_end_ns()
        last = until_ns == self._end_ns
        return dict.fromkeys(self.upstreams, until_ns) | {BODY: until_ns + last}

    def due_ns(self) -> int:
        """End of the next span to be written [ns]."""
        return self._span_end_ns()

    def _span_end_ns(self) -> int:
        return min(self._t_ns + self._span_ns, self._end_ns)

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept a message of any recorded channel.

        Raises:
            ProtocolError: it cannot be decoded, or its source is not in this run.
        """
        self._yield_core()
        row = channel_of(channel)
        if not row.recorded:
            raise ProtocolError(f"the recorder does not read {channel}")
        message: Any = decode(payload, _FREQUENT_CHANNELS.get(channel, row.message))
        key = self._key(channel, fields)
        match channel:
            case "events" | "bundle":
                self._skin_upstream(fields[0]).count_arrivals(len(message.cell))
                self._events[fields[0]].append((channel, key, payload))
            case "topology":
                self._skin_upstream(fields[0]).count_arrivals()
                self._events[fields[0]].append((channel, key, payload))
            case "period_end" | "stream" | "regions":
                self._end_period(channel, fields[0], key, payload, message)
            case "joints":
                self._enqueue(message.t_ns, BODY, channel, key, payload)
                self._body.end_period(message.t_ns + self._joints_ns)
            case "command":
                over = message.end_ns is not None
                if over:
                    _require_time(message.end_ns)
                self._enqueue(message.t_ns, CONTROLLER, channel, key, payload)
                if over:
                    self._end_ns = min(self._end_ns, message.end_ns)
                self._controller.end_period(FOREVER_NS if over else message.t_ns + self._control_ns)
            case "config":
                # a configuration of an external client takes effect on arrival
                source_name = CONTROLLER if message.t_ns else EXTERNAL
                self._enqueue(message.t_ns or self._t_ns, source_name, channel, key, payload)
            case "request":
                self._requests[message.id] = (key, payload)
            case "answer":
                asked = self._requests.pop(message.id, None)
                if asked is not None:
                    self._enqueue(message.t_ns, EXTERNAL, "request", *asked)
                self._enqueue(message.t_ns, CONTROLLER, channel, key, payload)
            case "counters":
                self._enqueue(message.t_ns, fields[0], channel, key, payload)
            case _:  # a message without a time, of an external client, counts from its arrival
                source_name = _SENDER_NAMES.get(row.sender, self.name)
                self._enqueue(getattr(message, "t_ns", self._t_ns), source_name, channel, key, payload)

    def _end_period(self, channel: str, source: str, key: str, payload: bytes, message: Any) -> None:
        """End a period of a source, which gives its events and topologies their time."""
        upstream = self._skin_upstream(source)
        for t_ns in (message.t_ns, message.watermark_ns):
            _require_time(t_ns)
        for event in self._events[source]:
            self._enqueue(message.t_ns, source, *event)
        self._events[source].clear()
        self._enqueue(message.t_ns, source, channel, key, payload)
        upstream.end_period(message.watermark_ns, getattr(message, "n_events", 0))

    def _skin_upstream(self, name: str) -> Upstream:
        upstream = self._skin.get(name)
        if upstream is None:
            raise ProtocolError(f"message of unknown patch or board {name!r}")
        return upstream

    def _key(self, channel: str, fields: tuple[str, ...]) -> str:
        key = self._key_cache.get((channel, fields))
        if key is None:
            key = self._key_cache[channel, fields] = self._keys.of(channel, *fields)
        return key

    def _enqueue(self, t_ns: int, source: str, channel: str, key: str, payload: bytes) -> None:
        rank = self._rank.get(source)
        if rank is None:
            raise ProtocolError(f"{channel} of unknown source {source!r}")
        _require_time(t_ns)
        self._n_arrivals += 1
        self._pending.append((t_ns, rank, _CHANNEL_RANK[channel], self._n_arrivals, key, payload))

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Continue to record the other processes."""

    def step(self, put: Put) -> None:
        """Write the messages of the next span."""
        until_ns = self._span_end_ns()
        self._finished = until_ns == self._end_ns
        if self._finished:
            self.close()
        else:
            self._pending.sort()
            self._write(bisect_left(self._pending, (until_ns,)), until_ns)

    def _write(self, count: int, until_ns: int) -> None:
        """Write the first `count` pending messages, and the Foxglove messages due before `until_ns`."""
        self._file_consistent = False
        for t_ns, _, channel, _, key, payload in self._pending[:count]:
            self._yield_core()
            self._converter.convert(_CHANNEL_ORDER[channel], key, t_ns, payload)
            self._writer.add(key, t_ns, payload)
        del self._pending[:count]
        self._converter.write_until(until_ns)
        self._writer.flush_if_due()
        self._t_ns = until_ns
        self._file_consistent = True

    def close(self) -> None:
        """Finish the file with its summary, once; leave a file whose write was interrupted without one."""
        if self._file_consistent:
            end_ns = min(self._end_ns, max(self._body.watermark_ns, self._t_ns))
            self._enqueue_unfinished(end_ns)
            self._write(len(self._pending), end_ns)
            self._file_consistent = False
            self._writer.close()

    def _yield_core(self) -> None:
        """Yield the core every `_MESSAGES_PER_YIELD` messages, to processes on which the whole run waits."""
        self._n_handled += 1
        if self._n_handled % _MESSAGES_PER_YIELD == 0:
            _sched_yield()

    def _enqueue_unfinished(self, t_ns: int) -> None:
        """Add events without period end and requests without answer; drop messages later than `t_ns`."""
        self._pending = [held for held in self._pending if held[0] <= t_ns]
        for name, events in self._events.items():
            for event in events:
                self._enqueue(self._skin[name].watermark_ns, name, *event)
        for request in self._requests.values():
            self._enqueue(t_ns, EXTERNAL, "request", *request)
        self._pending.sort()

    def best_effort_messages(self) -> tuple[()]:
        """Publish nothing."""
        return ()

    def result(self) -> ProcessResult:
        """Message count of each recorded channel, and file size [bytes]."""
        if self._converter.n_unreadable:
            self.counters["unreadable_messages"] = self._converter.n_unreadable
        facts: dict[str, Any] = {
            "logs": {},
            "end_ns": self._t_ns,
            "messages": {row.name: self._writer.counts[row.name] for row in recorded_channels()},
            "bytes": self._writer.n_bytes,
        }
        return ProcessResult(self.name, self.role, facts)


def _require_time(t_ns: int) -> None:
    """Require a simulated time that a recording can hold.

    Raises:
        ProtocolError: it is negative, or beyond any run.
    """
    if not 0 <= t_ns <= FOREVER_NS:
        raise ProtocolError(f"t_ns is {t_ns}; it must be from 0 to {FOREVER_NS}")


def _fault_events(deployment: Deployment) -> Iterator[FaultEvent]:
    """Fault events of a run: begin and end of every scheduled fault."""
    placed = place_patches(deployment.patches, deployment.cells, deployment.bridges)
    for span in fault_schedule(deployment, placed):
        for t_ns, begins in ((span.t_ns, True), (span.until_ns, False)):
            if t_ns <= deployment.max_duration_ns:
                yield FaultEvent(
                    t_ns=t_ns, rule=span.index, kind=span.kind, target=span.target, begins=begins
                )


def build(
    deployment: Deployment, name: str, base: Path, out: Path | None, *, recorded: bool = True
) -> RecorderProcess:
    """Build the recorder process, which writes into the run folder `out`."""
    assert out is not None, "a recorder needs a run folder"
    writer = RecordingWriter(out / FILE_NAME, deployment, base)
    return RecorderProcess(deployment, name, writer, FoxgloveConverter(deployment, base, writer))
