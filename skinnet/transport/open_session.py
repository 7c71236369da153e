"""A Zenoh session beside the loop: whoever watches a run, or speaks to another system, goes through it.

The loop's own transport knows the robot's keys and waits for receivers. Here keys are anybody's, payloads
may have an attachment, and nobody waits for a slow receiver.
"""

import logging
from collections.abc import Callable
from typing import Any, Literal, Protocol

import zenoh
from zenoh import ext

from skinnet.transport.zenoh_session import collect, open_session

__all__ = ["OnSample", "OpenSession", "Publisher"]

OnSample = Callable[[str, bytes, bytes | None], None]
"""Called with key, payload and attachment, in a thread of Zenoh's: be quick."""

_CONNECT_MS = 3_000
_CLIENT = {"transport/link/tx/lease": 10_000, "timestamping/enabled": True}
"""Zenoh's own lease; and time stamps, by which publishers that keep messages number them."""
_ROUTER = _CLIENT | {"mode": "router", "scouting/gossip/enabled": True}
"""Peers that know only a router learn of each other by its gossip, and by nothing else."""
_HEARTBEAT_S = 0.5

log = logging.getLogger(__name__)


class Publisher(Protocol):
    """Sends on one key."""

    @property
    def wanted(self) -> bool:
        """Whether anybody subscribes."""

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Sends to whoever keeps up."""


class OpenSession:
    """One session, closed by `close`.

    Args:
        role: "client" of whoever listens at `endpoint`; "router" listens there and brings others together.
        endpoint: As in tcp/127.0.0.1:7447.

    Raises:
        PortInUseError: the endpoint to listen on is taken.
        UnreachableError: it is no Zenoh endpoint, or nobody answers there.
        SkinnetError: it is none to listen on.
    """

    def __init__(self, role: Literal["client", "router"], endpoint: str) -> None:
        if role == "router":
            self._session = open_session(endpoint, None, more=_ROUTER)
        else:
            self._session = open_session(None, endpoint, _CONNECT_MS, _CLIENT)
        self._entities: list[Any] = []

    @property
    def zid(self) -> str:
        """Zenoh's id of this session, in hexadecimal digits."""
        return str(self._session.info.zid())

    @property
    def connected(self) -> bool:
        """Whether there is a peer at the other end."""
        return bool(self._session.info.transports())

    def subscribe(self, expression: str, on_sample: OnSample) -> None:
        """Calls `on_sample` for what is put on keys that match."""

        def on_arrival(sample: Any) -> None:
            attachment = None if sample.attachment is None else sample.attachment.to_bytes()
            on_sample(str(sample.key_expr), sample.payload.to_bytes(), attachment)

        self._entities.append(self._session.declare_subscriber(expression, on_arrival))

    def ask(self, expression: str, timeout_s: float) -> dict[str, bytes]:
        """Answers to a query by their keys; empty if nobody answers."""
        return _samples(lambda handler: self._session.get(expression, handler, timeout=timeout_s))

    def announce(self, key: str) -> None:
        """Declares the liveliness token `key`."""
        self._entities.append(self._session.liveliness().declare_token(key))

    def present(self, expression: str, timeout_s: float) -> frozenset[str]:
        """Liveliness tokens of others that are there now."""
        get = self._session.liveliness().get
        return frozenset(_samples(lambda handler: get(expression, handler, timeout=timeout_s)))

    def on_alive(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        """Calls `on_change` with each token that is there or comes, and True, and when it goes, and False."""

        def on_sample(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        liveliness = self._session.liveliness()
        self._entities.append(liveliness.declare_subscriber(expression, on_sample, history=True))

    def tell(self, key: str, payload: bytes) -> None:
        """Sends `payload` once, to whoever keeps up."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def publisher(self, key: str, *, reliable: bool) -> Publisher:
        """Sends on `key`, over a reliable link or the fastest there is."""
        publisher = self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
        )
        return _Publisher(publisher, publisher)

    def keeping_publisher(self, key: str, *, reliable: bool, kept: int) -> Publisher:
        """Sends on `key`, and the last `kept` messages again to advanced subscribers that come later."""
        publisher = ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
            cache=ext.CacheConfig(kept),
            sample_miss_detection=(
                ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S) if reliable else None
            ),
            publisher_detection=True,
        )
        return _Publisher(publisher, None)

    def close(self) -> None:
        """Leaves; tokens go."""
        self._entities.clear()
        try:
            self._session.close()
        except zenoh.ZError as error:
            log.warning("a peer did not answer when the session was closed: %s", str(error).splitlines()[0])


class _Publisher:
    def __init__(self, publisher: Any, matching: Any) -> None:
        self._publisher, self._matching = publisher, matching

    @property
    def wanted(self) -> bool:
        return self._matching is None or bool(self._matching.matching_status.matching)

    def put(self, payload: bytes, attachment: bytes) -> None:
        self._publisher.put(payload, attachment=attachment)


def _samples(start: Callable[[Any], None]) -> dict[str, bytes]:
    """Payloads by key of the good replies to a query."""
    found = (reply.ok for reply in collect(start))
    return {str(sample.key_expr): sample.payload.to_bytes() for sample in found if sample is not None}
