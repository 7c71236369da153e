"""A ROS 2 system of one process, by docs/design.md of ros2/rmw_zenoh alone: no code of the bridge's.

`python ros2_listener.py ROUTER DOMAIN` joins the graph of DOMAIN as a client of ROUTER. It finds publishers
by their liveliness tokens, subscribes to their topics, takes messages apart, and says on a line each, as
JSON, what it found; an error is a line too. A line on its input, `velocities TOPIC NUMBER…`, publishes. When
its input ends, it leaves.
"""

import hashlib
import json
import re
import struct
import sys
import threading
import time
from typing import Any

import numpy as np
import xxhash
import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh import ext

STORE = get_typestore(Stores.ROS2_KILTED)
QOS = re.compile(r"[0-9]*:[0-9]*:[0-9]*,[0-9]*:[0-9]*,[0-9]*:[0-9]*,[0-9]*:[0-9]*,[0-9]*,[0-9]*")
FLOAT32, UINT32 = 7, 6
TRANSIENT_LOCAL = "1"


SAYING = threading.Lock()


def say(**fact: Any) -> None:
    """One line; Zenoh's threads take turns."""
    with SAYING:
        sys.stdout.write(json.dumps(fact) + "\n")
        sys.stdout.flush()


def plain(value: Any) -> Any:
    """A message as JSON; of a point cloud the points, by the names of its fields."""
    if hasattr(value, "point_step"):
        kinds = {FLOAT32: "<f4", UINT32: "<u4"}
        layout = np.dtype(
            {
                "names": [f.name for f in value.fields],
                "formats": [kinds[f.datatype] for f in value.fields],
                "offsets": [f.offset for f in value.fields],
                "itemsize": value.point_step,
            }
        )
        points = np.frombuffer(value.data.tobytes(), layout)
        assert len(points) == value.width * value.height
        return {"header": plain(value.header), "points": {name: plain(points[name]) for name in layout.names}}
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(item) for name, item in vars(value).items() if not name.startswith("_")}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, list) else value


class Publisher:
    """A publisher that was found by its token."""

    def __init__(self, session: Any, token: str) -> None:
        space, domain, self.zid, node, entity, kind, enclave, namespace, name, *about = token.split("/")
        assert (space, kind, enclave) == ("@ros2_lv", "MP", "%"), token
        assert (node + entity).isdecimal(), token
        topic, self.wire_type, self.type_hash, qos = about
        self.topic = topic.replace("%", "/")
        assert QOS.fullmatch(qos), qos
        assert re.fullmatch(r"RIHS01_[0-9a-f]{64}", self.type_hash), self.type_hash
        package, message = re.fullmatch(r"(\w+)::msg::dds_::(\w+)_", self.wire_type).groups()  # type: ignore[union-attr]
        self.type_name = f"{package}/msg/{message}"
        assert STORE.hash_rihs01(self.type_name) == self.type_hash, self.type_name
        self.gid = xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")
        self.last = (0, 0)
        key = f"{domain}{self.topic}/{self.wire_type}/{self.type_hash}"
        say(
            found=self.topic,
            type=self.type_name,
            node=f"{namespace.replace('%', '/')}/{name}",
            qos=qos,
        )
        if qos.split(":")[1] == TRANSIENT_LOCAL:
            history = ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            self.subscriber = ext.declare_advanced_subscriber(session, key, self.hear, history=history)
        else:
            self.subscriber = session.declare_subscriber(key, self.hear)

    def hear(self, sample: Any) -> None:
        try:
            attachment = sample.attachment.to_bytes()
            assert len(attachment) == 33, len(attachment)
            sequence, t_ns, length, gid = struct.unpack("<qqB16s", attachment)
            assert length == 16
            assert gid == self.gid, "the GID of a message is not that of its publisher's token"
            assert sequence > self.last[0], (self.last, sequence)
            assert t_ns >= self.last[1], (self.last, t_ns)
            assert abs(t_ns - time.time_ns()) < 10**12, t_ns
            self.last = sequence, t_ns
            payload = sample.payload.to_bytes()
            message = STORE.deserialize_cdr(payload, self.type_name)
            say(
                topic=self.topic,
                sequence=sequence,
                message=plain(message),
                sha256=hashlib.sha256(payload).hexdigest(),
            )
        except Exception as error:
            say(error=f"{self.topic}: {error!r}")


def velocities(session: Any, domain: str, topic: str, numbers: list[float], count: int) -> None:
    """Publishes a Float64MultiArray as a node of its own would."""
    name = "std_msgs/msg/Float64MultiArray"
    type_hash, wire = STORE.hash_rihs01(name), "std_msgs::msg::dds_::Float64MultiArray_"
    about = f"{topic.replace('/', '%')}/{wire}/{type_hash}/::,10:,:,:,,"
    token = f"@ros2_lv/{domain}/{session.info.zid()}/0/7/MP/%/%/teleop/{about}"
    if count == 1:
        TOKENS.append(session.liveliness().declare_token(token))
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    message = STORE.types[name](layout, np.array(numbers))
    gid = xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")
    attachment = struct.pack("<qqB16s", count, time.time_ns(), 16, gid)
    payload = bytes(STORE.serialize_cdr(message, name))
    session.put(f"{domain}{topic}/{wire}/{type_hash}", payload, attachment=attachment)


TOKENS: list[Any] = []


def main() -> None:
    router, domain = sys.argv[1:]
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [router]),
        ("scouting/multicast/enabled", False),
        ("timestamping/enabled", True),
    ):
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    publishers: dict[str, Publisher] = {}
    changing = threading.Lock()

    def on_token(sample: Any) -> None:
        token = str(sample.key_expr)
        with changing:
            try:
                if sample.kind != zenoh.SampleKind.PUT:
                    say(gone=token.split("/")[-1] if "/NN/" in token else publishers.pop(token).topic)
                elif token.split("/")[5] == "NN":
                    say(node=token.split("/")[-2].replace("%", "/") + "/" + token.split("/")[-1])
                elif token.split("/")[5] == "MS":
                    say(subscription=token.split("/")[9].replace("%", "/"))
                elif token not in publishers:
                    publishers[token] = Publisher(session, token)
            except Exception as error:
                say(error=f"{token}: {error!r}")

    graph = session.liveliness().declare_subscriber(f"@ros2_lv/{domain}/**", on_token, history=True)
    say(tokens=len(list(session.liveliness().get(f"@ros2_lv/{domain}/**", timeout=10.0))))
    for count, line in enumerate(sys.stdin, 1):
        word, topic, *numbers = line.split()
        assert word == "velocities"
        velocities(session, domain, topic, [float(number) for number in numbers], count)
    graph.undeclare()
    session.close()


if __name__ == "__main__":
    main()
