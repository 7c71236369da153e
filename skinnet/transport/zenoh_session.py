"""Zenoh session: the only module that imports Zenoh.

Sessions find each other by endpoints only, without scouting. All messages of the loop have one priority and
congestion control BLOCK, since mixed priorities break causal order. Zenoh by default closes a transport whose
receiver blocks for five seconds, so `wait_before_close` and the leases are set beyond the loop's deadline.
"""

import contextlib
import itertools
import json
import logging
import threading
from collections.abc import Callable, Mapping
from typing import Any, Literal

import zenoh
from zenoh import ext

from skinnet.errors import PortInUseError, SkinnetError, UnreachableError
from skinnet.transport.interface import OnLiveliness, OnMessage, Query, Reply, Undeclare

__all__ = ["HUB_TIMEOUT_S", "OnSample", "Publisher", "ZenohSession"]

OnSample = Callable[[str, bytes, bytes | None], None]
"""Sample callback (key, payload, attachment), in a thread of Zenoh; must not block."""

_LEASE_MS = 10_000
"""Lease of sessions outside the loop, and the shortest one in it: Zenoh's default."""
_LEASE_DEADLINES = 4
"""Lease of sessions in the loop, in deadlines of the run: a silent process misses its deadline first. One
that ends closes its connection and needs no lease."""
_WAIT_BEFORE_CLOSE_DEADLINES = 4
_WAIT_BEFORE_CLOSE_MS = 120_000
_MAX_MS = 86_400_000
"""Longest time [ms] that Zenoh is set to: a day."""
HUB_TIMEOUT_S = 60.0
"""Timeout [s] for the hub of a loop to answer."""
_CONNECT_TIMEOUT_S = 3.0
_TOKENS_TIMEOUT_S = 10.0
_HEARTBEAT_PERIOD_S = 0.5
_COMMON_SETTINGS = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": _LEASE_MS,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1000 * _WAIT_BEFORE_CLOSE_MS,
    "connect/exit_on_failure": True,
}
_EXTERNAL_SETTINGS = {"timestamping/enabled": True}
"""Settings for other systems: time stamps, by which advanced publishers number samples."""

log = logging.getLogger(__name__)


