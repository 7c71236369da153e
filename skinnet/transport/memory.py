"""In-memory transport: all processes of a run in one, with the same bytes on the same keys as Zenoh."""

import contextlib
import threading
from collections.abc import Callable, Iterable

from skinnet.transport.base import Delivery, OnMessage, Transport, matches
from skinnet.transport.mailbox import TaskMailbox

__all__ = ["MemoryHub"]


class _Ear:
    """Subscription: key expressions, senders (None: all), callback."""

    def __init__(
        self, expressions: tuple[str, ...], senders: frozenset[str] | None, on_message: OnMessage
    ) -> None:
        self.expressions = expressions
        self.senders = senders
        self.on_message = on_message


class MemoryHub:
    """In-memory hub that connects the transports of a run."""

    def __init__(self) -> None:
        self._members: list[_MemoryTransport] = []
        self._loop = _Board()
        self._beside = _Board()

    def connect(self, name: str) -> Transport:
        """Create the transport of process `name`."""
        member = _MemoryTransport(self, name, self._loop, self._beside)
        self._members.append(member)
        return member

    def tokens(self) -> list[str]:
        """Return all declared liveliness tokens."""
        return [token for member in self._members for token in member.tokens]

    def tell_alive(self, key: str, there: bool) -> None:
        """Publish a liveliness change of token `key` to all transports."""
        for member in self._members:
            for expression, on_change in member.watched:
                if matches(expression, key):
                    on_change(key, there)

    def leave(self, member: "_MemoryTransport") -> None:
        """Disconnect a transport and undeclare its liveliness tokens."""
        if member in self._members:
            self._members.remove(member)
            for token in member.tokens:
                self.tell_alive(token, False)


class _Board:
    """Subscription table with a cached lookup by sender and key; external clients call from other threads."""

    def __init__(self) -> None:
        self._changing = threading.Lock()
        self._ears: list[_Ear] = []
        self._found: dict[tuple[str, str], list[OnMessage]] = {}

    def add(self, ear: _Ear) -> Callable[[], None]:
        with self._changing:
            self._ears.append(ear)
            self._found.clear()

        def undo() -> None:
            with self._changing:
                with contextlib.suppress(ValueError):  # already undeclared
                    self._ears.remove(ear)
                self._found.clear()

        return undo

    def has(self, expression: str) -> bool:
        """Return whether a subscription has exactly `expression`, as those to whole channels do."""
        return any(expression in ear.expressions for ear in tuple(self._ears))

    def deliver(self, sender: str, key: str, payload: bytes) -> None:
        receivers = self._found.get((sender, key))
        if receivers is None:
            receivers = self._find(sender, key)
        for on_message in receivers:
            on_message(key, payload)

    def heard(self, sender: str, key: str) -> bool:
        found = self._found.get((sender, key))
        return bool(self._find(sender, key) if found is None else found)

    def _find(self, sender: str, key: str) -> list[OnMessage]:
        with self._changing:
            receivers = self._found[sender, key] = [
                ear.on_message
                for ear in self._ears
                if (ear.senders is None or sender in ear.senders)
                and any(matches(expression, key) for expression in ear.expressions)
            ]
        return receivers


class _MemoryTransport:
    def __init__(self, hub: MemoryHub, name: str, loop: _Board, beside: _Board) -> None:
        self.mailbox = TaskMailbox()
        self.watched: list[tuple[str, Callable[[str, bool], None]]] = []
        self.tokens: list[str] = []
        self._hub, self._name, self._loop, self._beside = hub, name, loop, beside
        self._undo: list[Callable[[], None]] = []
        self.receive = self.mailbox.receive

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        self._listen(self._loop, _Ear(tuple(expressions), frozenset(senders), self._post))

    def _post(self, key: str, payload: bytes) -> None:
        self.mailbox.post(Delivery(key, payload))

    def _listen(self, board: _Board, ear: _Ear) -> Callable[[], None]:
        self._undo.append(board.add(ear))
        return self._undo[-1]

    def watch_alive(self, expression: str) -> None:
        post = self.mailbox.post
        self.on_alive(expression, lambda key, there: post(Delivery(key, b"" if there else None)))

    def on_alive(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        self.watched.append((expression, on_change))
        for token in sorted(self.present(expression)):
            on_change(token, True)

    def announce(self, key: str) -> None:
        self.tokens.append(key)
        self._hub.tell_alive(key, True)

    def present(self, expression: str) -> frozenset[str]:
        return frozenset(token for token in self._hub.tokens() if matches(expression, token))

    def heard(self, key: str) -> bool:
        return self._loop.heard(self._name, key)

    def put(self, key: str, payload: bytes) -> None:
        self._loop.deliver(self._name, key, payload)

    def record(self, every: int) -> None:
        pass

    def flush(self, *, last: bool = False) -> None:
        pass

    def tell(self, key: str, payload: bytes) -> None:
        self._beside.deliver(self._name, key, payload)

    def tap(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        return self._listen(self._beside, _Ear((expression,), None, on_message))

    def audience(self, expression: str) -> Callable[[], bool]:
        return lambda: self._beside.has(expression)

    def overhear(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        return self._listen(self._loop, _Ear((expression,), None, on_message))

    def close(self) -> None:
        for undo in self._undo:
            undo()
        self._hub.leave(self)
