"""Transport interface between a process and its peers.

In the loop, a process puts the messages of one period and then flushes: they are sent as batches and arrive
in order. There is no order between senders, and no caller may depend on one. Outside the loop, a process
publishes best-effort to observers and never waits for them.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

__all__ = ["Delivery", "OnMessage", "Query", "Transport", "Undeclare", "key_matches"]

OnMessage = Callable[[str, bytes], None]
"""Message callback (key, payload), possibly in another thread; must not block."""
Undeclare = Callable[[], None]


class Delivery(NamedTuple):
    """Delivery: a message or, with `payload` None, the loss of the liveliness token at `key`."""

    key: str
    payload: bytes | None


class Transport(Protocol):
    """Transport of one process, implemented over Zenoh and in memory with the same behaviour."""

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Subscribe to messages that `senders` put on keys matching one of `expressions`.

        Messages of one sender arrive in order within a route group; at the recorder, in order altogether.
        """

    def subscribe_liveliness(self, expression: str) -> None:
        """Subscribe to liveliness as deliveries: payload empty for a present or new token, None if lost."""

    def declare_liveliness_subscriber(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        """Subscribe to liveliness by callback: each present or new token (True), each lost one (False)."""

    def declare_token(self, key: str) -> None:
        """Declare the liveliness token `key`; that of `Keys.alive` only after all subscriptions."""

    def liveliness_tokens(self, expression: str) -> frozenset[str]:
        """Query the liveliness tokens present now, including this process's; waits for the hub."""

    def has_subscribers(self, key: str) -> bool:
        """Return whether the route group of `key` has a subscriber; changes show after a short delay."""

    def enable_recording(self, periods_per_batch: int) -> None:
        """Send recorded channels to the recorder too, in batches of `periods_per_batch` periods."""

    def put(self, key: str, payload: bytes) -> None:
        """Add a message to the batch of this period."""

    def flush(self, *, last: bool = False) -> None:
        """Send the messages of this period; with `last`, also those pending for the recorder."""

    def publish_best_effort(self, key: str, payload: bytes) -> None:
        """Publish best-effort to observers, at once and outside the loop."""

    def declare_subscriber(self, expression: str, on_message: OnMessage) -> Undeclare:
        """Declare a subscriber to best-effort publications; the returned function undeclares it."""

    def matching_listener(self, expression: str) -> Callable[[], bool]:
        """Declare a matching listener; the returned function tells whether `expression` has a subscriber.

        Changes show after a short delay.
        """

    def declare_loop_subscriber(self, expression: str, on_message: OnMessage) -> Undeclare:
        """Declare a subscriber to messages put in the loop by any sender; else as `declare_subscriber`."""

    async def receive(self, timeout_s: float | None = None, min_count: int = 1) -> list[Delivery]:
        """Receive all deliveries since the last call; wait for at least `min_count`, at most `timeout_s` [s].

        A lost token ends the wait at once. A caller that needs several messages saves wake-ups by
        `min_count`.
        """

    def close(self) -> None:
        """Send pending messages and close; the liveliness tokens are undeclared."""


class Query(Protocol):
    """Query of an external client; to be answered once, at any time, from any thread.

    Attributes:
        key: Key expression of the query.
        parameters: Parameters of the selector by name.
        payload: Payload of the query; empty if there is none.
    """

    @property
    def key(self) -> str: ...  # noqa: D102 -- see above

    @property
    def parameters(self) -> Mapping[str, str]: ...  # noqa: D102

    @property
    def payload(self) -> bytes: ...  # noqa: D102

    def reply(self, key: str, payload: bytes) -> None:
        """Reply with `payload` on `key`, which `self.key` matches."""

    def reply_error(self, reason: str) -> None:
        """Reply with an error text."""

    def drop(self) -> None:
        """Drop the query without a reply, for other queryables to answer."""


def key_matches(expression: str, key: str) -> bool:
    """Match `key` against a Zenoh key expression: `*` is one segment, `**` any number of them."""
    return _segments_match(expression.split("/"), key.split("/"))


def _segments_match(expression: list[str], key: list[str]) -> bool:
    if not expression:
        return not key
    if expression[0] == "**":
        return any(_segments_match(expression[1:], key[i:]) for i in range(len(key) + 1))
    return bool(key) and expression[0] in ("*", key[0]) and _segments_match(expression[1:], key[1:])
