"""ROS 2 message types of the bridge: construction, CDR encoding and RIHS01 hashes.

Definitions are those of Jazzy; Iron, Kilted and Lyrical have the same hashes.
"""

from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from skinnet.errors import ProtocolError

__all__ = [
    "CLOCK",
    "DIAGNOSTIC_ARRAY",
    "FLOAT64_MULTI_ARRAY",
    "JOINT_STATE",
    "MARKER_ARRAY",
    "MESSAGE_TYPES",
    "POINT_CLOUD2",
    "TF_MESSAGE",
    "decode",
    "encode",
    "make_message",
    "type_hash",
]

CLOCK = "rosgraph_msgs/msg/Clock"
JOINT_STATE = "sensor_msgs/msg/JointState"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
FLOAT64_MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
MESSAGE_TYPES = (
    CLOCK,
    JOINT_STATE,
    TF_MESSAGE,
    POINT_CLOUD2,
    MARKER_ARRAY,
    DIAGNOSTIC_ARRAY,
    FLOAT64_MULTI_ARRAY,
)
"""Names of all message types of the bridge."""

_store = get_typestore(Stores.ROS2_JAZZY)


def make_message(name: str, *fields: Any, **more: Any) -> Any:
    """Make a message of type `name` from its fields, positional or by name."""
    return _store.types[name](*fields, **more)


def encode(message: Any) -> bytes:
    """Encode a message as little-endian CDR with its encapsulation header."""
    return bytes(_store.serialize_cdr(message, message.__msgtype__))


def decode(payload: bytes, name: str) -> Any:
    """Decode a CDR message of type `name`.

    Raises:
        ProtocolError: `payload` is not such a message.
    """
    try:
        return _store.deserialize_cdr(payload, name)
    except (SerdeError, UnicodeDecodeError) as error:
        raise ProtocolError(f"cannot decode {name}: {error}") from error


def type_hash(name: str) -> str:
    """RIHS01 hash of a type: "RIHS01_" and 64 hexadecimal digits."""
    return _store.hash_rihs01(name)
