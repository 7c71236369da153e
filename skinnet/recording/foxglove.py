"""Foxglove topics of a recording: frame transforms, body and skin scenes, and a log.

They use Foxglove's own schemas, so its default panels display them. Transforms are written every 40 ms of
simulated time, as is the skin scene if a colour has changed: about the limit of perception, and cheap for
the recorder.
"""

from pathlib import Path

from foxglove import messages as fox

from skinnet.body.link_kinematics import WORLD_FRAME, LinkKinematics
from skinnet.body.visual_shapes import VisualModel
from skinnet.clock import NS_PER_MS, NS_PER_S
from skinnet.deployment import Deployment
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import (
    INVALID_CONTENT,
    Answer,
    ControllerState,
    Joints,
    Topology,
    decode,
)
from skinnet.protocol.recorded_messages import FaultEvent, FreeBodyPoses
from skinnet.recording.body_scene import body_scene
from skinnet.recording.skin_scene import SkinScene
from skinnet.recording.writer import RecordingWriter

__all__ = ["BODY_TOPIC", "LOG_TOPIC", "MESSAGE_TYPES", "SKIN_TOPIC", "TRANSFORMS_TOPIC", "FoxgloveConverter"]

TRANSFORMS_TOPIC, BODY_TOPIC, SKIN_TOPIC, LOG_TOPIC = "/tf", "/robot", "/scene", "/log"
MESSAGE_TYPES = {
    TRANSFORMS_TOPIC: fox.FrameTransforms,
    BODY_TOPIC: fox.SceneUpdate,
    SKIN_TOPIC: fox.SceneUpdate,
    LOG_TOPIC: fox.Log,
}
"""Message type of each Foxglove topic."""
_PERIOD_NS = 40 * NS_PER_MS
_POSE_LENGTH = 7


