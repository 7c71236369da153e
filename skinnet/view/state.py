"""Run state reconstructed from messages, for display. No I/O and no clock."""

import bisect
import copy
from array import array
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np

from skinnet.deployment.schema import BOARDS, Deployment
from skinnet.deployment.session import StateName
from skinnet.errors import ProtocolError
from skinnet.messages import (
    Answer,
    Command,
    ControllerState,
    EventKind,
    Events,
    Joints,
    Message,
    Modality,
    Stream,
    Topology,
)
from skinnet.network.records import Outcome
from skinnet.record_messages import Counters, World
from skinnet.sheet_messages import Regions
from skinnet.view.atlas import Atlas
from skinnet.view.happenings import FULL_READING, Happenings, Trends
from skinnet.view.machinery import Machinery
from skinnet.view.mind import Mind
from skinnet.view.network_state import NetworkState
from skinnet.view.sequence import Numbering
from skinnet.view.skin_state import SkinState
from skinnet.watch_messages import LinkLoad, Machine, ProcessLoad

__all__ = ["RASTER_NS", "TRENDS_NS", "Kept", "Scene", "Told"]

RASTER_NS = 10_000_000_000
"""Time span of the event raster [ns]."""
TRENDS_NS = 60_000_000_000
"""Time span of the charts [ns]."""
_BIN_NS = 250_000_000
_NO_LEVEL = 7
_LOSSES = {outcome.name.lower() for outcome in Outcome} - {Outcome.DELIVERED.name.lower()}
_STREAM_EVERY_NS = 50_000_000
"""Shortest time between two raster entries of a streaming cell [ns]."""
_PRESSED_KPA = (1.0, 5.0, 20.0, 60.0)
"""Peak pressures [kPa] at which a region counts as level 1 to 4 in the raster *(assumed)*."""


_MOST_PACKETS = 1_000_000
"""Maximum number of packets that wait for `digest`."""


class Told(NamedTuple):
    """Received message with its channel, key fields and simulated time [ns]."""

    channel: str
    fields: tuple[str, ...]
    message: Message
    t_ns: int


class Kept(NamedTuple):
    """State snapshot for seeking; opaque."""

    t_ns: int
    parts: tuple[Any, ...]


