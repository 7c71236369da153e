"""Zenoh transport of the loop.

The topology is a star: the hub listens as a peer, all others are its clients. In a mesh, messages of
different senders overtake each other. All messages have one priority and congestion control BLOCK, since
mixed priorities break causal order. Zenoh by default closes a transport whose receiver blocks for five
seconds, so `wait_before_close` is set beyond any deadline of the loop.

Each hop of a message wakes threads in three processes, whatever its size. So the messages that a process
puts in one period are sent as one batch per route group, under `skinnet/<robot>/loop/<process>/<receivers>`,
and unpacked by the receiver. The recorder, which has no deadline, gets several periods in one batch.
"""

import contextlib
import logging
from collections.abc import Callable, Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np
import zenoh
from numpy.typing import NDArray

from skinnet.channels import RECORDER, WATCHERS, Keys
from skinnet.transport.base import Delivery, OnMessage, Query
from skinnet.transport.envelope import TRANSIT_BINS, Arrivals, Messages, seal
from skinnet.transport.mailbox import ThreadMailbox
from skinnet.transport.zenoh_session import collect, open_session

__all__ = ["ZenohTransport"]

_PRESENT_S = 10.0  # timeout [s] for the hub to list the liveliness tokens

log = logging.getLogger(__name__)


class _HeldQuery:
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

    def refuse(self, why: str) -> None:
        """Reply with an error text; ignore a client that is gone."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(why)

    def drop(self) -> None:
        """Drop the query without a reply."""
        self._query.drop()


class ZenohTransport:
    """Zenoh transport of one process in the loop.

    Args:
        keys: Keys of the robot.
        name: Process name.
        listen: Zenoh endpoint to listen on as the hub.
        connect: Zenoh endpoint of the hub.

    Raises:
        PortInUseError: the endpoint to listen on is in use.
        UnreachableError: nobody answers at the endpoint of the hub.
        SkinnetError: the endpoint to listen on is no Zenoh endpoint.
    """

    def __init__(
        self, keys: Keys, name: str, *, listen: str | None = None, connect: str | None = None
    ) -> None:
        self._session = open_session(listen, connect)
        self._keys, self._name = keys, name
        self._loop_prefix = f"{keys.prefix}loop/"
        self._own_prefix = f"{self._loop_prefix}{name}/"
        self._mailbox = ThreadMailbox()
        self._entities: list[Any] = []
        self._outbox: dict[str, Messages] = {}
        self._record: Messages = []
        self._record_every = self._record_periods = 0
        self._arrivals: list[Arrivals] = []
        self._heard: dict[str, Callable[[], bool]] = {}
        self.receive = self._mailbox.receive
        self.sent_bytes = 0

    @property
    def received_bytes(self) -> int:
        """Bytes of the batches received."""
        return sum(arrivals.n_bytes for arrivals in self._arrivals)

    @property
    def malformed(self) -> int:
        """Number of batches that did not decode."""
        return sum(arrivals.malformed for arrivals in self._arrivals)

    @property
    def transit_us(self) -> NDArray[np.int64]:
        """Transit-time histogram of the batches, (100001,) bins of 1 µs; the last bin counts all longer ones.

        Valid only between processes of one computer, which share the monotonic clock.
        """
        histogram = np.zeros(TRANSIT_BINS, dtype=np.int64)
        for arrivals in self._arrivals:
            for transit_us, count in arrivals.by_transit_us.copy().items():
                histogram[transit_us] += count
        return histogram

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Subscribe to the batches of `senders` and deliver the messages that match."""
        chosen = tuple(expressions)
        lanes = sorted({self._keys.lane(expression) for expression in chosen})
        if self._name == RECORDER:
            lanes = [RECORDER]
        for sender, lane in product(senders, lanes):
            self._unpack(f"{sender}/{lane}", Arrivals(chosen, self._mailbox.post_all))

    def overhear(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Declare a subscriber to the matching messages in the batches of all senders."""

        def on_messages(deliveries: list[Delivery]) -> None:
            for key, payload in deliveries:
                if payload is not None:
                    on_message(key, payload)

        return self._unpack(f"*/{self._keys.lane(expression)}", Arrivals((expression,), on_messages))

    def _unpack(self, envelopes: str, arrivals: Arrivals) -> Callable[[], None]:
        self._arrivals.append(arrivals)
        return self.tap(self._loop_prefix + envelopes, arrivals.take)

    def tap(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Declare a subscriber; `on_message` runs in a thread of Zenoh."""

        def on_sample(sample: Any) -> None:
            on_message(str(sample.key_expr), sample.payload.to_bytes())

        subscriber = self._session.declare_subscriber(expression, on_sample)
        self._entities.append(subscriber)
        undo: Callable[[], None] = subscriber.undeclare
        return undo

    def watch_alive(self, expression: str) -> None:
        """Subscribe to liveliness as deliveries, including the tokens already present."""
        post = self._mailbox.post
        self.on_alive(expression, lambda key, there: post(Delivery(key, b"" if there else None)))

    def on_alive(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        """Subscribe to liveliness; `on_change` runs in a thread of Zenoh."""

        def on_sample(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        liveliness = self._session.liveliness()
        self._entities.append(liveliness.declare_subscriber(expression, on_sample, history=True))

    def announce(self, key: str) -> None:
        """Declare the liveliness token `key`."""
        self._entities.append(self._session.liveliness().declare_token(key))

    def present(self, expression: str) -> frozenset[str]:
        """Query the liveliness tokens present now."""
        get = self._session.liveliness().get
        replies = collect(lambda handler: get(expression, handler, timeout=_PRESENT_S))
        return frozenset(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def heard(self, key: str) -> bool:
        """Return whether the batches of the route group of `key` have a subscriber."""
        lane = self._keys.lane(key)
        if lane not in self._heard:
            self._heard[lane] = self.audience(self._own_prefix + lane)
        return self._heard[lane]()

    def record(self, every: int) -> None:
        """Send copies of recorded messages to the recorder, `every` periods per batch."""
        self._record_every = every

    def put(self, key: str, payload: bytes) -> None:
        """Add a message to the batch of its route group, and to that of the recorder."""
        if self._record_every and self._keys.parse(key)[0].recorded:
            self._record.append((key, payload))
        lane = self._keys.lane(key)
        if lane != WATCHERS or self.heard(key):
            self._outbox.setdefault(lane, []).append((key, payload))

    def flush(self, *, last: bool = False) -> None:
        """Send the batches with `express`, bypassing Zenoh's own batching: the receivers wait for them."""
        for lane, messages in self._outbox.items():
            self._send(lane, messages)
        self._outbox.clear()
        if self._record:
            self._record_periods += 1
            if last or self._record_periods >= self._record_every:
                self._send(RECORDER, self._record)
                self._record, self._record_periods = [], 0

    def _send(self, lane: str, messages: Messages) -> None:
        envelope = seal(messages)
        self.sent_bytes += len(envelope)
        self._session.put(
            self._own_prefix + lane,
            envelope,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )

    def tell(self, key: str, payload: bytes) -> None:
        """Publish `payload` best-effort: congestion drops it."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def audience(self, expression: str) -> Callable[[], bool]:
        """Declare a matching listener: the status is queried once, then updated by the hub."""
        publisher = self._session.declare_publisher(expression)
        there = [bool(publisher.matching_status.matching)]
        listener = publisher.declare_matching_listener(lambda status: there.__setitem__(0, status.matching))
        self._entities.extend((publisher, listener))
        return lambda: there[0]

    def on_interest(self, expression: str, on_change: Callable[[bool], None]) -> None:
        """Declare a matching listener: call `on_change` at the first and after the last subscriber."""
        publisher = self._session.declare_publisher(expression)
        listener = publisher.declare_matching_listener(lambda status: on_change(status.matching))
        self._entities.extend((publisher, listener))

    def serve(self, expression: str, answer: Callable[[], Mapping[str, bytes]]) -> None:
        """Declare a queryable on `expression` that replies with the payloads by key of `answer`."""

        def on_query(query: Any) -> None:
            with query:
                for key, payload in answer().items():
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, payload)

        self._entities.append(self._session.declare_queryable(expression, on_query))

    def take_queries(self, expression: str, on_query: Callable[[Query], None]) -> None:
        """Declare a queryable; `on_query` runs in a thread of Zenoh and may reply later."""

        def on_asked(query: Any) -> None:
            on_query(_HeldQuery(query))

        self._entities.append(self._session.declare_queryable(expression, on_asked))

    def close(self) -> None:
        """Send pending messages and close the session, even if a peer does not respond."""
        self.flush(last=True)
        self._entities.clear()
        try:
            self._session.close()
        except zenoh.ZError as error:
            log.warning("a peer did not answer when the session was closed: %s", str(error).splitlines()[0])
