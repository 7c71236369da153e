"""The Zenoh transport; the only file that imports `zenoh`.

A star: the hub listens as a peer, everybody else is its client. In a mesh, messages of different senders
overtake each other. Everything in the loop has one priority and BLOCK, since mixed priorities
break causal order. A receiver that sticks would make Zenoh close the transport after five
seconds, so the wait before closing is set beyond any deadline of ours.

Each hop of a message wakes threads in three processes, whatever its size. So the messages that a process
puts in one period leave as one envelope for each kind of receivers, under
`skinnet/<robot>/loop/<process>/<receivers>`, and are taken out where they arrive.
"""

import json
import logging
from collections.abc import Callable, Iterable, Mapping
from itertools import product
from typing import Any

import msgspec
import zenoh

from skinnet.channels import Keys
from skinnet.errors import PortInUseError, SkinnetError
from skinnet.transport.base import Delivery, OnMessage, matches
from skinnet.transport.mailbox import ThreadMailbox

__all__ = ["ZenohTransport"]

_LEASE_MS = 2_000
_WAIT_BEFORE_CLOSE_US = 120_000_000
_CONNECT_TIMEOUT_MS = 60_000
_KNOWN_KEYS = 100_000

log = logging.getLogger(__name__)

Envelope = list[tuple[str, bytes]]
_seal = msgspec.msgpack.Encoder().encode
_open = msgspec.msgpack.Decoder(Envelope).decode


def _open_session(listen: str | None, connect: str | None) -> Any:
    """A Zenoh session that listens as a hub or connects as a client, and never scouts."""
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
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        if "in use" in str(error).lower():
            raise PortInUseError(
                f"--listen {listen}: that port is already taken; choose another, or leave --listen out"
            ) from error
        verb = f"listen on {listen}" if listen else f"connect to {connect}"
        reason = str(error).splitlines()[0][:200]
        raise SkinnetError(f"Zenoh cannot {verb}: {reason}") from error


class ZenohTransport:
    """One session of one process.

    Args:
        keys: Keys of the robot.
        name: Name of the process.
        listen: Endpoint to listen on as the hub.
        connect: Endpoint of the hub.

    Raises:
        PortInUseError: the endpoint to listen on is taken.
        SkinnetError: the endpoint is no Zenoh endpoint, or nobody answers there.
    """

    def __init__(
        self, keys: Keys, name: str, *, listen: str | None = None, connect: str | None = None
    ) -> None:
        self._session = _open_session(listen, connect)
        self._keys = keys
        self._loop_prefix = f"{keys.prefix}loop/"
        self._own_prefix = f"{self._loop_prefix}{name}/"
        self._mailbox = ThreadMailbox()
        self._entities: list[Any] = []
        self._outbox: dict[str, Envelope] = {}
        self.receive = self._mailbox.receive
        self.malformed = 0

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Takes the messages that match out of the envelopes of `senders`."""
        post = self._mailbox.post
        chosen = tuple(expressions)
        lanes = sorted({self._keys.lane(expression) for expression in chosen})
        for sender, lane in product(senders, lanes):
            self._unpack(f"{sender}/{lane}", chosen, lambda key, payload: post(Delivery(key, payload)))

    def overhear(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Takes the messages that match out of everybody's envelopes."""
        return self._unpack(f"*/{self._keys.lane(expression)}", (expression,), on_message)

    def _unpack(
        self, envelopes: str, expressions: tuple[str, ...], on_message: OnMessage
    ) -> Callable[[], None]:
        wanted: dict[str, bool] = {}

        def on_sample(_key: str, payload: bytes) -> None:
            try:
                envelope = _open(payload)
            except msgspec.DecodeError:
                self.malformed += 1
                return
            for key, message in envelope:
                known = wanted.get(key)
                if known is None:
                    known = any(matches(expression, key) for expression in expressions)
                    if len(wanted) < _KNOWN_KEYS:
                        wanted[key] = known
                if known:
                    on_message(key, message)

        return self.tap(self._loop_prefix + envelopes, on_sample)

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

    def put(self, key: str, payload: bytes) -> None:
        """Adds a message to the envelope of this period for its receivers."""
        self._outbox.setdefault(self._keys.lane(key), []).append((key, payload))

    def flush(self) -> None:
        """Sends the envelopes, past Zenoh's own batching: whoever gets them is waiting for them."""
        for lane, envelope in self._outbox.items():
            self._session.put(
                self._own_prefix + lane,
                _seal(envelope),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
            )
        self._outbox.clear()

    def tell(self, key: str, payload: bytes) -> None:
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
        """Sends what is waiting and leaves, even if a peer is stuck and does not take the farewell."""
        self.flush()
        self._entities.clear()
        try:
            self._session.close()
        except zenoh.ZError as error:
            log.warning("a peer did not answer when the session was closed: %s", str(error).splitlines()[0])
