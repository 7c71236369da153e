"""Loop transport: the messages of one process in the loop, over a session of Zenoh or in memory.

A process puts the messages of one period and then flushes: they are sent as batches and arrive in order.
There is no order between senders, and no caller may depend on one.

Each hop of a message wakes threads in three processes, whatever its size. So the messages that a process
puts in one period are sent as one batch per route group, under `skinnet/<robot>/loop/<process>/<receivers>`,
and unpacked by the receiver. The recorder, which no process waits for, gets several periods in one batch.
"""

import time
from collections.abc import Callable, Iterable
from itertools import product

from skinnet.protocol.channels import OBSERVERS, RECORDER, Keys
from skinnet.transport.batch import BatchReader, BatchStatistics, Messages, encode_batch
from skinnet.transport.interface import Delivery, OnMessage, PublicSession, Undeclare
from skinnet.transport.mailbox import Mailbox

__all__ = ["LoopTransport"]

_MAX_RECORDER_WAIT_S = 1.0
"""Wall time [s] after which pending messages are sent: the recorder takes longer silence for a loss."""


class LoopTransport:
    """Loop transport of one process.

    Args:
        session: Session to send and receive by; closed with the transport.
        keys: Keys of the robot.
        name: Process name.
        mailbox: Mailbox that the session's subscribers fill.

    Attributes:
        session: The session, for liveliness and for best-effort publication outside the loop.
        statistics: Statistics of the batches.
    """

    def __init__(self, session: PublicSession, keys: Keys, name: str, mailbox: Mailbox) -> None:
        self.session = session
        self.statistics = BatchStatistics()
        self._keys, self._name = keys, name
        self._loop_prefix = f"{keys.prefix}loop/"
        self._own_prefix = f"{self._loop_prefix}{name}/"
        self._mailbox = mailbox
        self._batches: dict[str, Messages] = {}
        self._recorder_batch: Messages = []
        self._recorder_batch_periods = self._recorder_pending_periods = 0
        self._recorder_sent_s = time.monotonic()
        self._matching: dict[str, Callable[[], bool]] = {}

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Subscribe to messages that `senders` put on keys matching one of `expressions`.

        Messages of one sender arrive in order within a route group; at the recorder, in order altogether.
        """
        chosen = tuple(expressions)
        groups = sorted({self._keys.route_group(expression) for expression in chosen})
        if self._name == RECORDER:
            groups = [RECORDER]
        for sender, group in product(senders, groups):
            self._declare_reader(f"{sender}/{group}", BatchReader(chosen, self._mailbox.post_all))

    def declare_loop_subscriber(self, expression: str, on_message: OnMessage) -> Undeclare:
        """Declare a subscriber to the matching messages that any process puts in the loop."""

        def on_messages(deliveries: list[Delivery]) -> None:
            for key, payload in deliveries:
                if payload is not None:
                    on_message(key, payload)

        group = self._keys.route_group(expression)
        return self._declare_reader(f"*/{group}", BatchReader((expression,), on_messages))

    def _declare_reader(self, batch_keys: str, reader: BatchReader) -> Undeclare:
        self.statistics.add(reader)
        return self.session.declare_subscriber(self._loop_prefix + batch_keys, reader.read)

    def subscribe_liveliness(self, expression: str) -> None:
        """Subscribe to liveliness as deliveries: payload empty for a present or new token, None if lost."""
        post = self._mailbox.post
        self.session.declare_liveliness_subscriber(
            expression, lambda key, present: post(Delivery(key, b"" if present else None))
        )

    def has_subscribers(self, key: str) -> bool:
        """Return whether the route group of `key` has a subscriber; changes show after a short delay."""
        group = self._keys.route_group(key)
        if group not in self._matching:
            self._matching[group] = self.session.matching_listener(self._own_prefix + group)
        return self._matching[group]()

    def enable_recording(self, periods_per_batch: int) -> None:
        """Send copies of recorded messages to the recorder, `periods_per_batch` periods per batch."""
        self._recorder_batch_periods = periods_per_batch

    def put(self, key: str, payload: bytes) -> None:
        """Add a message to the batch of its route group, and to that of the recorder."""
        if self._recorder_batch_periods and self._keys.parse(key)[0].recorded:
            self._recorder_batch.append((key, payload))
        group = self._keys.route_group(key)
        if group != OBSERVERS or self.has_subscribers(key):
            self._batches.setdefault(group, []).append((key, payload))

    def flush(self, *, last: bool = False) -> None:
        """Send the messages of this period; with `last`, also those pending for the recorder."""
        batches, self._batches = self._batches, {}
        for group, messages in batches.items():
            self._send(group, messages)
        if self._recorder_batch:
            self._recorder_pending_periods += 1
            if last or self._is_recorder_batch_due():
                messages, self._recorder_batch = self._recorder_batch, []
                self._recorder_pending_periods = 0
                self._recorder_sent_s = time.monotonic()
                self._send(RECORDER, messages)

    def _is_recorder_batch_due(self) -> bool:
        return (
            self._recorder_pending_periods >= self._recorder_batch_periods
            or time.monotonic() - self._recorder_sent_s >= _MAX_RECORDER_WAIT_S
        )

    def _send(self, route_group: str, messages: Messages) -> None:
        batch = encode_batch(messages)
        self.statistics.sent_bytes += len(batch)
        self.session.put(self._own_prefix + route_group, batch, lossless=True)

    async def receive(self, timeout_s: float | None = None, min_count: int = 1) -> list[Delivery]:
        """Receive all deliveries since the last call; wait for at least `min_count`, at most `timeout_s` [s].

        A lost token ends the wait at once. A caller that needs several messages saves wake-ups by
        `min_count`.
        """
        return await self._mailbox.receive(timeout_s, min_count)

    def close(self) -> None:
        """Send pending messages and close the session."""
        self.flush(last=True)
        self.session.close()
