"""Foxglove topics of a recording: frame transforms, body and skin scenes, and a log.

They use Foxglove's own schemas, so its default panels display them. Transforms are written every 40 ms of
simulated time, as is the skin scene if a colour has changed: about the limit of perception, and cheap for
the recorder.
"""

from pathlib import Path

from foxglove import messages as fox

from skinnet.body.links import WORLD, Links
from skinnet.body.shapes import Figure
from skinnet.clock import NS_PER_MS, NS_PER_S
from skinnet.deployment import Deployment
from skinnet.messages import Answer, ControllerState, Joints, Topology, decode
from skinnet.record_messages import Fault, World
from skinnet.recording.painted import PaintedSkin
from skinnet.recording.solids import scene
from skinnet.recording.writer import Writer

__all__ = ["LOG", "ROBOT", "SCENE", "TOPICS", "TRANSFORMS", "Conversion"]

TRANSFORMS, ROBOT, SCENE, LOG = "/tf", "/robot", "/scene", "/log"
TOPICS = {
    TRANSFORMS: fox.FrameTransforms,
    ROBOT: fox.SceneUpdate,
    SCENE: fox.SceneUpdate,
    LOG: fox.Log,
}
"""Message type of each Foxglove topic."""
_EVERY_NS = 40 * NS_PER_MS


class Conversion:
    """Incremental conversion of recorded messages to Foxglove messages.

    Args:
        deployment: Deployment of the run.
        base: Folder that relative paths in the deployment start from.
        writer: Recording to which the Foxglove messages are added.
    """

    def __init__(self, deployment: Deployment, base: Path, writer: Writer) -> None:
        self._writer = writer
        self._numbers: dict[str, int] = {}
        self._links = Links(deployment, base)
        self._skin = PaintedSkin(deployment)
        figure = Figure(deployment, base)
        self._robot = scene(figure.shapes, {link: name for name, link in figure.free.items()})
        self._stage = ""
        self._next_ns = 0
        self._joints: bytes | None = None
        self._world: bytes | None = None

    def begin(self) -> None:
        """Declare the Foxglove topics in the recording."""
        for topic, kind in TOPICS.items():
            self._numbers[topic] = self._writer.topic(topic, "protobuf", _schema(kind))

    def see(self, channel: str, key: str, t_ns: int, payload: bytes) -> None:
        """Convert one recorded message; messages come in the order of the recording."""
        if t_ns >= self._next_ns:
            self.go_to(t_ns)
        match channel:
            case "joints":
                self._joints = payload
            case "world":
                self._world = payload
            case "events" | "bundle" | "stream" | "regions":
                self._skin.feel(channel, key, payload)
            case "state" | "answer" | "fault" | "topology":
                self._tell(channel, t_ns, payload)

    def go_to(self, t_ns: int) -> None:
        """Write transforms and scenes that are due before `t_ns`."""
        while self._next_ns < t_ns and self._joints is not None:
            self._show(self._next_ns, self._joints)
            self._next_ns += _EVERY_NS

    def _show(self, t_ns: int, joints: bytes) -> None:
        """Write frame transforms and the skin scene at `t_ns`."""
        stamp = fox.Timestamp(sec=t_ns // NS_PER_S, nsec=t_ns % NS_PER_S)
        if t_ns == 0:
            self._write(ROBOT, t_ns, self._robot)
        frames = []
        poses = self._links.poses(decode(joints, Joints).position_rad)
        offsets, turns = poses.offset_m.tolist(), poses.quaternion.tolist()
        for i, name in enumerate(self._links.names):
            parent = self._links.parent[i]
            frames.append(
                _transform(
                    stamp, WORLD if parent < 0 else self._links.names[parent], name, offsets[i], turns[i]
                )
            )
        if self._world is not None:
            for name, pose in decode(self._world, World).poses.items():
                frames.append(_transform(stamp, WORLD, name, pose[:3], pose[3:]))
        self._write(TRANSFORMS, t_ns, fox.FrameTransforms(transforms=frames).encode())
        painted = self._skin.paint()
        if painted is not None:
            self._write(SCENE, t_ns, painted)

    def _tell(self, channel: str, t_ns: int, payload: bytes) -> None:
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
                text = f"request {answer.id} " + ("accepted" if answer.accepted else f"refused: {answer.why}")
            case "topology":
                topology = decode(payload, Topology)
                reached = sum(number > 0 for number in topology.network_id)
                text = f"network of {topology.patch}, version {topology.version}: "
                text += f"{reached} of {len(topology.network_id)} cells"
                level = fox.LogLevel.Info if reached == len(topology.network_id) else fox.LogLevel.Warning
            case "fault":
                fault = decode(payload, Fault)
                level = fox.LogLevel.Warning
                text = f"{fault.kind} of {fault.target} {'begins' if fault.begins else 'ends'}"
        if text:
            stamp = fox.Timestamp(sec=t_ns // NS_PER_S, nsec=t_ns % NS_PER_S)
            line = fox.Log(timestamp=stamp, level=level, message=text, name=channel)
            self._write(LOG, t_ns, line.encode())

    def _write(self, topic: str, t_ns: int, payload: bytes) -> None:
        self._writer.add_to(self._numbers[topic], t_ns, payload)


def _schema(
    kind: type[fox.FrameTransforms] | type[fox.SceneUpdate] | type[fox.Log],
) -> tuple[str, str, bytes]:
    schema = kind.get_schema()
    return schema.name, schema.encoding, schema.data


def _transform(
    stamp: fox.Timestamp, parent: str, child: str, at_m: list[float], turn: list[float]
) -> fox.FrameTransform:
    return fox.FrameTransform(
        timestamp=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        translation=fox.Vector3(x=at_m[0], y=at_m[1], z=at_m[2]),
        rotation=fox.Quaternion(w=turn[0], x=turn[1], y=turn[2], z=turn[3]),
    )
