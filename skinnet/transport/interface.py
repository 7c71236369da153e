"""Session interface between a process and its peers, with Zenoh's verbs, over Zenoh or in memory.

A session has two kinds of publication. Those of the loop (`LoopTransport`) wait for slow subscribers and
arrive in order. Those outside the loop are best-effort: observers may lose them and never delay the run.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, Protocol

__all__ = ["Delivery", "OnLiveliness", "OnMessage", "PublicSession", "Query", "Reply", "Undeclare"]

OnMessage = Callable[[str, bytes], None]
"""Message callback (key, payload), possibly in another thread; must not block."""
OnLiveliness = Callable[[str, bool], None]
"""Liveliness callback (key of the token, True if present, False if lost); as `OnMessage`."""
Undeclare = Callable[[], None]
"""Undeclaration of what a call has declared; a second call has no effect."""


class Delivery(NamedTuple):
    """Delivery: a message or, with `payload` None, the loss of the liveliness token at `key`."""

    key: str
    payload: bytes | None


class PublicSession(Protocol):
    """Session of one process, implemented over Zenoh and in memory with the same behaviour."""

    def put(self, key: str, payload: bytes, *, lossless: bool = False) -> None:
        """Publish at once: best-effort or, with `lossless`, waiting for slow subscribers."""

    def declare_subscriber(self, expression: str, on_message: OnMessage) -> Undeclare:
        """Declare a subscriber to publications on matching keys, those of this session included."""

    def matching_listener(self, expression: str) -> Callable[[], bool]:
        """Declare a matching listener; the returned function tells whether `expression` has a subscriber.

        Changes show after a short delay.
        """

    def declare_token(self, key: str) -> Undeclare:
        """Declare the liveliness token `key`; that of `Keys.liveliness` only after all subscriptions."""

    def declare_liveliness_subscriber(self, expression: str, on_change: OnLiveliness) -> Undeclare:
        """Declare a liveliness subscriber: each present or new token (True), each lost one (False)."""

    def liveliness_tokens(self, expression: str) -> frozenset[str]:
        """Query the liveliness tokens present now, including this session's; waits for the hub."""

    def close(self) -> None:
        """Close the session; its liveliness tokens are undeclared."""


class Reply(NamedTuple):
    """Reply to a query: a payload on a key, or else an error text."""

    key: str
    payload: bytes
    error: str


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

    def reply_values(self, values: Mapping[str, bytes]) -> None:
        """Reply with those payloads of `values`, by key, whose key `self.key` matches; there may be none."""

    def reply_error(self, reason: str) -> None:
        """Reply with an error text."""

    def drop(self) -> None:
        """Drop the query without a reply, for other queryables to answer."""
