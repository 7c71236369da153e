"""The Zenoh transport; the only file that imports `zenoh`.

A star: the hub listens as a peer, everybody else is its client. In a mesh, messages of different senders
overtake each other. Everything in the loop has one priority and BLOCK, since mixed priorities
break causal order. A receiver that sticks would make Zenoh close the transport after five
seconds, so the wait before closing is set beyond any deadline of ours.

Each hop of a message wakes threads in three processes, whatever its size. So the messages that a process
puts in one period leave as one envelope for each kind of receivers, under
`skinnet/<robot>/loop/<process>/<receivers>`, and are taken out where they arrive. An envelope carries the
time of its departure by the machine's monotonic clock, so that its receiver knows how long it was under way.
"""

import json
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from itertools import product
from typing import Any

import msgspec
import numpy as np
import zenoh
from numpy.typing import NDArray

from skinnet.channels import Keys
from skinnet.errors import PortInUseError, SkinnetError
from skinnet.transport.base import Delivery, OnMessage, matches
from skinnet.transport.mailbox import ThreadMailbox

__all__ = ["ZenohTransport"]

_LEASE_MS = 2_000
_WAIT_BEFORE_CLOSE_US = 120_000_000
_CONNECT_TIMEOUT_MS = 60_000
_KNOWN_KEYS = 100_000
_TRANSIT_BINS = 100_001
"""Microseconds up to 0.1 s."""

log = logging.getLogger(__name__)

_Messages = list[tuple[str, bytes]]
_seal = msgspec.msgpack.Encoder().encode
_open = msgspec.msgpack.Decoder(tuple[int, _Messages]).decode


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


class _Arrivals:
    """The envelopes of one subscription: opens them, hands on what is wanted, counts.

    Zenoh has a thread for each subscription, so each has counts of its own.
    """

    def __init__(self, expressions: tuple[str, ...], on_messages: Callable[[list[Delivery]], None]) -> None:
        self._expressions = expressions
        self._on_messages = on_messages
        self._wanted: dict[str, bool] = {}
        self.malformed = 0
        self.n_bytes = 0
        self.by_transit_us: dict[int, int] = {}

    def take(self, _key: str, envelope: bytes) -> None:
        try:
            t_sent_ns, messages = _open(envelope)
        except msgspec.DecodeError:
            self.malformed += 1
            return
        transit_us = min(max(time.monotonic_ns() - t_sent_ns, 0) // 1000, _TRANSIT_BINS - 1)
        self.by_transit_us[transit_us] = self.by_transit_us.get(transit_us, 0) + 1
        self.n_bytes += len(envelope)
        wanted = self._wanted
        deliveries = [
            Delivery(key, payload)
            for key, payload in messages
            if (self._is_wanted(key) if (known := wanted.get(key)) is None else known)
        ]
        if deliveries:
            self._on_messages(deliveries)

    def _is_wanted(self, key: str) -> bool:
        wanted = any(matches(expression, key) for expression in self._expressions)
        if len(self._wanted) < _KNOWN_KEYS:
            self._wanted[key] = wanted
        return wanted


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
        self._outbox: dict[str, _Messages] = {}
        self._arrivals: list[_Arrivals] = []
        self.receive = self._mailbox.receive
        self.sent_bytes = 0

    @property
    def received_bytes(self) -> int:
        """Bytes of the envelopes that came in."""
        return sum(arrivals.n_bytes for arrivals in self._arrivals)

    @property
    def malformed(self) -> int:
        """Envelopes that could not be opened."""
        return sum(arrivals.malformed for arrivals in self._arrivals)

    @property
    def transit_us(self) -> NDArray[np.int64]:
        """Envelopes by time from departure to acceptance [µs], one a bin; the last takes what is longer.

        It makes sense between processes of one machine.
        """
        histogram = np.zeros(_TRANSIT_BINS, dtype=np.int64)
        for arrivals in self._arrivals:
            for transit_us, count in arrivals.by_transit_us.copy().items():
                histogram[transit_us] += count
        return histogram

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Takes the messages that match out of the envelopes of `senders`."""
        chosen = tuple(expressions)
        lanes = sorted({self._keys.lane(expression) for expression in chosen})
        for sender, lane in product(senders, lanes):
            self._unpack(f"{sender}/{lane}", _Arrivals(chosen, self._mailbox.post_all))

    def overhear(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Takes the messages that match out of everybody's envelopes."""

        def on_messages(deliveries: list[Delivery]) -> None:
            for key, payload in deliveries:
                if payload is not None:
                    on_message(key, payload)

        return self._unpack(f"*/{self._keys.lane(expression)}", _Arrivals((expression,), on_messages))

    def _unpack(self, envelopes: str, arrivals: "_Arrivals") -> Callable[[], None]:
        self._arrivals.append(arrivals)
        return self.tap(self._loop_prefix + envelopes, arrivals.take)

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
        for lane, messages in self._outbox.items():
            envelope = _seal((time.monotonic_ns(), messages))
            self.sent_bytes += len(envelope)
            self._session.put(
                self._own_prefix + lane,
                envelope,
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