class Scene:
    """Run state: the newest published values.

    Attributes:
        t_ns: Newest simulated time of a message [ns].
        position_rad: Newest positions of the controlled joints [rad]; the home position before the first.
        world: Poses (7,) of free bodies, by name.
        skin: Skin readings.
        network: Topology and link loads.
        mind: Controller state.
        machinery: Process statistics.
        happenings: Event history.
        trends: Time series of latency and loss.
        missed: Messages lost between run and page, by sequence numbers.
        malformed: Number of invalid messages.
        last_refusal: Error of the last invalid message.
        answer: Controller's last answer to a request.
    """

    def __init__(self, deployment: Deployment, atlas: Atlas) -> None:
        self._deployment, self._atlas = deployment, atlas
        body = deployment.body
        self.t_ns = 0
        self.position_rad = [body.home_rad.get(joint, 0.0) for joint in body.joints]
        self.world: dict[str, list[float]] = {}
        self.skin = SkinState(atlas)
        self.network = NetworkState(atlas, deployment.network)
        self.mind = Mind(_states(deployment))
        self.machinery = Machinery()
        self.happenings = Happenings(RASTER_NS)
        self.trends = Trends(_BIN_NS, TRENDS_NS // _BIN_NS)
        self.missed = 0
        self.malformed = 0
        self.last_refusal = ""
        self.answer: Answer | None = None
        self._host = {patch: host for host, patches in deployment.host_patches().items() for patch in patches}
        self._numbers: dict[str, Numbering] = defaultdict(Numbering)
        self._packets = array("q"), array("q")
        self._lost: dict[str, int] = {}
        self._streamed_ns = np.full(atlas.n_cells, -_STREAM_EVERY_NS)

    def take(self, told: Told, now_s: float) -> None:
        """Apply a message received at wall time `now_s` [s]; count it as malformed if it is invalid."""
        try:
            self._take(told, now_s)
        except (ProtocolError, IndexError, ValueError) as error:  # values from outside are unchecked
            self.refuse(f"{told.channel}: {error}")
            return
        self.t_ns = max(self.t_ns, told.t_ns)

    def refuse(self, why: str) -> None:
        """Count an invalid message."""
        self.malformed += 1
        self.last_refusal = why

    def keep(self) -> Kept:
        """Snapshot of the present state, without histories."""
        parts = self.position_rad, self.world, self.skin, self.network, self.mind
        return Kept(self.t_ns, copy.deepcopy(parts))

    def recall(self, kept: Kept) -> None:
        """Restore a snapshot; clear the histories."""
        parts = copy.deepcopy(kept.parts)
        self.position_rad, self.world, self.skin, self.network, self.mind = parts
        self.t_ns = kept.t_ns
        self.happenings.clear()
        self.trends.clear()
        self._numbers.clear()
        self._lost.clear()
        self._streamed_ns[:] = -_STREAM_EVERY_NS
        self._packets = array("q"), array("q")
        self.missed = 0

    def _take(self, told: Told, now_s: float) -> None:
        match told.message:
            case Events() as events:
                self._take_events(events)
            case Joints() as joints:
                self._take_joints(joints)
                self.machinery.note("body", told.t_ns, now_s)
            case Stream() as stream:
                self._take_stream(stream)
                self.machinery.note(self._host[stream.patch], told.t_ns, now_s)
            case Regions() as regions:
                self._take_regions(regions)
                self.machinery.note(BOARDS, told.t_ns, now_s)
            case Topology() as topology:
                lost, _ = self.network.take_topology(topology)
                self.skin.lose(lost)
                self.skin.settle(self.network.found)
            case ControllerState() as said:
                self.mind.take_state(said)
                self.machinery.note("controller", told.t_ns, now_s)
            case Command() as command:
                self.mind.take_stage(command.t_ns, command.stage)
                self.machinery.note("controller", told.t_ns, now_s)
            case LinkLoad() as load:
                self.trends.dropped(load.t_ns, self.network.take_load(load))
                self.machinery.note(self._host[load.patch], told.t_ns, now_s)
            case ProcessLoad() as usage:
                self.machinery.take_load(usage)
            case Machine() as machine:
                self.mind.machine = machine
            case Answer() as answer:
                self.answer = answer
            case World() as world:
                self.world = self.world | world.poses
            case Counters() as counters:
                self._take_counters(counters)

    def _take_joints(self, joints: Joints) -> None:
        if len(joints.position_rad) != len(self.position_rad):
            raise ProtocolError(
                f"joints of {len(joints.position_rad)} angles; this robot has {len(self.position_rad)}"
            )
        self.position_rad = joints.position_rad

    def _take_counters(self, counters: Counters) -> None:
        """Apply a cell process's counters: losses, unless link loads are published."""
        if self.network.measured_ns >= 0:
            return
        lost = sum(n for name, n in counters.counts.items() if name.rpartition(".")[2] in _LOSSES)
        before = self._lost.get(counters.host)
        self._lost[counters.host] = lost
        if before is not None:
            self.trends.dropped(counters.t_ns, max(lost - before, 0))

    def digest(self) -> None:
        """Update losses, time series and inferred loads, which need not follow each message."""
        missed = sum(numbering.settle() for numbering in self._numbers.values())
        self.trends.missed(self.t_ns, max(missed - self.missed, 0))
        self.missed = missed
        sampled, delivered = (np.array(column, dtype=np.int64) for column in self._packets)
        self._packets = array("q"), array("q")
        self.trends.delivered(sampled, delivered)
        self.network.infer(self.t_ns)
        self.happenings.tidy()

    def _take_events(self, events: Events) -> None:
        self.skin.take_events(events)
        self._numbers[events.patch].take(events.seq)
        start = self._atlas.first[events.patch]
        rows = [start + cell for cell in events.cell]
        kinds = [
            8 * modality + (level if kind == EventKind.LEVEL else _NO_LEVEL)
            for modality, kind, level in zip(events.modality, events.kind, events.level, strict=True)
        ]
        self.happenings.add(events.t_delivered_ns, rows, kinds)
        self._note_packets(events.t_sampled_ns, events.t_delivered_ns)
        n_bytes = self._deployment.network.event_bytes
        self.network.note_delivered(events.t_delivered_ns[-1], rows, n_bytes)

    def _take_stream(self, stream: Stream) -> None:
        rows = self.skin.take_stream(stream)
        if not len(rows):
            return
        self._numbers[stream.patch].take(rows["seq"].tolist())
        self._note_packets(rows["t_sampled_ns"].tolist(), rows["t_delivered_ns"].tolist())
        cells = self._atlas.first[stream.patch] + rows["cell"].astype(np.int64)
        n_bytes = self._deployment.network.stream_bytes
        self.network.note_delivered(int(rows["t_delivered_ns"][-1]), cells.tolist(), n_bytes)
        seldom = rows["t_delivered_ns"] - self._streamed_ns[cells] >= _STREAM_EVERY_NS
        if seldom.any():
            t_ns = rows["t_delivered_ns"][seldom]
            self._streamed_ns[cells[seldom]] = t_ns
            self.happenings.add(t_ns.tolist(), cells[seldom].tolist(), [FULL_READING] * len(t_ns))

    def _take_regions(self, regions: Regions) -> None:
        frames = self.skin.take_regions(regions)
        self._numbers[BOARDS].take(range(regions.seq, regions.seq + len(frames)))
        if not frames:
            return
        sampled, delivered, _, _ = zip(*frames, strict=True)
        self._note_packets(sampled, delivered)
        pressed = [frame for frame in frames if frame[3] > 0.0]
        self.happenings.add(
            [t_ns for _, t_ns, _, _ in pressed],
            [self._atlas.n_cells + board for _, _, board, _ in pressed],
            [
                8 * int(Modality.FORCE) + bisect.bisect(_PRESSED_KPA, peak_kpa)
                for _, _, _, peak_kpa in pressed
            ],
        )

    def _note_packets(self, t_sampled_ns: Sequence[int], t_delivered_ns: Sequence[int]) -> None:
        self._packets[0].extend(t_sampled_ns)
        self._packets[1].extend(t_delivered_ns)
        if len(self._packets[0]) > _MOST_PACKETS:
            del self._packets[0][: _MOST_PACKETS // 2], self._packets[1][: _MOST_PACKETS // 2]


def _states(deployment: Deployment) -> Iterator[str]:
    """State names of a program of stages, as its controller names them."""
    control = deployment.controller
    if control.program:
        yield "forming"
    for stage in control.program:
        if control.stages[stage].kind == "session":
            yield from (f"{stage}.{state}" for state in get_args(StateName))
        else:
            yield stage
