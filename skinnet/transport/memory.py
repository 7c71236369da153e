"""The in-memory twin: all processes of a run in one, with the same bytes on the same keys."""

import contextlib
from collections.abc import Callable

from skinnet.transport.base import Delivery, OnMessage, Transport
from skinnet.transport.mailbox import Mailbox

__all__ = ["MemoryHub", "matches"]


def matches(expression: str, key: str) -> bool:
    """Whether `key` matches the Zenoh key expression: `*` is one segment, `**` any number of them."""
    return _matches(expression.split("/"), key.split("/"))


def _matches(expression: list[str], key: list[str]) -> bool:
    if not expression:
        return not key
    if expression[0] == "**":
        return any(_matches(expression[1:], key[i:]) for i in range(len(key) + 1))
    return bool(key) and expression[0] in ("*", key[0]) and _matches(expression[1:], key[1:])


class MemoryHub:
    """What the members of a run meet at."""

    def __init__(self) -> None:
        self._members: list[_MemoryTransport] = []
        self._taps: list[tuple[str, OnMessage]] = []
        self._routes: dict[str, list[OnMessage]] = {}

    def connect(self) -> Transport:
        """A transport for one more member."""
        member = _MemoryTransport(self)
        self._members.append(member)
        return member

    def tap(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        """Adds a receiver; returns how to take it out."""
        entry = (expression, on_message)
        self._taps.append(entry)
        self._routes.clear()

        def undo() -> None:
            self._taps.remove(entry)
            self._routes.clear()

        return undo

    def deliver(self, key: str, payload: bytes) -> None:
        """Hands a message to every receiver of `key`."""
        receivers = self._routes.get(key)
        if receivers is None:
            receivers = [on_message for expression, on_message in self._taps if matches(expression, key)]
            self._routes[key] = receivers
        for on_message in receivers:
            on_message(key, payload)

    def tokens(self) -> list[str]:
        """All liveliness tokens there are."""
        return [token for member in self._members for token in member.tokens]

    def deliver_alive(self, key: str, payload: bytes | None) -> None:
        """Posts the coming (b"") or going (None) of a token."""
        for member in self._members:
            if any(matches(e, key) for e in member.watched):
                member.mailbox.post(Delivery(key, payload))

    def leave(self, member: "_MemoryTransport") -> None:
        """Takes a member out and lets its tokens go."""
        if member in self._members:
            self._members.remove(member)
            for token in member.tokens:
                self.deliver_alive(token, None)


class _MemoryTransport:
    def __init__(self, hub: MemoryHub) -> None:
        self.mailbox = Mailbox()
        self.watched: list[str] = []
        self.tokens: list[str] = []
        self._hub = hub
        self._undo: list[Callable[[], None]] = []
        self.receive = self.mailbox.receive

    def subscribe(self, expression: str) -> None:
        self.tap(expression, lambda key, payload: self.mailbox.post(Delivery(key, payload)))

    def tap(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        self._undo.append(self._hub.tap(expression, on_message))
        return self._undo[-1]

    def watch_alive(self, expression: str) -> None:
        self.watched.append(expression)
        for token in self._hub.tokens():
            if matches(expression, token):
                self.mailbox.post(Delivery(token, b""))

    def announce(self, key: str) -> None:
        self.tokens.append(key)
        self._hub.deliver_alive(key, b"")

    def put(self, key: str, payload: bytes, *, flush: bool = False) -> None:
        self._hub.deliver(key, payload)

    def close(self) -> None:
        for undo in self._undo:
            with contextlib.suppress(ValueError):  # undone before
                undo()
        self._hub.leave(self)