class FoxgloveConverter:
    """Incremental conversion of recorded messages to Foxglove messages.

    Args:
        deployment: Deployment of the run.
        base: Folder that relative paths in the deployment start from.
        writer: Recording to which the Foxglove messages are added.
    """

    def __init__(self, deployment: Deployment, base: Path, writer: RecordingWriter) -> None:
        self._writer = writer
        self._channel_ids: dict[str, int] = {}
        self._links = LinkKinematics(deployment, base)
        self._skin_scene = SkinScene(deployment)
        figure = VisualModel(deployment, base)
        self._body_scene = body_scene(figure.shapes, {link: name for name, link in figure.free_links.items()})
        self._stage = ""
        self._next_ns = 0
        self._n_dofs = len(deployment.body.joints)
        self._position_rad: list[float] | None = None
        self._free_body_poses: dict[str, list[float]] = {}
        self._n_unreadable = 0

    def declare_topics(self) -> None:
        """Declare the Foxglove topics in the recording."""
        for topic, kind in MESSAGE_TYPES.items():
            self._channel_ids[topic] = self._writer.add_channel(topic, "protobuf", _schema(kind))

    def convert(self, channel: str, key: str, t_ns: int, payload: bytes) -> None:
        """Convert one recorded message; messages come in the order of the recording.

        One whose content does not fit the robot is counted and left out.
        """
        if t_ns >= self._next_ns:
            self.write_until(t_ns)
        try:
            self._convert(channel, key, t_ns, payload)
        except INVALID_CONTENT:
            self._n_unreadable += 1

    @property
    def n_unreadable(self) -> int:
        """Number of recorded messages whose content did not fit the robot."""
        return self._n_unreadable + self._skin_scene.n_unreadable

    def _convert(self, channel: str, key: str, t_ns: int, payload: bytes) -> None:
        match channel:
            case "joints":
                position_rad = decode(payload, Joints).position_rad
                if len(position_rad) != self._n_dofs:
                    raise ProtocolError(f"{len(position_rad)} joint positions; expected {self._n_dofs}")
                self._position_rad = position_rad
            case "free_bodies":
                poses = decode(payload, FreeBodyPoses).poses
                if any(len(pose) != _POSE_LENGTH for pose in poses.values()):
                    raise ProtocolError(f"poses of free bodies have {_POSE_LENGTH} numbers")
                self._free_body_poses = poses
            case "events" | "bundle" | "stream" | "regions":
                self._skin_scene.add(channel, key, payload)
            case "state" | "answer" | "fault" | "topology":
                self._write_log(channel, t_ns, payload)

    def write_until(self, t_ns: int) -> None:
        """Write transforms and scenes that are due before `t_ns`."""
        while self._next_ns < t_ns and self._position_rad is not None:
            self._write_scene(self._next_ns, self._position_rad)
            self._next_ns += _PERIOD_NS

    def _write_scene(self, t_ns: int, position_rad: list[float]) -> None:
        """Write frame transforms and the skin scene at `t_ns`."""
        stamp = fox.Timestamp(sec=t_ns // NS_PER_S, nsec=t_ns % NS_PER_S)
        if t_ns == 0:
            self._write(BODY_TOPIC, t_ns, self._body_scene)
        frames = []
        poses = self._links.poses(position_rad)
        offsets, turns = poses.offset_m.tolist(), poses.quaternion.tolist()
        for i, name in enumerate(self._links.names):
            parent = self._links.parent_index[i]
            frames.append(
                _transform(
                    stamp,
                    WORLD_FRAME if parent < 0 else self._links.names[parent],
                    name,
                    offsets[i],
                    turns[i],
                )
            )
        for name, pose in self._free_body_poses.items():
            frames.append(_transform(stamp, WORLD_FRAME, name, pose[:3], pose[3:]))
        self._write(TRANSFORMS_TOPIC, t_ns, fox.FrameTransforms(transforms=frames).encode())
        painted = self._skin_scene.encode_if_changed()
        if painted is not None:
            self._write(SKIN_TOPIC, t_ns, painted)

    def _write_log(self, channel: str, t_ns: int, payload: bytes) -> None:
        """Write a log line for a message that merits one."""
        level, text = fox.LogLevel.Info, ""
        match channel:
            case "state":
                state = decode(payload, ControllerState)
                if state.stage != self._stage:
                    self._stage = state.stage
                    text = f"{state.stage}: {state.text}" if state.text else state.stage
            case "answer":
                answer = decode(payload, Answer)
                text = f"request {answer.id} " + (
                    "accepted" if answer.accepted else f"refused: {answer.reason}"
                )
            case "topology":
                topology = decode(payload, Topology)
                reached = sum(number > 0 for number in topology.network_id)
                text = f"topology of {topology.patch}, version {topology.version}: "
                text += f"{reached} of {len(topology.network_id)} cells connected"
                level = fox.LogLevel.Info if reached == len(topology.network_id) else fox.LogLevel.Warning
            case "fault":
                fault = decode(payload, FaultEvent)
                level = fox.LogLevel.Warning
                text = f"{fault.kind} of {fault.target} {'begins' if fault.begins else 'ends'}"
        if text:
            stamp = fox.Timestamp(sec=t_ns // NS_PER_S, nsec=t_ns % NS_PER_S)
            line = fox.Log(timestamp=stamp, level=level, message=text, name=channel)
            self._write(LOG_TOPIC, t_ns, line.encode())

    def _write(self, topic: str, t_ns: int, payload: bytes) -> None:
        self._writer.add_to_channel(self._channel_ids[topic], t_ns, payload)


def _schema(
    kind: type[fox.FrameTransforms] | type[fox.SceneUpdate] | type[fox.Log],
) -> tuple[str, str, bytes]:
    schema = kind.get_schema()
    return schema.name, schema.encoding, schema.data


def _transform(
    stamp: fox.Timestamp, parent: str, child: str, position_m: list[float], quaternion: list[float]
) -> fox.FrameTransform:
    return fox.FrameTransform(
        timestamp=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        translation=fox.Vector3(x=position_m[0], y=position_m[1], z=position_m[2]),
        rotation=fox.Quaternion(w=quaternion[0], x=quaternion[1], y=quaternion[2], z=quaternion[3]),
    )
