"""A node of the ROS graph on a Zenoh session: its publishers, its subscriptions, and their tokens."""

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
    """Publishes messages of one type on one topic.

    Attributes:
        entity: What its token tells.
        sent: Messages that were published.
    """

    def __init__(self, entity: Entity, publisher: Publisher, clock_ns: Callable[[], int]) -> None:
        self.entity = entity
        self.sent = 0
        self._gid = gid_of(entity.token)
        self._publisher, self._clock_ns = publisher, clock_ns

    @property
    def wanted(self) -> bool:
        """Whether anybody subscribes."""
        return self._publisher.wanted

    def publish(self, message: Any) -> None:
        """Sends `message` to whoever keeps up."""
        self.sent += 1
        self._publisher.put(encode(message), Attachment(self.sent, self._clock_ns(), self._gid).pack())


class RosNode:
    """A node: all alone under its name in its domain.

    Args:
        session: How it gets at the others.
        domain: ROS_DOMAIN_ID.
        namespace: From "/" on.
        name: Name in its namespace.

    Raises:
        SkinnetError: there is already a node of this name.
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
        """Announces a publisher on `topic`."""
        entity = self._endpoint(Kind.PUBLISHER, topic, type_name, qos)
        reliable = qos.reliability is Reliability.RELIABLE
        if qos.durability is Durability.TRANSIENT_LOCAL:
            sender = self._session.keeping_publisher(entity.key, reliable=reliable, kept=qos.depth)
        else:
            sender = self._session.publisher(entity.key, reliable=reliable)
        self._session.announce(entity.token)
        return RosPublisher(entity, sender, time.time_ns)

    def subscribe(self, topic: str, type_name: str, qos: Qos, on_sample: OnSample) -> None:
        """Announces a subscription to `topic`; `on_sample` gets what is published there, as bytes."""
        entity = self._endpoint(Kind.SUBSCRIPTION, topic, type_name, qos)
        self._session.subscribe(entity.key, on_sample)
        self._session.announce(entity.token)

    def watch_publishers(self, topic: str, on_change: Callable[[str, bool], None]) -> None:
        """Calls `on_change` with the token of each publisher on `topic`, and whether it is there."""
        self._session.on_alive(publishers_of(self._node.domain, topic), on_change)

    def _endpoint(self, kind: Kind, topic: str, type_name: str, qos: Qos) -> Entity:
        self._endpoints += 1
        described = wire_type(type_name), type_hash(type_name), qos.compact
        return Entity(self._node, kind, self._endpoints, topic, *described)
