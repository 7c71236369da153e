"""Recorder process: subscribes to all recorded channels and writes one ordered MCAP file.

Messages of different senders arrive in any order. They are written once the watermark of every sender has
passed their time, sorted by simulated time, then by source (external clients, body, skin, controller,
recorder), then by channel, then in the order in which their sender sent them. So the file does not depend
on how the run was spread over processes.
"""

import os
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from skinnet.channels import OUTSIDE, Keys, Role
from skinnet.deployment import Deployment
from skinnet.deployment.schema import BOARDS
from skinnet.errors import ProtocolError
from skinnet.loop import Put
from skinnet.messages import FOREVER_NS, encode
from skinnet.network.faults import timeline
from skinnet.part import Part
from skinnet.record_messages import Fault
from skinnet.recording.format import RECORDED, expression, recorded_channels
from skinnet.recording.foxglove import Conversion
from skinnet.recording.writer import Writer
from skinnet.skin.placement import place_all
from skinnet.upstream import Upstream

__all__ = ["RecorderNode", "build"]

_CLOSING = ("joints", "stream", "frame", "regions", "command", "fault")
_FRAMES = 5
"""Hyperperiods (`frame_ns`) per write; several of them need fewer wake-ups than one."""
_OPEN = [row.name for row in recorded_channels() if row.name not in (*_CLOSING, "topology")]
_ORDER = ("topology", *_OPEN, *_CLOSING)
"""Channel order at equal time and source; channels that end a period come last."""
_RANK = {name: i for i, name in enumerate(_ORDER)}
_SENDERS = {"world": "body", "state": "controller", "machine": "controller"}


class _Head(msgspec.Struct):
    """Message fields that the recorder needs; all others are skipped in decoding."""

    t_ns: int = 0
    covered_ns: int = 0
    events: int = 0
    id: int = 0
    end_ns: int | None = None


class _Columns(msgspec.Struct):
    """Column of an event message that gives the number of its events."""

    cell: list[int]


_YIELD_EVERY = 20
"""Messages after which the recorder yields the core to waiting processes."""
_yield_core = getattr(os, "sched_yield", lambda: None)
_Held = tuple[int, int, int, int, str, bytes]
"""Pending message as (time [ns], source rank, channel rank, arrival number, key, payload).

The sort order of these tuples is the order of the file.
"""


