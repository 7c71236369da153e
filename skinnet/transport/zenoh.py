"""The Zenoh transport; the only file that imports `zenoh`.

A star: the hub listens as a peer, everybody else is its client. In a mesh, messages of different senders
overtake each other. Everything in the loop has one priority and BLOCK, since mixed priorities
break causal order. A receiver that sticks would make Zenoh close the transport after five
seconds, so the wait before closing is set beyond any deadline of ours.
"""

import json
from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from skinnet.errors import PortInUseError, SkinnetError
from skinnet.transport.base import Delivery, OnMessage
from skinnet.transport.mailbox import Mailbox

__all__ = ["ZenohTransport", "open_session"]

_LEASE_MS = 2_000
_WAIT_BEFORE_CLOSE_US = 120_000_000
_CONNECT_TIMEOUT_MS = 60_000


def open_session(*, listen: str | None = None, connect: str | None = None) -> Any:
    """A Zenoh session that listens as a hub or connects as a client, and never scouts.

    Raises:
        PortInUseError: the endpoint to listen on is taken.
        SkinnetError: the endpoint is no Zenoh endpoint, or nobody answers there.
    """
    settings: dict[str, Any] = {
        "mode": "peer" if listen else "client",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": _WAIT_BEFORE_CLOSE_US,
        "connect/timeout_ms": _CONNECT_TIMEOUT_MS,
        "connect/exit_on_failure": True,
    }
    if listen:
        settings["listen/endpoints"] = [listen]
    if connect:
        settings["connect/endpoints"] = [connect]
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if "in use" in str(error).lower():
            raise PortInUseError(
                f"--listen {listen}: that port is already taken; choose another, or port 0 for a free one"
            ) from error
        verb = f"listen on {listen}" if listen else f"connect to {connect}"
        reason = str(error).splitlines()[0][:200]
        raise SkinnetError(f"Zenoh cannot {verb}: {reason}") from error


class ZenohTransport:
    """One session, one wildcard subscriber per expression, one mailbox."""

    def __init__(self, *, listen: str | None = None, connect: str | None = None) -> None:
        self._session = open_session(listen=listen, connect=connect)
        self._mailbox = Mailbox()
        self._entities: list[Any] = []
        self.receive = self._mailbox.receive

    def subscribe(self, expression: str) -> None:
        """Delivers what is put on keys that match `expression`."""
        post = self._mailbox.post
        self.tap(expression, lambda key, payload: post(Delivery(key, payload)))

    def tap(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Calls `on_message` in a thread of Zenoh's."""

        def on_sample(sample: Any) -> None:
            on_message(str(sample.key_expr), sample.payload.to_bytes())

        subscriber = self._session.declare_subscriber(expression, on_sample)
        self._entities.append(subscriber)
        undo: Callable[[], None] = subscriber.undeclare
        return undo

    def watch_alive(self, expression: str) -> None:
        """Delivers the coming and going of liveliness tokens, with those that are there already."""
        post = self._mailbox.post

        def on_change(sample: Any) -> None:
            there = sample.kind == zenoh.SampleKind.PUT
            post(Delivery(str(sample.key_expr), b"" if there else None))

        liveliness = self._session.liveliness()
        self._entities.append(liveliness.declare_subscriber(expression, on_change, history=True))

    def announce(self, key: str) -> None:
        """Declares the liveliness token `key`."""
        self._entities.append(self._session.liveliness().declare_token(key))

    def put(self, key: str, payload: bytes, *, flush: bool = False) -> None:
        """Sends `payload`; `flush` bypasses batching, for what closes a period."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK, express=flush)

    def put_droppable(self, key: str, payload: bytes) -> None:
        """Sends `payload` to whoever keeps up; never waits for a slow receiver."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def on_interest(self, expression: str, on_change: Callable[[bool], None]) -> None:
        """Calls `on_change` when the first subscriber for `expression` comes and when the last goes."""
        publisher = self._session.declare_publisher(expression)
        listener = publisher.declare_matching_listener(lambda status: on_change(status.matching))
        self._entities.extend((publisher, listener))

    def serve(self, expression: str, answer: Callable[[], Mapping[str, bytes]]) -> None:
        """Answers queries that match `expression` with the payloads by key that `answer` gives."""

        def on_query(query: Any) -> None:
            with query:
                for key, payload in answer().items():
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, payload)

        self._entities.append(self._session.declare_queryable(expression, on_query))

    def close(self) -> None:
        """Sends what is waiting and leaves."""
        self._entities.clear()
        self._session.close()
