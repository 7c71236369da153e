"""Recordings of a few messages for the live page."""

from pathlib import Path

from mcap.writer import CompressionType, Writer
from view_scene import MS, event, joints, state, topology

from skinnet.deployment import Deployment, resolved_json
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import encode
from skinnet.view.state.run_state import ReceivedMessage
from skinnet.view.state.skin_layout import build_skin_layout

LENGTH_S = 60


def story(deployed: Deployment) -> list[ReceivedMessage]:
    """A minute: the network forms, cells are touched now and then, the joints move, one cell dies."""
    atlas = build_skin_layout(deployed)
    told = [topology(atlas, "arm"), topology(atlas, "hand")]
    for second in range(LENGTH_S):
        t_ms = 1000 * second + 10
        told.append(joints(t_ms, 0.01 * second, -0.01 * second))
        told.append(event("arm", second % 6, (second % 9) / 10, t_ms=t_ms + 100, seq=second))
        if second % 10 == 5:
            told.append(state(t_ms + 200, f"stage{second // 10}", "time"))
    told.append(topology(atlas, "arm", 4, version=2)._replace(t_ns=42_500 * MS))
    return sorted(told, key=lambda one: one.t_ns)


def key(told: ReceivedMessage, robot: str = "bot") -> str:
    return Keys(robot).of(told.channel, *told.fields)


def write(path: Path, deployed: Deployment, told: list[ReceivedMessage], chunk_size: int = 2_000) -> Path:
    """A recording as the plain writer makes it, with a channel of somebody else's in between."""
    about = {"format": "2", "robot": deployed.robot, "base": str(path.parent)}
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=CompressionType.ZSTD)
        writer.start()
        writer.add_attachment(0, 0, "deployment.json", "application/json", resolved_json(deployed))
        writer.add_metadata("skinnet", about)
        other = writer.register_channel("/tf", "json", 0)
        channels: dict[str, int] = {}
        for one in told:
            topic = key(one, deployed.robot)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "msgpack", 0)
            payload = one.message if isinstance(one.message, bytes) else encode(one.message)
            writer.add_message(channels[topic], one.t_ns, payload, one.t_ns)
            writer.add_message(other, one.t_ns, b"{}", one.t_ns)
        writer.finish()
    return path
