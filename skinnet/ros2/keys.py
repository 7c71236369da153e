"""Names on the wire of rmw_zenoh: key expressions of topics, and liveliness tokens of nodes and endpoints.

After docs/design.md of ros2/rmw_zenoh: a topic is `<domain>/<name>/<type>/<type hash>`; an entity of the
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
"""Of a node's token: space, domain, session, node, entity, kind, enclave, namespace, name."""
_TOPIC_PARTS = 4
"""Of the token of an endpoint besides: topic, type, type hash, quality of service."""


class Kind(Enum):
    """What an entity of the ROS graph is."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"


class Node(NamedTuple):
    """A node of the ROS graph.

    Attributes:
        domain: ROS_DOMAIN_ID.
        session: Id of its Zenoh session, in hexadecimal digits.
        number: Its number in the session.
        namespace: From "/" on.
        name: Name in its namespace.
        enclave: Of its security settings; "/" for none.
    """

    domain: int
    session: str
    number: int
    namespace: str
    name: str
    enclave: str = "/"


class Entity(NamedTuple):
    """A node, or an endpoint of one: what a token tells.

    Attributes:
        node: The node.
        kind: What it is.
        number: Its number in the session; a node's own for a node.
        topic: Name from "/" on; the rest is empty for a node, too.
        type_name: As on the wire.
        type_hash: RIHS01 of the type.
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
        """Key of its liveliness token."""
        node = self.node
        parts = [_SPACE, str(node.domain), node.session, str(node.number), str(self.number), self.kind.value]
        parts += map(mangled, (node.enclave, node.namespace, node.name))
        if self.kind is not Kind.NODE:
            parts += [*map(mangled, (self.topic, self.type_name, self.type_hash)), self.qos]
        return "/".join(parts)

    @property
    def key(self) -> str:
        """Key of the topic of an endpoint."""
        return topic_key(self.node.domain, self.topic, self.type_name, self.type_hash)

    @classmethod
    def of_token(cls, token: str) -> "Entity":
        """What a token tells.

        Raises:
            ProtocolError: it is no token of a node, a publisher or a subscription.
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
    """A name as one part of a key; the inverse of `demangled` for names without "%", which ROS has not."""
    return name.replace("/", "%")


def demangled(part: str) -> str:
    """The name that `mangled` made one part of a key."""
    return part.replace("%", "/")


def topic_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Key on which the messages of a topic travel."""
    return f"{domain}/{topic.removeprefix('/').removesuffix('/')}/{type_name}/{type_hash}"


def publishers_of(domain: int, topic: str) -> str:
    """Key expression of the tokens of whoever publishes on a topic, messages of any type."""
    anyone = "*/*/*", Kind.PUBLISHER.value, "*/*/*", mangled(topic), "*/*/*"
    return "/".join((_SPACE, str(domain), *anyone))


def wire_type(name: str) -> str:
    """A type's name as DDS has it: sensor_msgs/msg/JointState is sensor_msgs::msg::dds_::JointState_."""
    package, space, message = name.split("/")
    return f"{package}::{space}::dds_::{message}_"


def ros_name(name: str) -> str:
    """`name` as a part of a ROS name: letters, digits and single underscores, no digit first."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return plain if plain[:1].isalpha() else f"robot_{plain}".rstrip("_")
