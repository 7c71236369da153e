"""The seam between a process and its peers.

In the loop, a process puts the messages of one period and then flushes: they leave together, and arrive
together and in their order. Between senders there is no order, and nothing above may depend on one. Beside
the loop, it may tell things to whoever watches; nobody waits for those.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

__all__ = ["Delivery", "OnMessage", "Query", "Transport", "Undo", "matches"]

OnMessage = Callable[[str, bytes], None]
"""Called with key and payload, possibly in another thread: be quick."""
Undo = Callable[[], None]


class Delivery(NamedTuple):
    """One thing that came in: a message, or with `payload` None the loss of the token at `key`."""

    key: str
    payload: bytes | None


class Transport(Protocol):
    """What a process needs of the wire; in-memory and Zenoh transports are twins behind it."""

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        """Delivers from now on what `senders` put on keys that match one of `expressions`.

        What a sender puts in one lane arrives in its order; at the recorder, all that it puts.
        """

    def watch_alive(self, expression: str) -> None:
        """Delivers liveliness: an empty payload for each token there is or comes, None when it goes."""

    def on_alive(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        """Calls `on_change` with each token there is or comes (True), and when it goes (False)."""

    def announce(self, key: str) -> None:
        """Declares the liveliness token `key`; that of `Keys.alive` when all subscriptions are made."""

    def present(self, expression: str) -> frozenset[str]:
        """The liveliness tokens that are there now, this member's as well; waits for the hub to tell."""

    def heard(self, key: str) -> bool:
        """Whether anybody listens to the lane of `key`; it may take a moment to find out."""

    def record(self, every: int) -> None:
        """From now on a recorder gets what is recorded; the messages of so many periods may come at once."""

    def put(self, key: str, payload: bytes) -> None:
        """Adds a message to those of this period."""

    def flush(self, *, last: bool = False) -> None:
        """Sends the messages of this period; after the `last` one, also what waits for the recorder."""

    def tell(self, key: str, payload: bytes) -> None:
        """Tells something at once to whoever watches, beside the loop."""

    def tap(self, expression: str, on_message: OnMessage) -> Undo:
        """Calls `on_message` for what is told on keys that match, until the returned function is called."""

    def audience(self, expression: str) -> Callable[[], bool]:
        """Says, whenever it is called, whether somebody taps what is told on keys that match.

        Who comes or goes is noticed a little later.
        """

    def overhear(self, expression: str, on_message: OnMessage) -> Undo:
        """Like `tap`, for what is put in the loop, by anyone."""

    async def receive(self, timeout_s: float | None = None, enough: int = 1) -> list[Delivery]:
        """All that came in since the last call; waits until it is `enough`, at most `timeout_s`.

        The loss of a process is always enough. Who knows that it needs several messages saves wake-ups.
        """

    def close(self) -> None:
        """Sends what is waiting and leaves; the token goes."""


class Query(Protocol):
    """What somebody asked, and the way back; answer it once, at any time and in any thread.

    Attributes:
        key: Key expression that was asked for.
        parameters: Parameters of the selector by name.
        payload: What was sent along; empty if nothing.
    """

    @property
    def key(self) -> str: ...  # noqa: D102 -- see above

    @property
    def parameters(self) -> Mapping[str, str]: ...  # noqa: D102

    @property
    def payload(self) -> bytes: ...  # noqa: D102

    def reply(self, key: str, payload: bytes) -> None:
        """Answers with `payload` on `key`, which `self.key` matches."""

    def refuse(self, why: str) -> None:
        """Answers with an error, in words."""

    def drop(self) -> None:
        """Leaves the answer to others."""


def matches(expression: str, key: str) -> bool:
    """Whether `key` matches the Zenoh key expression: `*` is one segment, `**` any number of them."""
    return _matches(expression.split("/"), key.split("/"))


def _matches(expression: list[str], key: list[str]) -> bool:
    if not expression:
        return not key
    if expression[0] == "**":
        return any(_matches(expression[1:], key[i:]) for i in range(len(key) + 1))
    return bool(key) and expression[0] in ("*", key[0]) and _matches(expression[1:], key[1:])
