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
    "Kind",
    "Node",
    "demangled",
    "mangled",
    "publishers_of",
    "ros_name",
    "topic_key",
    "wire_type",
]

_SPACE = "@ros2_lv"
_PARTS = 9
"""Parts of a node's token: space, domain, session, node, entity, kind, enclave, namespace, name."""
_TOPIC_PARTS = 4
"""Further parts of an endpoint's token: topic, type, type hash, quality of service."""


class Kind(Enum):
    """Entity kinds of the ROS graph."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"


class Node(NamedTuple):
    """ROS graph node.

    Attributes:
        domain: ROS_DOMAIN_ID.
        session: Zenoh session id, in hexadecimal digits.
        number: Node id within the session.
        namespace: Namespace, beginning with "/".
        name: Name in the namespace.
        enclave: Security enclave; "/" for none.
    """

    domain: int
    session: str
    number: int
    namespace: str
    name: str
    enclave: str = "/"


class Entity(NamedTuple):
    """ROS graph entity described by a liveliness token: a node, or an endpoint of one.

    Attributes:
        node: The node.
        kind: Node, publisher or subscription.
        number: Entity id within the session; the node id for a node.
        topic: Topic name, beginning with "/"; empty for a node, as are the following.
        type_name: Type name as on the wire (DDS).
        type_hash: RIHS01 hash of the type.
        qos: Quality of service in the compact form.
    """

    node: Node
    kind: Kind
    number: int
    topic: str = ""
    type_name: str = ""
    type_hash: str = ""
    qos: str = ""

    @property
    def token(self) -> str:
        """Liveliness token's key."""
        node = self.node
        parts = [_SPACE, str(node.domain), node.session, str(node.number), str(self.number), self.kind.value]
        parts += map(mangled, (node.enclave, node.namespace, node.name))
        if self.kind is not Kind.NODE:
            parts += [*map(mangled, (self.topic, self.type_name, self.type_hash)), self.qos]
        return "/".join(parts)

    @property
    def key(self) -> str:
        """Topic key of an endpoint."""
        return topic_key(self.node.domain, self.topic, self.type_name, self.type_hash)

    @classmethod
    def of_token(cls, token: str) -> "Entity":
        """Parse a liveliness token.

        Raises:
            ProtocolError: it is not a token of a node, a publisher or a subscription.
        """
        parts = token.split("/")
        kinds = {kind.value: kind for kind in Kind}
        if len(parts) < _PARTS or parts[0] != _SPACE or not all(parts) or parts[5] not in kinds:
            raise ProtocolError(f"{token}: no token of a node, a publisher or a subscription")
        kind = kinds[parts[5]]
        wanted = _PARTS if kind is Kind.NODE else _PARTS + _TOPIC_PARTS
        if len(parts) < wanted or not all(parts[i].isdecimal() for i in (1, 3, 4)):
            raise ProtocolError(f"{token}: has {len(parts)} parts; {kind.name.lower()}s have {wanted}")
        enclave, namespace, name = map(demangled, parts[6:9])
        node = Node(int(parts[1]), parts[2], int(parts[3]), namespace, name, enclave)
        if kind is Kind.NODE:
            return cls(node, kind, int(parts[4]))
        topic, type_name, type_hash = map(demangled, parts[9:12])
        return cls(node, kind, int(parts[4]), topic, type_name, type_hash, parts[12])


def mangled(name: str) -> str:
    """Mangle a name to one part of a key; inverse of `demangled` for names without "%", as all ROS names."""
    return name.replace("/", "%")


def demangled(part: str) -> str:
    """Demangle a part of a key to a name."""
    return part.replace("%", "/")


def topic_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Topic key on which messages are published."""
    return f"{domain}/{topic.removeprefix('/').removesuffix('/')}/{type_name}/{type_hash}"


def publishers_of(domain: int, topic: str) -> str:
    """Key expression of the tokens of all publishers on a topic, of any type."""
    anyone = "*/*/*", Kind.PUBLISHER.value, "*/*/*", mangled(topic), "*/*/*"
    return "/".join((_SPACE, str(domain), *anyone))


def wire_type(name: str) -> str:
    """DDS type name: sensor_msgs/msg/JointState becomes sensor_msgs::msg::dds_::JointState_."""
    package, space, message = name.split("/")
    return f"{package}::{space}::dds_::{message}_"


def ros_name(name: str) -> str:
    """ROS name part made from `name`: letters, digits and single underscores, no digit first."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return plain if plain[:1].isalpha() else f"robot_{plain}".rstrip("_")