class ZenohSession:
    """Zenoh session of one process; made by one of the `open_` methods, ended by `close`.

    Callbacks run in threads of Zenoh and must not block. A function returned by `declare_` undeclares.

    Args:
        mode: Zenoh mode.
        endpoint: Zenoh endpoint, as in tcp/127.0.0.1:7447: a client connects to it, others listen there.
        settings: Further settings by their configuration key.

    Raises:
        PortInUseError: the endpoint to listen on is in use.
        UnreachableError: not a Zenoh endpoint, or nobody answers there.
        SkinnetError: not an endpoint to listen on.
    """

    def __init__(
        self, mode: Literal["peer", "router", "client"], endpoint: str, settings: Mapping[str, Any]
    ) -> None:
        direction = "connect" if mode == "client" else "listen"
        self._session = _open(
            endpoint, {**_COMMON_SETTINGS, "mode": mode, f"{direction}/endpoints": [endpoint], **settings}
        )
        self._entities: dict[int, tuple[Any, ...]] = {}
        self._serial = itertools.count()

    @classmethod
    def open_hub(cls, endpoint: str, deadline_s: float = 0.0) -> "ZenohSession":
        """Open a peer that listens: the hub of a loop with this deadline, or of observers."""
        return cls("peer", endpoint, _lease(deadline_s))

    @classmethod
    def open_member(
        cls, endpoint: str, deadline_s: float = 0.0, timeout_s: float = HUB_TIMEOUT_S
    ) -> "ZenohSession":
        """Open a client of the hub of a loop with this deadline, which may listen later."""
        return cls("client", endpoint, _lease(deadline_s) | _connect_timeout(timeout_s))

    @classmethod
    def open_client(cls, endpoint: str, timeout_s: float = _CONNECT_TIMEOUT_S) -> "ZenohSession":
        """Open a client of an observer endpoint or of another system."""
        return cls("client", endpoint, _EXTERNAL_SETTINGS | _connect_timeout(timeout_s))

    @classmethod
    def open_router(cls, endpoint: str) -> "ZenohSession":
        """Open a router; by gossip, peers that know only the router discover each other."""
        return cls("router", endpoint, _EXTERNAL_SETTINGS | {"scouting/gossip/enabled": True})

    @property
    def zid(self) -> str:
        """Zenoh id of this session, in hexadecimal digits."""
        return str(self._session.info.zid())

    @property
    def connected(self) -> bool:
        """Connection status: True if the session has a peer."""
        return bool(self._session.info.transports())

    def put(self, key: str, payload: bytes, *, lossless: bool = False) -> None:
        """Publish: best-effort, or `lossless` with `express`, bypassing Zenoh's own batching."""
        if lossless:
            self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, express=True)
        else:
            self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def declare_publisher(self, key: str, *, reliable: bool) -> "Publisher":
        """Declare a publisher on `key` with reliability RELIABLE or BEST_EFFORT."""
        publisher = self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.DROP, reliability=_reliability(reliable)
        )
        return Publisher(publisher, has_matching_status=True)

    def declare_advanced_publisher(self, key: str, *, reliable: bool, cache_size: int) -> "Publisher":
        """Declare an advanced publisher on `key`; it caches `cache_size` samples for late subscribers."""
        heartbeat = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_PERIOD_S)
        publisher = ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=_reliability(reliable),
            cache=ext.CacheConfig(cache_size),
            sample_miss_detection=heartbeat if reliable else None,
            publisher_detection=True,
        )
        return Publisher(publisher, has_matching_status=False)

    def declare_subscriber(self, expression: str, on_message: OnMessage) -> Undeclare:
        """Declare a subscriber to samples on matching keys."""

        def on_sample(sample: Any) -> None:
            on_message(str(sample.key_expr), sample.payload.to_bytes())

        return self._hold(self._session.declare_subscriber(expression, on_sample))

    def declare_sample_subscriber(self, expression: str, on_sample: OnSample) -> Undeclare:
        """Declare a subscriber that gets the attachments of samples, too."""

        def on_arrival(sample: Any) -> None:
            attachment = None if sample.attachment is None else sample.attachment.to_bytes()
            on_sample(str(sample.key_expr), sample.payload.to_bytes(), attachment)

        return self._hold(self._session.declare_subscriber(expression, on_arrival))

    def matching_listener(self, expression: str) -> Callable[[], bool]:
        """Declare a matching listener: the status is queried once, then updated by the hub."""
        publisher = self._session.declare_publisher(expression)
        matching = [bool(publisher.matching_status.matching)]
        listener = publisher.declare_matching_listener(
            lambda status: matching.__setitem__(0, status.matching)
        )
        self._hold(listener, publisher)
        return lambda: matching[0]

    def declare_matching_listener(self, expression: str, on_change: Callable[[bool], None]) -> Undeclare:
        """Declare a matching listener: call `on_change` at the first and after the last subscriber."""
        publisher = self._session.declare_publisher(expression)
        listener = publisher.declare_matching_listener(lambda status: on_change(status.matching))
        return self._hold(listener, publisher)

    def declare_token(self, key: str) -> Undeclare:
        """Declare the liveliness token `key`."""
        return self._hold(self._session.liveliness().declare_token(key))

    def declare_liveliness_subscriber(self, expression: str, on_change: OnLiveliness) -> Undeclare:
        """Declare a liveliness subscriber: each present or new token (True), each lost one (False)."""

        def on_sample(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        liveliness = self._session.liveliness()
        return self._hold(liveliness.declare_subscriber(expression, on_sample, history=True))

    def liveliness_tokens(self, expression: str, timeout_s: float = _TOKENS_TIMEOUT_S) -> frozenset[str]:
        """Query the liveliness tokens present now, including this session's."""
        get = self._session.liveliness().get
        replies = _collect_replies(lambda handler: get(expression, handler, timeout=timeout_s))
        return frozenset(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def declare_queryable(self, expression: str, on_query: Callable[[Query], None]) -> Undeclare:
        """Declare a queryable; `on_query` may keep the query and answer it later."""
        return self._hold(
            self._session.declare_queryable(expression, lambda query: on_query(_PendingQuery(query)))
        )

    def get(self, expression: str, timeout_s: float, payload: bytes | None = None) -> list[Reply]:
        """Query `expression` and wait for all replies; empty if no queryable matches.

        The last reply is an error if one did not come within `timeout_s` [s].
        """
        found, late = [], False
        for reply in _collect_replies(
            lambda handler: self._session.get(expression, handler, payload=payload, timeout=timeout_s)
        ):
            if reply.ok is not None:
                found.append(Reply(str(reply.ok.key_expr), reply.ok.payload.to_bytes(), ""))
            elif (error := reply.err.payload.to_bytes().decode(errors="replace")) == "Timeout":
                late = True  # each hop of the query may report it
            else:
                found.append(Reply("", b"", error))
        return [*found, Reply("", b"", f"no reply within {timeout_s:g} s")] if late else found

    def close(self) -> None:
        """Close the session, even if a peer does not respond; its liveliness tokens are undeclared."""
        self._entities.clear()
        try:
            self._session.close()
        except zenoh.ZError as error:
            log.warning(
                "a peer did not respond to the closing of the session: %s", str(error).splitlines()[0]
            )

    def _hold(self, *entities: Any) -> Undeclare:
        """Hold Zenoh entities, which are undeclared when nothing refers to them."""
        serial = next(self._serial)
        self._entities[serial] = entities

        def undeclare() -> None:
            for entity in self._entities.pop(serial, ()):
                entity.undeclare()

        return undeclare


class Publisher:
    """Publisher on one key, best-effort: slow subscribers lose samples."""

    def __init__(self, publisher: Any, *, has_matching_status: bool) -> None:
        self._publisher, self._has_matching_status = publisher, has_matching_status

    @property
    def has_subscribers(self) -> bool:
        """Matching status: False if the key has no subscriber; advanced publishers have none to query."""
        return not self._has_matching_status or bool(self._publisher.matching_status.matching)

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish a sample with an attachment."""
        self._publisher.put(payload, attachment=attachment)


class _PendingQuery:
    """Zenoh query whose reply is pending."""

    def __init__(self, query: Any) -> None:
        self._query = query
        self.key = str(query.key_expr)
        self.parameters = dict(query.parameters)
        self.payload = b"" if query.payload is None else query.payload.to_bytes()

    def reply(self, key: str, payload: bytes) -> None:
        """Reply with `payload` on `key`; ignore a client that is gone."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply(key, payload)

    def reply_values(self, values: Mapping[str, bytes]) -> None:
        """Reply with the payloads whose key the query matches; ignore a client that is gone."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            for key, payload in values.items():
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, payload)

    def reply_error(self, reason: str) -> None:
        """Reply with an error text; ignore a client that is gone."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(reason)

    def drop(self) -> None:
        """Drop the query without a reply."""
        self._query.drop()


def _lease(deadline_s: float) -> dict[str, Any]:
    """Settings by which a loop with this deadline finds a process silent before Zenoh takes it for dead."""
    deadline_ms = round(min(1000.0 * deadline_s, _MAX_MS))
    close_ms = max(_WAIT_BEFORE_CLOSE_MS, _WAIT_BEFORE_CLOSE_DEADLINES * deadline_ms)
    return {
        "transport/link/tx/lease": max(_LEASE_MS, _LEASE_DEADLINES * deadline_ms),
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 1000 * close_ms,
    }


def _connect_timeout(timeout_s: float) -> dict[str, Any]:
    return {"connect/timeout_ms": max(1, round(1000 * timeout_s))}


def _reliability(reliable: bool) -> Any:
    return zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT


def _open(endpoint: str, settings: Mapping[str, Any]) -> Any:
    config = zenoh.Config()
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        if "in use" in str(error).lower():
            raise PortInUseError(
                f"--listen {endpoint}: that port is already taken; choose another, or leave --listen out"
            ) from error
        if settings["mode"] != "client":
            reason = str(error).splitlines()[0][:200]
            raise SkinnetError(f"Zenoh cannot listen on {endpoint}: {reason}") from error
        raise UnreachableError(
            f"{endpoint}: no Zenoh endpoint, or nobody answers there; write it as in tcp/127.0.0.1:7447"
        ) from error


def _collect_replies(send_query: Callable[[Any], None]) -> list[Any]:
    """Collect all replies to the query that `send_query` sends with the given handler; block until complete.

    Zenoh's default handler holds 256 replies until they are read, and cannot be waited for.
    """
    replies: list[Any] = []
    complete = threading.Event()
    send_query(zenoh.handlers.Callback(replies.append, complete.set))
    complete.wait()
    return replies
