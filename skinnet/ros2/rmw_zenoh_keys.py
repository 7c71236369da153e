"""Key expressions of rmw_zenoh: topics, and liveliness tokens of nodes and endpoints.

Source: docs/design.md of ros2/rmw_zenoh. A topic is `<domain>/<name>/<type>/<type hash>`; an entity of the
graph declares a token under `@ros2_lv`, with every "/" inside a part mangled to "%".
"""

import re
from enum import Enum
from typing import NamedTuple

from skinnet.errors import ProtocolError

__all__ = [
    "Entity",
    "EntityType",
    "NodeInfo",
    "dds_type_name",
    "demangle_name",
    "mangle_name",
    "publisher_tokens_expression",
    "to_ros_name",
    "topic_key",
]

_ADMIN_SPACE = "@ros2_lv"
_NODE_TOKEN_PARTS = 9
"""Parts of a node's token: space, domain, session, node, entity, kind, enclave, namespace, name."""
_ENDPOINT_TOKEN_PARTS = 4
"""Further parts of an endpoint's token: topic, type, type hash, quality of service."""


class EntityType(Enum):
    """Entity kinds of the ROS graph."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"


class NodeInfo(NamedTuple):
    """ROS graph node.

    Attributes:
        domain_id: ROS_DOMAIN_ID.
        session_id: Zenoh session id, in hexadecimal digits.
        node_id: Node id within the session.
        namespace: Namespace, beginning with "/".
        name: Name in the namespace.
        enclave: Security enclave; "/" for none.
    """

    domain_id: int
    session_id: str
    node_id: int
    namespace: str
    name: str
    enclave: str = "/"


class Entity(NamedTuple):
    """ROS graph entity described by a liveliness token: a node, or an endpoint of one.

    Attributes:
        node: The node.
        entity_type: Node, publisher or subscription.
        entity_id: Entity id within the session; the node id for a node.
        topic: Topic name, beginning with "/"; empty for a node, as are the following.
        type_name: Type name as on the wire (DDS).
        type_hash: RIHS01 hash of the type.
        qos: Quality of service in the compact form.
    """

    node: NodeInfo
    entity_type: EntityType
    entity_id: int
    topic: str = ""
    type_name: str = ""
    type_hash: str = ""
    qos: str = ""

    @property
    def liveliness_token(self) -> str:
        """Liveliness token's key."""
        node = self.node
        parts = [
            _ADMIN_SPACE,
            str(node.domain_id),
            node.session_id,
            str(node.node_id),
            str(self.entity_id),
            self.entity_type.value,
        ]
        parts += map(mangle_name, (node.enclave, node.namespace, node.name))
        if self.entity_type is not EntityType.NODE:
            parts += [*map(mangle_name, (self.topic, self.type_name, self.type_hash)), self.qos]
        return "/".join(parts)

    @property
    def topic_key(self) -> str:
        """Topic key of an endpoint."""
        return topic_key(self.node.domain_id, self.topic, self.type_name, self.type_hash)

    @classmethod
    def from_token(cls, token: str) -> "Entity":
        """Parse a liveliness token.

        Raises:
            ProtocolError: it is not a token of a node, a publisher or a subscription.
        """
        parts = token.split("/")
        kinds = {kind.value: kind for kind in EntityType}
        if (
            len(parts) < _NODE_TOKEN_PARTS
            or parts[0] != _ADMIN_SPACE
            or not all(parts)
            or parts[5] not in kinds
        ):
            raise ProtocolError(f"{token}: not a token of a node, publisher or subscription")
        kind = kinds[parts[5]]
        wanted = _NODE_TOKEN_PARTS if kind is EntityType.NODE else _NODE_TOKEN_PARTS + _ENDPOINT_TOKEN_PARTS
        if len(parts) < wanted or not all(parts[i].isdecimal() for i in (1, 3, 4)):
            raise ProtocolError(f"{token}: has {len(parts)} parts; {kind.name.lower()}s have {wanted}")
        enclave, namespace, name = map(demangle_name, parts[6:9])
        node = NodeInfo(int(parts[1]), parts[2], int(parts[3]), namespace, name, enclave)
        if kind is EntityType.NODE:
            return cls(node, kind, int(parts[4]))
        topic, type_name, type_hash = map(demangle_name, parts[9:12])
        return cls(node, kind, int(parts[4]), topic, type_name, type_hash, parts[12])


def mangle_name(name: str) -> str:
    """Mangle a name to one part of a key; inverse of `demangle_name` without "%", as all ROS names."""
    return name.replace("/", "%")


def demangle_name(part: str) -> str:
    """Demangle a part of a key to a name."""
    return part.replace("%", "/")


def topic_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Topic key on which messages are published."""
    return f"{domain}/{topic.removeprefix('/').removesuffix('/')}/{type_name}/{type_hash}"


def publisher_tokens_expression(domain: int, topic: str) -> str:
    """Key expression of the tokens of all publishers on a topic, of any type."""
    anyone = "*/*/*", EntityType.PUBLISHER.value, "*/*/*", mangle_name(topic), "*/*/*"
    return "/".join((_ADMIN_SPACE, str(domain), *anyone))


def dds_type_name(name: str) -> str:
    """DDS type name: sensor_msgs/msg/JointState becomes sensor_msgs::msg::dds_::JointState_."""
    package, space, message = name.split("/")
    return f"{package}::{space}::dds_::{message}_"


def to_ros_name(name: str) -> str:
    """ROS name part made from `name`: letters, digits and single underscores, no digit first."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return plain if plain[:1].isalpha() else f"robot_{plain}".rstrip("_")
