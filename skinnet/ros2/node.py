"""ROS graph node on a Zenoh session, with publishers, subscriptions and their liveliness tokens."""

import time
from collections.abc import Callable
from typing import Any

from skinnet.errors import SkinnetError
from skinnet.ros2.attachment import Attachment, gid_of
from skinnet.ros2.keys import Entity, Kind, Node, publishers_of, wire_type
from skinnet.ros2.qos import Durability, Qos, Reliability
from skinnet.ros2.types import encode, type_hash
from skinnet.transport.open_session import OnSample, OpenSession, Publisher

__all__ = ["RosNode", "RosPublisher"]

_ASK_S = 5.0


class RosPublisher:
    """Publisher of one message type on one topic.

    Attributes:
        entity: Graph entity of the publisher.
        sent: Number of published messages.
    """

    def __init__(self, entity: Entity, publisher: Publisher, clock_ns: Callable[[], int]) -> None:
        self.entity = entity
        self.sent = 0
        self._gid = gid_of(entity.token)
        self._publisher, self._clock_ns = publisher, clock_ns

    @property
    def wanted(self) -> bool:
        """Matching status: whether there is a subscription."""
        return self._publisher.wanted

    def publish(self, message: Any) -> None:
        """Publish `message`; subscribers that do not keep up may miss it."""
        self.sent += 1
        self._publisher.put(encode(message), Attachment(self.sent, self._clock_ns(), self._gid).pack())


class RosNode:
    """ROS graph node with a unique name in its domain.

    Args:
        session: Zenoh session to the ROS 2 system.
        domain: ROS_DOMAIN_ID.
        namespace: Namespace, beginning with "/".
        name: Name in the namespace.

    Raises:
        SkinnetError: the domain already has a node of this name.
    """

    def __init__(self, session: OpenSession, domain: int, namespace: str, name: str) -> None:
        self._session = session
        self._node = Node(domain, session.zid, 0, namespace, name)
        self._endpoints = 0
        own = Entity(self._node, Kind.NODE, 0)
        anyone = Entity(self._node._replace(session="*"), Kind.NODE, 0).token
        if session.present(anyone, _ASK_S) - {own.token}:
            raise SkinnetError(f"{namespace}/{name}: domain {domain} already has a node of that name")
        session.announce(own.token)

    def publisher(self, topic: str, type_name: str, qos: Qos) -> RosPublisher:
        """Declare a publisher on `topic`."""
        entity = self._endpoint(Kind.PUBLISHER, topic, type_name, qos)
        reliable = qos.reliability is Reliability.RELIABLE
        if qos.durability is Durability.TRANSIENT_LOCAL:
            sender = self._session.keeping_publisher(entity.key, reliable=reliable, kept=qos.depth)
        else:
            sender = self._session.publisher(entity.key, reliable=reliable)
        self._session.announce(entity.token)
        return RosPublisher(entity, sender, time.time_ns)

    def subscribe(self, topic: str, type_name: str, qos: Qos, on_sample: OnSample) -> None:
        """Declare a subscription to `topic`; `on_sample` gets the encoded messages."""
        entity = self._endpoint(Kind.SUBSCRIPTION, topic, type_name, qos)
        self._session.subscribe(entity.key, on_sample)
        self._session.announce(entity.token)

    def watch_publishers(self, topic: str, on_change: Callable[[str, bool], None]) -> None:
        """Call `on_change` with the token of each publisher on `topic`, and whether it is alive."""
        self._session.on_alive(publishers_of(self._node.domain, topic), on_change)

    def _endpoint(self, kind: Kind, topic: str, type_name: str, qos: Qos) -> Entity:
        self._endpoints += 1
        described = wire_type(type_name), type_hash(type_name), qos.compact
        return Entity(self._node, kind, self._endpoints, topic, *described)
