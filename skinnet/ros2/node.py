"""ROS graph node on a Zenoh session, with publishers, subscriptions and their liveliness tokens."""

import time
from collections.abc import Callable
from typing import Any

from skinnet.errors import SkinnetError
from skinnet.ros2.attachment import Attachment, gid_of
from skinnet.ros2.message_types import encode, type_hash
from skinnet.ros2.qos import Durability, QosProfile, Reliability
from skinnet.ros2.rmw_zenoh_keys import (
    Entity,
    EntityType,
    NodeInfo,
    dds_type_name,
    publisher_tokens_expression,
)
from skinnet.transport.zenoh_session import OnSample, Publisher, ZenohSession

__all__ = ["RosNode", "RosPublisher"]

_QUERY_TIMEOUT_S = 5.0


class RosPublisher:
    """Publisher of one message type on one topic.

    Attributes:
        entity: Graph entity of the publisher.
        n_sent: Number of published messages.
    """

    def __init__(self, entity: Entity, publisher: Publisher, clock_ns: Callable[[], int]) -> None:
        self.entity = entity
        self.n_sent = 0
        self._gid = gid_of(entity.liveliness_token)
        self._publisher, self._clock_ns = publisher, clock_ns

    @property
    def has_subscribers(self) -> bool:
        """Matching status: whether there is a subscription."""
        return self._publisher.has_subscribers

    def publish(self, message: Any) -> None:
        """Publish `message`; subscribers that do not keep up may miss it."""
        self.n_sent += 1
        self._publisher.put(encode(message), Attachment(self.n_sent, self._clock_ns(), self._gid).pack())


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

    def __init__(self, session: ZenohSession, domain: int, namespace: str, name: str) -> None:
        self._session = session
        self._node = NodeInfo(domain, session.zid, 0, namespace, name)
        self._n_endpoints = 0
        own = Entity(self._node, EntityType.NODE, 0)
        anyone = Entity(self._node._replace(session_id="*"), EntityType.NODE, 0).liveliness_token
        if session.liveliness_tokens(anyone, _QUERY_TIMEOUT_S) - {own.liveliness_token}:
            raise SkinnetError(f"{namespace}/{name}: a node of that name already exists in domain {domain}")
        session.declare_token(own.liveliness_token)

    def create_publisher(self, topic: str, type_name: str, qos: QosProfile) -> RosPublisher:
        """Declare a publisher on `topic`."""
        entity = self._new_entity(EntityType.PUBLISHER, topic, type_name, qos)
        reliable = qos.reliability is Reliability.RELIABLE
        if qos.durability is Durability.TRANSIENT_LOCAL:
            sender = self._session.declare_advanced_publisher(
                entity.topic_key, reliable=reliable, cache_size=qos.depth
            )
        else:
            sender = self._session.declare_publisher(entity.topic_key, reliable=reliable)
        self._session.declare_token(entity.liveliness_token)
        return RosPublisher(entity, sender, time.time_ns)

    def create_subscription(self, topic: str, type_name: str, qos: QosProfile, on_sample: OnSample) -> None:
        """Declare a subscription to `topic`; `on_sample` gets the encoded messages."""
        entity = self._new_entity(EntityType.SUBSCRIPTION, topic, type_name, qos)
        self._session.declare_sample_subscriber(entity.topic_key, on_sample)
        self._session.declare_token(entity.liveliness_token)

    def on_publisher_liveliness(self, topic: str, on_change: Callable[[str, bool], None]) -> None:
        """Call `on_change` with the token of each publisher on `topic`, and whether it is alive."""
        self._session.declare_liveliness_subscriber(
            publisher_tokens_expression(self._node.domain_id, topic), on_change
        )

    def _new_entity(self, kind: EntityType, topic: str, type_name: str, qos: QosProfile) -> Entity:
        self._n_endpoints += 1
        described = dds_type_name(type_name), type_hash(type_name), qos.compact_form
        return Entity(self._node, kind, self._n_endpoints, topic, *described)
