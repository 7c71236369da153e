"""State of the ROS 2 bridge without I/O: takes messages of the run and makes ROS messages."""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from skinnet.body.link_kinematics import LinkKinematics, LinkPoses
from skinnet.clock import NS_PER_S
from skinnet.deployment.deployment import Deployment
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import ControllerState, Events, Joints, Stream, Topology, decode, unpack
from skinnet.protocol.sheet_messages import REGION_ROW, SCAN_FRAME_ROW, Regions
from skinnet.protocol.states import FORMING
from skinnet.ros2 import conversion as convert
from skinnet.ros2.cell_poses import CellPoses
from skinnet.ros2.conversion import ComponentStatus, DiagnosticLevel
from skinnet.ros2.markers import SkinMarkers
from skinnet.ros2.readings import CellReadings
from skinnet.ros2.rmw_zenoh_keys import to_ros_name

__all__ = ["SUBSCRIBED_CHANNELS", "RosMessageBuilder"]

SUBSCRIBED_CHANNELS = ("joints", "events", "bundle", "stream", "topology", "regions", "state")
"""Channels to which the bridge subscribes."""
_STALE_S = 2.0


class RosMessageBuilder:
    """Newest published state of a run, as ROS messages.

    Args:
        deployment: Deployment of the run.
        links: Kinematic tree of the body.

    Attributes:
        robot: ROS name of the robot.
        t_ns: Simulated time of the newest joint feedback [ns]; −1 before the first.
        counters: Counts of refused messages.
    """

    def __init__(self, deployment: Deployment, links: LinkKinematics) -> None:
        self.t_ns = -1
        self.counters: Counter[str] = Counter()
        self._keys = Keys(deployment.robot)
        self.robot = to_ros_name(deployment.robot)
        self._links = links
        self._joints = deployment.body.joints
        self._cell_poses = CellPoses(deployment, links)
        self._readings = CellReadings(self._cell_poses.patch_sizes)
        self._markers = SkinMarkers(self.robot, self._cell_poses, links.names)
        self._position_rad = np.zeros(len(self._joints))
        self._velocity_rad_s = np.zeros(len(self._joints))
        self._poses_ns, self._poses = -1, links.poses(self._position_rad)
        self._stage, self._progress = "", 0.0
        self._frame_counts = [0] * self._cell_poses.n_sheets
        self._regions = [np.empty(0, dtype=REGION_ROW)] * self._cell_poses.n_sheets
        self._handlers: dict[str, Callable[[str, bytes], None]] = {
            "joints": self._handle_joints,
            "events": self._handle_events,
            "bundle": self._handle_events,
            "stream": self._handle_stream,
            "topology": self._handle_topology,
            "regions": self._handle_regions,
            "state": self._handle_state,
        }

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""
        return len(self._joints)

    @property
    def has_cells(self) -> bool:
        """Presence of patches of cells."""
        return bool(self._cell_poses.patch_sizes)

    @property
    def has_sheets(self) -> bool:
        """Presence of tactile sheets."""
        return self._cell_poses.n_sheets > 0

    def handle(self, key: str, payload: bytes) -> None:
        """Process a message of the run; count it as refused if it does not fit.

        Raises:
            ProtocolError: it does not fit; the state is unchanged.
        """
        try:
            channel, fields = self._keys.parse(key)
            taker = self._handlers.get(channel.name)
            if taker is None:
                raise ProtocolError(f"{key}: the bridge does not subscribe to {channel.name}")
            taker(fields[0] if fields else "", payload)
        except ProtocolError:
            self.counters["refused"] += 1
            raise

    def clock(self) -> Any:
        """Clock message with simulated time."""
        return convert.clock(self.t_ns)

    def joint_state(self) -> Any:
        """JointState of the controlled joints; velocities by difference of the last two feedbacks."""
        return convert.joint_state(self.t_ns, self._joints, self._position_rad, self._velocity_rad_s)

    def moving_transforms(self) -> Any:
        """Transforms of the links moved by controlled joints."""
        return convert.transforms(
            self.t_ns, self.robot, self._links, self._current_poses(), self._links.has_controlled_joint
        )

    def static_transforms(self) -> Any:
        """Transforms of the other links, which are constant."""
        return convert.transforms(
            0, self.robot, self._links, self._current_poses(), ~self._links.has_controlled_joint
        )

    def skin_cloud(self) -> Any:
        """PointCloud2 of all cells."""
        return convert.point_cloud(
            self.t_ns, convert.skin_points(self._cell_poses, self._current_poses(), self._readings)
        )

    def region_cloud(self) -> Any:
        """PointCloud2 of the contact regions of tactile sheets."""
        rows = np.concatenate(self._regions)
        return convert.point_cloud(
            self.t_ns, convert.region_points(self._cell_poses, self._current_poses(), rows)
        )

    def markers(self) -> Any:
        """MarkerArray of all cells, for RViz."""
        return self._markers.marker_array(self.t_ns, self._readings)

    def diagnostics(self, silent_s: float, bridge_values: dict[str, object]) -> Any:
        """DiagnosticArray of the run.

        Args:
            silent_s: Wall time since the last newer joint feedback [s].
            bridge_values: Diagnostic values of the bridge itself, by name.
        """
        parts = [self._run_status(silent_s), *self._patch_status(), *self._board_status()]
        refused = sum(self.counters.values())
        level = DiagnosticLevel.WARN if refused else DiagnosticLevel.OK
        line = f"{refused} messages of the run refused" if refused else "no message refused"
        parts.append(ComponentStatus("bridge", level, line, bridge_values | dict(self.counters)))
        return convert.diagnostics(max(self.t_ns, 0), self.robot, parts)

    def _run_status(self, silent_s: float) -> ComponentStatus:
        values = {
            "stage": self._stage,
            "progress": f"{self._progress:.3f}",
            "simulated_s": f"{max(self.t_ns, 0) / NS_PER_S:.3f}",
        }
        if self.t_ns < 0 or silent_s > _STALE_S:
            return ComponentStatus("run", DiagnosticLevel.STALE, f"no message for {silent_s:.0f} s", values)
        return ComponentStatus("run", DiagnosticLevel.OK, self._stage or FORMING, values)

    def _patch_status(self) -> Iterator[ComponentStatus]:
        for name, tally in self._readings.deliveries.items():
            reached = self._readings.connected[self._readings.rows_of(name)]
            n, there = len(reached), int(reached.sum())
            values = {
                "cells": n,
                "reached": there,
                "events": tally.n_events,
                "full_readings": tally.n_full_readings,
                "lost": tally.n_lost,
            }
            level = DiagnosticLevel.OK if there == n else DiagnosticLevel.WARN
            yield ComponentStatus(f"skin {name}", level, f"{there} of {n} cells connected", values)

    def _board_status(self) -> Iterator[ComponentStatus]:
        for board, (frames, rows) in enumerate(zip(self._frame_counts, self._regions, strict=True)):
            values = {"frames": frames, "regions": len(rows)}
            level = DiagnosticLevel.OK if frames else DiagnosticLevel.STALE
            yield ComponentStatus(f"board {board}", level, f"{len(rows)} regions", values)

    def _current_poses(self) -> LinkPoses:
        """Link poses at the newest joint feedback."""
        if self._poses_ns != self.t_ns:
            self._poses_ns, self._poses = self.t_ns, self._links.poses(self._position_rad)
        return self._poses

    def _handle_joints(self, _field: str, payload: bytes) -> None:
        joints = decode(payload, Joints)
        position = np.array(joints.position_rad, dtype=np.float64)
        if position.shape != self._position_rad.shape or not np.isfinite(position).all():
            raise ProtocolError(f"{len(position)} joint positions; expected {len(self._joints)} finite ones")
        if joints.t_ns <= self.t_ns:
            return  # older than the newest feedback
        if self.t_ns >= 0:
            step_s = (joints.t_ns - self.t_ns) / NS_PER_S
            self._velocity_rad_s = (position - self._position_rad) / step_s
        self._position_rad, self.t_ns = position, joints.t_ns

    def _handle_events(self, patch: str, payload: bytes) -> None:
        self._readings.apply_events(patch, decode(payload, Events))

    def _handle_stream(self, patch: str, payload: bytes) -> None:
        self._readings.apply_stream(patch, decode(payload, Stream))

    def _handle_topology(self, patch: str, payload: bytes) -> None:
        self._readings.apply_topology(patch, decode(payload, Topology))

    def _handle_regions(self, _network: str, payload: bytes) -> None:
        message = decode(payload, Regions)
        frames, rows = unpack(message.frames, SCAN_FRAME_ROW), unpack(message.rows, REGION_ROW)
        if int(frames["n_regions"].sum()) != len(rows):
            raise ProtocolError(f"regions: {len(rows)} rows, and frames of {int(frames['n_regions'].sum())}")
        if len(frames) and frames["board"].max() >= len(self._frame_counts):
            raise ProtocolError(
                f"regions of board {frames['board'].max()}; there are {len(self._frame_counts)}"
            )
        ends = np.cumsum(frames["n_regions"], dtype=np.int64).tolist()
        for board, end, n in zip(frames["board"].tolist(), ends, frames["n_regions"].tolist(), strict=True):
            mine = rows[end - n : end]
            self._frame_counts[board] += 1
            self._regions[board] = mine[mine["n_elements"] > 0]

    def _handle_state(self, _field: str, payload: bytes) -> None:
        state = decode(payload, ControllerState)
        self._stage, self._progress = state.stage, state.progress
