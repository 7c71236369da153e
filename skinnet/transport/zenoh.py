"""The Zenoh transport of the loop.

A star: the hub listens as a peer, everybody else is its client. In a mesh, messages of different senders
overtake each other. Everything in the loop has one priority and BLOCK, since mixed priorities break causal
order. A receiver that sticks would make Zenoh close the transport after five seconds, so the wait before
closing is set beyond any deadline of ours.

Each hop of a message wakes threads in three processes, whatever its size. So the messages that a process
puts in one period leave as one envelope for each kind of receivers, under
`skinnet/<robot>/loop/<process>/<receivers>`, and are taken out where they arrive. The recorder, for whom
nobody waits, gets those of several periods as one.
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

_PRESENT_S = 10.0  # the hub may take so long to say who is there

log = logging.getLogger(__name__)


class _HeldQuery:
    """A query of Zenoh's that waits for its answer."""

    def __init__(self, query: Any) -> None:
        self._query = query
        self.key = str(query.key_expr)
        self.parameters = dict(query.parameters)
        self.payload = b"" if query.payload is None else query.payload.to_bytes()

    def reply(self, key: str, payload: bytes) -> None:
        """Answers, if whoever asked is still there."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply(key, payload)

    def refuse(self, why: str) -> None:
        """Answers with an error, if whoever asked is still there."""
        with contextlib.suppress(zenoh.ZError), self._query as query:
            query.reply_err(why)

    def drop(self) -> None:
        """Leaves the answer to others."""
        self._query.drop()


class ZenohTransport:
    """One session of one process.

    Args:
        keys: Keys of the robot.
        name: Name of the process.
        listen: Endpoint to listen on as the hub.
        connect: Endpoint of the hub.

    Raises:
        PortInUseError: the endpoint to listen on is taken.
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
        histogram = np.zeros(TRANSIT_BINS, dtype=np.int64)
        for arrivals in self._arrivals:
            for transit_us, count in arrivals.by_transit_us.copy().items():
                histogram[transit_us] += count
        return histogram

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Takes the messages that match out of the envelopes of `senders`."""
        chosen = tuple(expressions)
        lanes = sorted({self._keys.lane(expression) for expression in chosen})
        if self._name == RECORDER:
            lanes = [RECORDER]
        for sender, lane in product(senders, lanes):
            self._unpack(f"{sender}/{lane}", Arrivals(chosen, self._mailbox.post_all))

    def overhear(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Takes the messages that match out of everybody's envelopes."""

        def on_messages(deliveries: list[Delivery]) -> None:
            for key, payload in deliveries:
                if payload is not None:
                    on_message(key, payload)

        return self._unpack(f"*/{self._keys.lane(expression)}", Arrivals((expression,), on_messages))

    def _unpack(self, envelopes: str, arrivals: Arrivals) -> Callable[[], None]:
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
        self.on_alive(expression, lambda key, there: post(Delivery(key, b"" if there else None)))

    def on_alive(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        """Calls `on_change` in a thread of Zenoh's."""

        def on_sample(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        liveliness = self._session.liveliness()
        self._entities.append(liveliness.declare_subscriber(expression, on_sample, history=True))

    def announce(self, key: str) -> None:
        """Declares the liveliness token `key`."""
        self._entities.append(self._session.liveliness().declare_token(key))

    def present(self, expression: str) -> frozenset[str]:
        """The liveliness tokens that are there now."""
        get = self._session.liveliness().get
        replies = collect(lambda handler: get(expression, handler, timeout=_PRESENT_S))
        return frozenset(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def heard(self, key: str) -> bool:
        """Whether anybody subscribes to the envelopes of the lane of `key`."""
        lane = self._keys.lane(key)
        if lane not in self._heard:
            self._heard[lane] = self.audience(self._own_prefix + lane)
        return self._heard[lane]()

    def record(self, every: int) -> None:
        """From now on the recorder gets a copy of all that it records, of `every` periods at a time."""
        self._record_every = every

    def put(self, key: str, payload: bytes) -> None:
        """Adds a message to the envelope of this period for its receivers, and to that for the recorder."""
        if self._record_every and self._keys.parse(key)[0].recorded:
            self._record.append((key, payload))
        lane = self._keys.lane(key)
        if lane != WATCHERS or self.heard(key):
            self._outbox.setdefault(lane, []).append((key, payload))

    def flush(self, *, last: bool = False) -> None:
        """Sends the envelopes, past Zenoh's own batching: whoever gets them is waiting for them."""
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
        """Sends `payload` to whoever keeps up; never waits for a slow receiver."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def audience(self, expression: str) -> Callable[[], bool]:
        """Asks the hub once, and is kept informed by it."""
        publisher = self._session.declare_publisher(expression)
        there = [bool(publisher.matching_status.matching)]
        listener = publisher.declare_matching_listener(lambda status: there.__setitem__(0, status.matching))
        self._entities.extend((publisher, listener))
        return lambda: there[0]

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

    def take_queries(self, expression: str, on_query: Callable[[Query], None]) -> None:
        """Calls `on_query` in a thread of Zenoh's; whoever asked waits until it is answered."""

        def on_asked(query: Any) -> None:
            on_query(_HeldQuery(query))

        self._entities.append(self._session.declare_queryable(expression, on_asked))

    def close(self) -> None:
        """Sends what is waiting and leaves, even if a peer is stuck and does not take the farewell."""
        self.flush(last=True)
        self._entities.clear()
        try:
            self._session.close()
        except zenoh.ZError as error:
            log.warning("a peer did not answer when the session was closed: %s", str(error).splitlines()[0])
