"""Public Zenoh session outside the loop, for observers and bridges to other systems.

The transport of the loop uses the robot's keys only and blocks on slow receivers. This session takes any key,
payloads may have an attachment, and congestion drops messages.
"""

import logging
from collections.abc import Callable
from typing import Any, Literal, Protocol

import zenoh
from zenoh import ext

from skinnet.transport.zenoh_session import collect_replies, open_session

__all__ = ["OnSample", "PublicSession", "Publisher"]

OnSample = Callable[[str, bytes, bytes | None], None]
"""Sample callback (key, payload, attachment), in a thread of Zenoh; must not block."""

_CONNECT_TIMEOUT_MS = 3_000
_CLIENT_SETTINGS = {"transport/link/tx/lease": 10_000, "timestamping/enabled": True}
"""Client settings: Zenoh's default lease; time stamps, by which advanced publishers number samples."""
_ROUTER_SETTINGS = _CLIENT_SETTINGS | {"mode": "router", "scouting/gossip/enabled": True}
"""Router settings: gossip, by which peers that know only the router discover each other."""
_HEARTBEAT_PERIOD_S = 0.5

log = logging.getLogger(__name__)


class Publisher(Protocol):
    """Publisher on one key."""

    @property
    def has_subscribers(self) -> bool:
        """Matching status: True if the key has a subscriber."""

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish best-effort: slow subscribers lose samples."""


class PublicSession:
    """Zenoh session outside the loop; end it with `close`.

    Args:
        role: "client" connects to `endpoint`; "router" listens there and routes between others.
        endpoint: Zenoh endpoint, as in tcp/127.0.0.1:7447.

    Raises:
        PortInUseError: the endpoint to listen on is in use.
        UnreachableError: not a Zenoh endpoint, or nobody answers there.
        SkinnetError: not an endpoint to listen on.
    """

    def __init__(self, role: Literal["client", "router"], endpoint: str) -> None:
        if role == "router":
            self._session = open_session(endpoint, None, extra_settings=_ROUTER_SETTINGS)
        else:
            self._session = open_session(None, endpoint, _CONNECT_TIMEOUT_MS, _CLIENT_SETTINGS)
        self._entities: list[Any] = []

    @property
    def zid(self) -> str:
        """Zenoh id of this session, in hexadecimal digits."""
        return str(self._session.info.zid())

    @property
    def connected(self) -> bool:
        """Connection status: True if the session has a peer."""
        return bool(self._session.info.transports())

    def declare_subscriber(self, expression: str, on_sample: OnSample) -> None:
        """Declare a subscriber: call `on_sample` for samples on keys that match."""

        def on_arrival(sample: Any) -> None:
            attachment = None if sample.attachment is None else sample.attachment.to_bytes()
            on_sample(str(sample.key_expr), sample.payload.to_bytes(), attachment)

        self._entities.append(self._session.declare_subscriber(expression, on_arrival))

    def query(self, expression: str, timeout_s: float) -> dict[str, bytes]:
        """Query `expression`; return the reply payloads by key, empty if nobody answers."""
        return _reply_payloads(lambda handler: self._session.get(expression, handler, timeout=timeout_s))

    def declare_token(self, key: str) -> None:
        """Declare the liveliness token `key`."""
        self._entities.append(self._session.liveliness().declare_token(key))

    def liveliness_tokens(self, expression: str, timeout_s: float) -> frozenset[str]:
        """Query the liveliness tokens of other sessions."""
        get = self._session.liveliness().get
        return frozenset(_reply_payloads(lambda handler: get(expression, handler, timeout=timeout_s)))

    def declare_liveliness_subscriber(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        """Subscribe to liveliness: each present or new token (True), each lost one (False)."""

        def on_sample(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        liveliness = self._session.liveliness()
        self._entities.append(liveliness.declare_subscriber(expression, on_sample, history=True))

    def publish_best_effort(self, key: str, payload: bytes) -> None:
        """Publish one sample best-effort: slow subscribers lose it."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def declare_publisher(self, key: str, *, reliable: bool) -> Publisher:
        """Declare a publisher on `key` with reliability RELIABLE or BEST_EFFORT."""
        publisher = self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
        )
        return _Publisher(publisher, publisher)

    def declare_advanced_publisher(self, key: str, *, reliable: bool, cache_size: int) -> Publisher:
        """Declare an advanced publisher on `key`; it caches `cache_size` samples for late subscribers."""
        publisher = ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
            cache=ext.CacheConfig(cache_size),
            sample_miss_detection=(
                ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_PERIOD_S)
                if reliable
                else None
            ),
            publisher_detection=True,
        )
        return _Publisher(publisher, None)

    def close(self) -> None:
        """Close the session; its liveliness tokens are undeclared."""
        self._entities.clear()
        try:
            self._session.close()
        except zenoh.ZError as error:
            log.warning("a peer did not answer when the session was closed: %s", str(error).splitlines()[0])


class _Publisher:
    def __init__(self, publisher: Any, matching: Any) -> None:
        self._publisher, self._matching = publisher, matching

    @property
    def has_subscribers(self) -> bool:
        return self._matching is None or bool(self._matching.matching_status.matching)

    def put(self, payload: bytes, attachment: bytes) -> None:
        self._publisher.put(payload, attachment=attachment)


def _reply_payloads(send_query: Callable[[Any], None]) -> dict[str, bytes]:
    """Return the payloads by key of the replies without an error."""
    found = (reply.ok for reply in collect_replies(send_query))
    return {str(sample.key_expr): sample.payload.to_bytes() for sample in found if sample is not None}