class RecorderNode:
    """Recorder as a logical process; others wait only for its start and for room in its queue."""

    role = Role.RECORDER.value
    paced = False

    def __init__(self, deployment: Deployment, name: str, writer: Writer, conversion: Conversion) -> None:
        self.name = name
        keys = Keys(deployment.robot)
        self.subscriptions = tuple(
            expression(keys, row) for row in recorded_channels() if row.sender is not Role.RECORDER
        )
        hosts = deployment.host_patches()
        self._body = Upstream("body", "body", covered_ns=-1)
        self._controller = Upstream("controller", "controller")
        self._skin = {patch: Upstream(patch, host) for host, patches in hosts.items() for patch in patches}
        if deployment.sheets:
            self._skin[BOARDS] = Upstream(BOARDS, BOARDS)
        self.upstreams: Mapping[str, Upstream] = {
            "body": self._body,
            "controller": self._controller,
            **self._skin,
        }
        others = {"body", "controller", *deployment.hosts_of_skin()}
        self.senders = frozenset(others)
        self.peers: frozenset[str] = frozenset({name, *others})
        # it tolerates every loss: a process that does not ends the run, and the file shows how far it came
        self.tolerated = frozenset(others)
        self.counters: Counter[str] = Counter()
        patches = [patch.name for patch in deployment.patches]
        sources = [OUTSIDE, "body", *patches, BOARDS, *deployment.host_patches(), "controller", name]
        self._rank = {source: i for i, source in enumerate(sources)}
        self._writer, self._conversion = writer, conversion
        self._window_ns = _FRAMES * deployment.frame_ns
        self._joints_ns, self._control_ns = deployment.body.joints_ns, deployment.controller.period_ns
        self._t_ns, self._end_ns = 0, deployment.max_ns
        self._finished = False
        self._whole = False
        self._keys = keys
        self._keys_of: dict[tuple[str, tuple[str, ...]], str] = {}
        self._held: list[_Held] = []
        self._arrivals = self._handled = 0
        self._events: dict[str, list[tuple[str, str, bytes]]] = {name: [] for name in self._skin}
        self._requests: dict[int, tuple[str, bytes]] = {}
        self._decode = msgspec.msgpack.Decoder(_Head).decode
        self._columns = msgspec.msgpack.Decoder(_Columns).decode
        for fault in _faults(deployment):
            self._hold(fault.t_ns, name, "fault", keys.of("fault"), encode(fault))

    def start(self, put: Put) -> None:
        """Create the file; at this point no other process waits for this one."""
        self._writer.begin()
        self._conversion.begin()
        self._whole = True

    def needs(self) -> dict[str, int] | None:
        """Watermarks required of all upstreams for the next write."""
        if self._finished:
            return None
        until_ns = self._until_ns()
        last = until_ns == self._end_ns
        return dict.fromkeys(self.upstreams, until_ns) | {"body": until_ns + last}

    def due_ns(self) -> int:
        """End of the next span to be written [ns]."""
        return self._until_ns()

    def _until_ns(self) -> int:
        return min(self._t_ns + self._window_ns, self._end_ns)

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept a message of any recorded channel.

        Raises:
            ProtocolError: it cannot be decoded, or its source is not in this run.
        """
        self._give_way()
        key = self._key(channel, fields)
        if channel in ("events", "bundle"):
            self._accept_events(channel, fields[0], key, payload)
            return
        try:
            head = self._decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ProtocolError(f"no message: {error}") from error
        match channel:
            case "frame" | "stream" | "regions":
                self._close(channel, fields[0], key, payload, head)
            case "topology":
                self._source(fields[0]).arrive()
                self._events[fields[0]].append((channel, key, payload))
            case "joints":
                self._hold(head.t_ns, "body", channel, key, payload)
                self._body.close(head.t_ns + self._joints_ns)
            case "command":
                self._hold(head.t_ns, "controller", channel, key, payload)
                over = head.end_ns is not None
                if head.end_ns is not None:
                    self._end_ns = min(self._end_ns, head.end_ns)
                self._controller.close(FOREVER_NS if over else head.t_ns + self._control_ns)
            case "config":
                # a configuration of an external client takes effect on arrival
                source_name = "controller" if head.t_ns else OUTSIDE
                self._hold(head.t_ns or self._t_ns, source_name, channel, key, payload)
            case "request":
                self._requests[head.id] = (key, payload)
            case "answer":
                asked = self._requests.pop(head.id, None)
                if asked is not None:
                    self._hold(head.t_ns, OUTSIDE, "request", *asked)
                self._hold(head.t_ns, "controller", channel, key, payload)
            case "counters":
                self._hold(head.t_ns, fields[0], channel, key, payload)
            case _:
                self._hold(head.t_ns, _SENDERS[channel], channel, key, payload)

    def _accept_events(self, channel: str, patch: str, key: str, payload: bytes) -> None:
        """Keep events until the period end of their patch, which gives them their time; so for topologies."""
        source = self._source(patch)
        try:
            count = len(self._columns(payload).cell)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ProtocolError(f"no events: {error}") from error
        self._events[patch].append((channel, key, payload))
        source.arrive(count)

    def _close(self, channel: str, source: str, key: str, payload: bytes, head: _Head) -> None:
        upstream = self._source(source)
        for event in self._events[source]:
            self._hold(head.t_ns, source, *event)
        self._events[source].clear()
        self._hold(head.t_ns, source, channel, key, payload)
        upstream.close(head.covered_ns, head.events)

    def _source(self, name: str) -> Upstream:
        upstream = self._skin.get(name)
        if upstream is None:
            raise ProtocolError(f"skin of {name}, which is not in this run")
        return upstream

    def _key(self, channel: str, fields: tuple[str, ...]) -> str:
        key = self._keys_of.get((channel, fields))
        if key is None:
            key = self._keys_of[channel, fields] = self._keys.of(channel, *fields)
        return key

    def _hold(self, t_ns: int, source: str, channel: str, key: str, payload: bytes) -> None:
        rank = self._rank.get(source)
        if rank is None:
            raise ProtocolError(f"{channel} of {source}, which is not in this run")
        self._arrivals += 1
        self._held.append((t_ns, rank, _RANK[channel], self._arrivals, key, payload))

    def lose(self, upstream: Upstream) -> None:
        """Continue to record the other processes."""

    def step(self, put: Put) -> None:
        """Write the messages of the next span."""
        until_ns = self._until_ns()
        self._finished = until_ns == self._end_ns
        if self._finished:
            self.end()
        else:
            self._held.sort()
            self._write(bisect_left(self._held, (until_ns,)), until_ns)

    def _write(self, count: int, until_ns: int) -> None:
        """Write the first `count` pending messages, and the Foxglove messages due before `until_ns`."""
        self._whole = False
        for t_ns, _, channel, _, key, payload in self._held[:count]:
            self._give_way()
            self._conversion.see(_ORDER[channel], key, t_ns, payload)
            self._writer.add(key, t_ns, payload)
        del self._held[:count]
        self._conversion.go_to(until_ns)
        self._writer.settle()
        self._t_ns = until_ns
        self._whole = True

    def end(self) -> None:
        """Finish the file with its summary, once; leave a file whose write was interrupted without one."""
        if self._whole:
            end_ns = min(self._end_ns, max(self._body.covered_ns, self._t_ns))
            self._rest(end_ns)
            self._write(len(self._held), end_ns)
            self._whole = False
            self._writer.finish()

    def _give_way(self) -> None:
        """Yield the core every `_YIELD_EVERY` messages, to processes on which the whole run waits."""
        self._handled += 1
        if self._handled % _YIELD_EVERY == 0:
            _yield_core()

    def _rest(self, t_ns: int) -> None:
        """Add events without period end and requests without answer; drop messages later than `t_ns`."""
        self._held = [held for held in self._held if held[0] <= t_ns]
        for name, events in self._events.items():
            for event in events:
                self._hold(self._skin[name].covered_ns, name, *event)
        for request in self._requests.values():
            self._hold(t_ns, OUTSIDE, "request", *request)
        self._held.sort()

    def news(self) -> tuple[()]:
        """Publish nothing."""
        return ()

    def result(self) -> Part:
        """Message count of each recorded channel, and file size [bytes]."""
        facts: dict[str, Any] = {
            "logs": {},
            "end_ns": self._t_ns,
            "messages": {row.name: self._writer.counts[row.name] for row in recorded_channels()},
            "bytes": self._writer.n_bytes,
        }
        return Part(self.name, self.role, facts)


def _faults(deployment: Deployment) -> Iterator[Fault]:
    """Fault events of a run: begin and end of every scheduled fault."""
    placed = place_all(deployment.patches, deployment.cells, deployment.bridges)
    for span in timeline(deployment, placed):
        for t_ns, begins in ((span.t_ns, True), (span.until_ns, False)):
            if t_ns <= deployment.max_ns:
                yield Fault(t_ns=t_ns, rule=span.index, kind=span.kind, target=span.target, begins=begins)


def build(deployment: Deployment, name: str, base: Path, out: Path | None) -> RecorderNode:
    """Build the recorder process, which writes into the run folder `out`."""
    assert out is not None, "a recorder without a run folder"
    writer = Writer(out / RECORDED, deployment, base)
    return RecorderNode(deployment, name, writer, Conversion(deployment, base, writer))
