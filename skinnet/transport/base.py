"""The seam between a process and its peers.

A transport delivers messages of one sender in the order in which they were sent, without loss; between
senders there is no order. Nothing above it may depend on the order in which messages arrive.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

__all__ = ["Delivery", "OnMessage", "Transport"]

OnMessage = Callable[[str, bytes], None]
"""Called with key and payload, possibly in another thread: be quick."""


class Delivery(NamedTuple):
    """One thing that came in: a message, or with `payload` None the loss of the token at `key`."""

    key: str
    payload: bytes | None


class Transport(Protocol):
    """What a process needs of the wire; in-memory and Zenoh transports are twins behind it."""

    def subscribe(self, expression: str) -> None:
        """Delivers from now on what is put on keys that match `expression`."""

    def tap(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Calls `on_message` for what is put on keys that match, until the returned function is called."""

    def watch_alive(self, expression: str) -> None:
        """Delivers liveliness: an empty payload for each token there is or comes, None when it goes."""

    def announce(self, key: str) -> None:
        """Declares the liveliness token `key`; call it when all subscriptions are made."""

    def put(self, key: str, payload: bytes, *, flush: bool = False) -> None:
        """Sends `payload` to whoever subscribes; `flush` asks for it to leave at once."""

    async def receive(self, timeout_s: float | None = None, enough: int = 1) -> list[Delivery]:
        """All that came in since the last call; waits until it is `enough`, at most `timeout_s`.

        The loss of a process is always enough. Who knows that it needs several messages saves wake-ups.
        """

    def close(self) -> None:
        """Sends what is waiting and leaves; the token goes."""
