"""Run state reconstructed from messages, for display. No I/O and no clock."""

import bisect
import copy
from array import array
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from skinnet.deployment.deployment import BOARD_PROCESS, Deployment
from skinnet.errors import ProtocolError
from skinnet.network.records import Outcome
from skinnet.protocol.messages import (
    INVALID_CONTENT,
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
from skinnet.protocol.recorded_messages import Counters, FreeBodyPoses
from skinnet.protocol.sheet_messages import Regions
from skinnet.protocol.states import CONFIGURABLE_STATES, FORMING
from skinnet.protocol.telemetry_messages import LinkLoad, ProcessLoad, StateMachineDescription
from skinnet.view.state.controller_view import ControllerView
from skinnet.view.state.event_history import FULL_READING_KIND, EventHistory, TrafficStatistics
from skinnet.view.state.network_state import NetworkState
from skinnet.view.state.process_stats import ProcessStats
from skinnet.view.state.sequence_gaps import SequenceGaps
from skinnet.view.state.skin_layout import SkinLayout
from skinnet.view.state.skin_state import SkinState

__all__ = ["CHARTS_NS", "RASTER_NS", "ReceivedMessage", "RunSnapshot", "RunState"]

RASTER_NS = 10_000_000_000
"""Time span of the event raster [ns]."""
CHARTS_NS = 60_000_000_000
"""Time span of the charts [ns]."""
_BIN_NS = 250_000_000
_POSE_LENGTH = 7
_NO_LEVEL = 7
_LOSS_OUTCOMES = {outcome.name.lower() for outcome in Outcome} - {Outcome.DELIVERED.name.lower()}
_RASTER_PERIOD_NS = 50_000_000
"""Shortest time between two raster entries of a streaming cell [ns]."""
_PRESSURE_LEVELS_KPA = (1.0, 5.0, 20.0, 60.0)
"""Peak pressures [kPa] at which a region counts as level 1 to 4 in the raster *(assumed)*."""


_MAX_PENDING_PACKETS = 1_000_000
"""Maximum number of packets that wait for `update_statistics`."""


class ReceivedMessage(NamedTuple):
    """Received message with its channel, key fields and simulated time [ns]."""

    channel: str
    fields: tuple[str, ...]
    message: Message
    t_ns: int


class RunSnapshot(NamedTuple):
    """State snapshot for seeking; opaque."""

    t_ns: int
    parts: tuple[Any, ...]


class RunState:
    """Run state: the newest published values.

    Attributes:
        t_ns: Newest simulated time of a message [ns].
        position_rad: Newest positions of the controlled joints [rad]; the home position before the first.
        free_body_poses: Poses (7,) of free bodies, by name.
        skin: Skin readings.
        network: Topology and link loads.
        controller: Controller state.
        processes: Process statistics.
        events: Event history.
        traffic: Time series of latency and loss.
        n_missed: Messages lost between run and page, by sequence numbers.
        n_malformed: Number of invalid messages.
        last_error: Error of the last invalid message.
        last_answer: Controller's last answer to a request.
    """

    def __init__(self, deployment: Deployment, layout: SkinLayout) -> None:
        self._deployment, self._layout = deployment, layout
        body = deployment.body
        self.t_ns = 0
        self.position_rad = [body.home_rad.get(joint, 0.0) for joint in body.joints]
        self.free_body_poses: dict[str, list[float]] = {}
        self.skin = SkinState(layout)
        self.network = NetworkState(layout, deployment.network)
        self.controller = ControllerView(_state_names(deployment))
        self.processes = ProcessStats()
        self.events = EventHistory(RASTER_NS)
        self.traffic = TrafficStatistics(_BIN_NS, CHARTS_NS // _BIN_NS)
        self.n_missed = 0
        self.n_malformed = 0
        self.last_error = ""
        self.last_answer: Answer | None = None
        self._process_of_patch = {
            patch: host for host, patches in deployment.patches_by_process().items() for patch in patches
        }
        self._sequence_gaps: dict[str, SequenceGaps] = defaultdict(SequenceGaps)
        self._pending_packets = array("q"), array("q")
        self._lost: dict[str, int] = {}
        self._streamed_ns = np.full(layout.n_cells, -_RASTER_PERIOD_NS)

    def apply(self, received: ReceivedMessage, now_s: float) -> None:
        """Apply a message received at wall time `now_s` [s]; count it as malformed if it is invalid."""
        try:
            self._apply(received, now_s)
        except INVALID_CONTENT as error:  # values from outside are unchecked
            self.count_malformed(f"{received.channel}: {error}")
            return
        self.t_ns = max(self.t_ns, received.t_ns)

    def count_malformed(self, reason: str) -> None:
        """Count an invalid message."""
        self.n_malformed += 1
        self.last_error = reason

    def snapshot(self) -> RunSnapshot:
        """Snapshot of the present state, without histories."""
        parts = self.position_rad, self.free_body_poses, self.skin, self.network, self.controller
        return RunSnapshot(self.t_ns, copy.deepcopy(parts))

    def restore(self, snapshot: RunSnapshot) -> None:
        """Restore a snapshot; clear the histories."""
        parts = copy.deepcopy(snapshot.parts)
        self.position_rad, self.free_body_poses, self.skin, self.network, self.controller = parts
        self.t_ns = snapshot.t_ns
        self.events.clear()
        self.traffic.clear()
        self._sequence_gaps.clear()
        self._lost.clear()
        self._streamed_ns[:] = -_RASTER_PERIOD_NS
        self._pending_packets = array("q"), array("q")
        self.n_missed = 0

    def _apply(self, received: ReceivedMessage, now_s: float) -> None:
        match received.message:
            case Events() as events:
                self._apply_events(events)
            case Joints() as joints:
                self._apply_joints(joints)
                self.processes.on_message("body", received.t_ns, now_s)
            case Stream() as stream:
                self._apply_stream(stream)
                self.processes.on_message(self._process_of_patch[stream.patch], received.t_ns, now_s)
            case Regions() as regions:
                self._apply_regions(regions)
                self.processes.on_message(BOARD_PROCESS, received.t_ns, now_s)
            case Topology() as topology:
                lost, _ = self.network.apply_topology(topology)
                self.skin.mark_unknown(lost)
                self.skin.mark_silent_as_zero(self.network.connected)
            case ControllerState() as said:
                self.controller.apply_state(said)
                self.processes.on_message("controller", received.t_ns, now_s)
            case Command() as command:
                self.controller.apply_stage(command.t_ns, command.stage)
                self.processes.on_message("controller", received.t_ns, now_s)
            case LinkLoad() as load:
                self.traffic.add_dropped(load.t_ns, self.network.apply_load(load))
                self.processes.on_message(self._process_of_patch[load.patch], received.t_ns, now_s)
            case ProcessLoad() as usage:
                self.processes.apply_load(usage)
            case StateMachineDescription() as machine:
                self.controller.description = machine
            case Answer() as answer:
                self.last_answer = answer
            case FreeBodyPoses() as world:
                self._apply_free_bodies(world)
            case Counters() as counters:
                self._apply_counters(counters)

    def _apply_joints(self, joints: Joints) -> None:
        if len(joints.position_rad) != len(self.position_rad):
            raise ProtocolError(
                f"{len(joints.position_rad)} joint positions; this robot has {len(self.position_rad)} joints"
            )
        self.position_rad = joints.position_rad

    def _apply_free_bodies(self, world: FreeBodyPoses) -> None:
        if any(len(pose) != _POSE_LENGTH for pose in world.poses.values()):
            raise ProtocolError(f"poses of free bodies have {_POSE_LENGTH} numbers")
        self.free_body_poses = self.free_body_poses | world.poses

    def _apply_counters(self, counters: Counters) -> None:
        """Apply a cell process's counters: losses, unless link loads are published."""
        if self.network.measured_ns >= 0:
            return
        lost = sum(n for name, n in counters.counts.items() if name.rpartition(".")[2] in _LOSS_OUTCOMES)
        before = self._lost.get(counters.process)
        self._lost[counters.process] = lost
        if before is not None:
            self.traffic.add_dropped(counters.t_ns, max(lost - before, 0))

    def update_statistics(self) -> None:
        """Update losses, time series and inferred loads, which need not follow each message."""
        missed = sum(numbering.count_missing() for numbering in self._sequence_gaps.values())
        self.traffic.add_missed(self.t_ns, max(missed - self.n_missed, 0))
        self.n_missed = missed
        sampled, delivered = (np.array(column, dtype=np.int64) for column in self._pending_packets)
        self._pending_packets = array("q"), array("q")
        self.traffic.add_delivered(sampled, delivered)
        self.network.infer_loads(self.t_ns)
        self.events.drop_old()

    def _apply_events(self, events: Events) -> None:
        self.skin.apply_events(events)
        self._sequence_gaps[events.patch].add(events.seq)
        start = self._layout.first_taxel[events.patch]
        rows = [start + cell for cell in events.cell]
        kinds = [
            8 * modality + (level if kind == EventKind.LEVEL_CROSSING else _NO_LEVEL)
            for modality, kind, level in zip(events.modality, events.kind, events.level, strict=True)
        ]
        self.events.add(events.t_delivered_ns, rows, kinds)
        self._add_packets(events.t_sampled_ns, events.t_delivered_ns)
        n_bytes = self._deployment.network.event_bytes
        self.network.on_delivered(events.t_delivered_ns[-1], rows, n_bytes)

    def _apply_stream(self, stream: Stream) -> None:
        rows = self.skin.apply_stream(stream)
        if not len(rows):
            return
        self._sequence_gaps[stream.patch].add(rows["seq"].tolist())
        self._add_packets(rows["t_sampled_ns"].tolist(), rows["t_delivered_ns"].tolist())
        cells = self._layout.first_taxel[stream.patch] + rows["cell"].astype(np.int64)
        n_bytes = self._deployment.network.stream_bytes
        self.network.on_delivered(int(rows["t_delivered_ns"][-1]), cells.tolist(), n_bytes)
        seldom = rows["t_delivered_ns"] - self._streamed_ns[cells] >= _RASTER_PERIOD_NS
        if seldom.any():
            t_ns = rows["t_delivered_ns"][seldom]
            self._streamed_ns[cells[seldom]] = t_ns
            self.events.add(t_ns.tolist(), cells[seldom].tolist(), [FULL_READING_KIND] * len(t_ns))

    def _apply_regions(self, regions: Regions) -> None:
        frames = self.skin.apply_regions(regions)
        self._sequence_gaps[BOARD_PROCESS].add(range(regions.seq, regions.seq + len(frames)))
        if not frames:
            return
        sampled, delivered, _, _ = zip(*frames, strict=True)
        self._add_packets(sampled, delivered)
        pressed = [frame for frame in frames if frame[3] > 0.0]
        self.events.add(
            [t_ns for _, t_ns, _, _ in pressed],
            [self._layout.n_cells + board for _, _, board, _ in pressed],
            [
                8 * int(Modality.FORCE) + bisect.bisect(_PRESSURE_LEVELS_KPA, peak_kpa)
                for _, _, _, peak_kpa in pressed
            ],
        )

    def _add_packets(self, t_sampled_ns: Sequence[int], t_delivered_ns: Sequence[int]) -> None:
        self._pending_packets[0].extend(t_sampled_ns)
        self._pending_packets[1].extend(t_delivered_ns)
        if len(self._pending_packets[0]) > _MAX_PENDING_PACKETS:
            del (
                self._pending_packets[0][: _MAX_PENDING_PACKETS // 2],
                self._pending_packets[1][: _MAX_PENDING_PACKETS // 2],
            )


def _state_names(deployment: Deployment) -> Iterator[str]:
    """State names of a program of stages, as its controller names them."""
    control = deployment.controller
    if control.program:
        yield FORMING
    for stage in control.program:
        if control.stages[stage].kind == "teach_and_grasp":
            yield from (f"{stage}.{state}" for state in CONFIGURABLE_STATES)
        else:
            yield stage
