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

from skinnet.protocol.channels import OBSERVERS, RECORDER, Keys
from skinnet.transport.batch import N_TRANSIT_BINS, BatchReader, Messages, encode_batch
from skinnet.transport.interface import Delivery, OnMessage, Query
from skinnet.transport.mailbox import ThreadMailbox
from skinnet.transport.zenoh_session import collect_replies, open_session

__all__ = ["ZenohTransport"]

_TOKENS_TIMEOUT_S = 10.0  # timeout [s] for the hub to list the liveliness tokens

log = logging.getLogger(__name__)


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

    def reply_error(self, reason: str) -> None:
        """Reply with an error text; ignore a client that is gone."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(reason)

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
        self._batches: dict[str, Messages] = {}
        self._recorder_batch: Messages = []
        self._recorder_batch_periods = self._recorder_pending_periods = 0
        self._readers: list[BatchReader] = []
        self._matching: dict[str, Callable[[], bool]] = {}
        self.receive = self._mailbox.receive
        self.sent_bytes = 0

    @property
    def received_bytes(self) -> int:
        """Bytes of the batches received."""
        return sum(arrivals.received_bytes for arrivals in self._readers)

    @property
    def malformed_batches(self) -> int:
        """Number of batches that did not decode."""
        return sum(arrivals.malformed for arrivals in self._readers)

    @property
    def transit_histogram(self) -> NDArray[np.int64]:
        """Transit-time histogram of the batches, (100001,) bins of 1 µs; the last bin counts all longer ones.

        Valid only between processes of one computer, which share the monotonic clock.
        """
        histogram = np.zeros(N_TRANSIT_BINS, dtype=np.int64)
        for arrivals in self._readers:
            for transit_us, count in arrivals.transit_us_counts.copy().items():
                histogram[transit_us] += count
        return histogram

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Subscribe to the batches of `senders` and deliver the messages that match."""
        chosen = tuple(expressions)
        lanes = sorted({self._keys.route_group(expression) for expression in chosen})
        if self._name == RECORDER:
            lanes = [RECORDER]
        for sender, lane in product(senders, lanes):
            self._subscribe_batches(f"{sender}/{lane}", BatchReader(chosen, self._mailbox.post_all))

    def declare_loop_subscriber(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Declare a subscriber to the matching messages in the batches of all senders."""

        def on_messages(deliveries: list[Delivery]) -> None:
            for key, payload in deliveries:
                if payload is not None:
                    on_message(key, payload)

        return self._subscribe_batches(
            f"*/{self._keys.route_group(expression)}", BatchReader((expression,), on_messages)
        )

    def _subscribe_batches(self, batch_keys: str, reader: BatchReader) -> Callable[[], None]:
        self._readers.append(reader)
        return self.declare_subscriber(self._loop_prefix + batch_keys, reader.read)

    def declare_subscriber(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Declare a subscriber; `on_message` runs in a thread of Zenoh."""

        def on_sample(sample: Any) -> None:
            on_message(str(sample.key_expr), sample.payload.to_bytes())

        subscriber = self._session.declare_subscriber(expression, on_sample)
        self._entities.append(subscriber)
        undo: Callable[[], None] = subscriber.undeclare
        return undo

    def subscribe_liveliness(self, expression: str) -> None:
        """Subscribe to liveliness as deliveries, including the tokens already present."""
        post = self._mailbox.post
        self.declare_liveliness_subscriber(
            expression, lambda key, there: post(Delivery(key, b"" if there else None))
        )

    def declare_liveliness_subscriber(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        """Subscribe to liveliness; `on_change` runs in a thread of Zenoh."""

        def on_sample(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        liveliness = self._session.liveliness()
        self._entities.append(liveliness.declare_subscriber(expression, on_sample, history=True))

    def declare_token(self, key: str) -> None:
        """Declare the liveliness token `key`."""
        self._entities.append(self._session.liveliness().declare_token(key))

    def liveliness_tokens(self, expression: str) -> frozenset[str]:
        """Query the liveliness tokens present now."""
        get = self._session.liveliness().get
        replies = collect_replies(lambda handler: get(expression, handler, timeout=_TOKENS_TIMEOUT_S))
        return frozenset(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def has_subscribers(self, key: str) -> bool:
        """Return whether the batches of the route group of `key` have a subscriber."""
        lane = self._keys.route_group(key)
        if lane not in self._matching:
            self._matching[lane] = self.matching_listener(self._own_prefix + lane)
        return self._matching[lane]()

    def enable_recording(self, periods_per_batch: int) -> None:
        """Send copies of recorded messages to the recorder, `periods_per_batch` periods per batch."""
        self._recorder_batch_periods = periods_per_batch

    def put(self, key: str, payload: bytes) -> None:
        """Add a message to the batch of its route group, and to that of the recorder."""
        if self._recorder_batch_periods and self._keys.parse(key)[0].recorded:
            self._recorder_batch.append((key, payload))
        lane = self._keys.route_group(key)
        if lane != OBSERVERS or self.has_subscribers(key):
            self._batches.setdefault(lane, []).append((key, payload))

    def flush(self, *, last: bool = False) -> None:
        """Send the batches with `express`, bypassing Zenoh's own batching: the receivers wait for them."""
        for lane, messages in self._batches.items():
            self._send(lane, messages)
        self._batches.clear()
        if self._recorder_batch:
            self._recorder_pending_periods += 1
            if last or self._recorder_pending_periods >= self._recorder_batch_periods:
                self._send(RECORDER, self._recorder_batch)
                self._recorder_batch, self._recorder_pending_periods = [], 0

    def _send(self, route_group: str, messages: Messages) -> None:
        envelope = encode_batch(messages)
        self.sent_bytes += len(envelope)
        self._session.put(
            self._own_prefix + route_group,
            envelope,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )

    def publish_best_effort(self, key: str, payload: bytes) -> None:
        """Publish `payload` best-effort: congestion drops it."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def matching_listener(self, expression: str) -> Callable[[], bool]:
        """Declare a matching listener: the status is queried once, then updated by the hub."""
        publisher = self._session.declare_publisher(expression)
        there = [bool(publisher.matching_status.matching)]
        listener = publisher.declare_matching_listener(lambda status: there.__setitem__(0, status.matching))
        self._entities.extend((publisher, listener))
        return lambda: there[0]

    def declare_matching_listener(self, expression: str, on_change: Callable[[bool], None]) -> None:
        """Declare a matching listener: call `on_change` at the first and after the last subscriber."""
        publisher = self._session.declare_publisher(expression)
        listener = publisher.declare_matching_listener(lambda status: on_change(status.matching))
        self._entities.extend((publisher, listener))

    def serve_values(self, expression: str, values: Callable[[], Mapping[str, bytes]]) -> None:
        """Declare a queryable on `expression` that replies with the payloads by key of `values`."""

        def on_query(query: Any) -> None:
            with query:
                for key, payload in values().items():
                    if query.key_expr.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, payload)

        self._entities.append(self._session.declare_queryable(expression, on_query))

    def declare_queryable(self, expression: str, on_query: Callable[[Query], None]) -> None:
        """Declare a queryable; `on_query` runs in a thread of Zenoh and may reply later."""

        def on_asked(query: Any) -> None:
            on_query(_PendingQuery(query))

        self._entities.append(self._session.declare_queryable(expression, on_asked))

    def close(self) -> None:
        """Send pending messages and close the session, even if a peer does not respond."""
        self.flush(last=True)
        self._entities.clear()
        try:
            self._session.close()
        except zenoh.ZError as error:
            log.warning("a peer did not answer when the session was closed: %s", str(error).splitlines()[0])
