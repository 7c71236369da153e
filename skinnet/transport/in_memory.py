"""In-memory transport: all processes of a run in one, with the same bytes on the same keys as Zenoh."""

import contextlib
import threading
from collections.abc import Callable, Iterable

from skinnet.transport.interface import Delivery, OnMessage, Transport, key_matches
from skinnet.transport.mailbox import TaskMailbox

__all__ = ["InMemoryHub"]


class _Subscription:
    """Subscription: key expressions, senders (None: all), callback."""

    def __init__(
        self, expressions: tuple[str, ...], senders: frozenset[str] | None, on_message: OnMessage
    ) -> None:
        self.expressions = expressions
        self.senders = senders
        self.on_message = on_message


class InMemoryHub:
    """In-memory hub that connects the transports of a run."""

    def __init__(self) -> None:
        self._transports: list[_InMemoryTransport] = []
        self._loop = _SubscriptionTable()
        self._best_effort = _SubscriptionTable()

    def connect(self, name: str) -> Transport:
        """Create the transport of process `name`."""
        member = _InMemoryTransport(self, name, self._loop, self._best_effort)
        self._transports.append(member)
        return member

    def tokens(self) -> list[str]:
        """Return all declared liveliness tokens."""
        return [token for member in self._transports for token in member.tokens]

    def publish_liveliness(self, key: str, present: bool) -> None:
        """Publish a liveliness change of token `key` to all transports."""
        for member in self._transports:
            for expression, on_change in member.liveliness_subscribers:
                if key_matches(expression, key):
                    on_change(key, present)

    def disconnect(self, transport: "_InMemoryTransport") -> None:
        """Disconnect a transport and undeclare its liveliness tokens."""
        if transport in self._transports:
            self._transports.remove(transport)
            for token in transport.tokens:
                self.publish_liveliness(token, False)


class _SubscriptionTable:
    """Subscription table with a cached lookup by sender and key; external clients call from other threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._subscriptions: list[_Subscription] = []
        self._callbacks: dict[tuple[str, str], list[OnMessage]] = {}

    def add(self, subscription: _Subscription) -> Callable[[], None]:
        with self._lock:
            self._subscriptions.append(subscription)
            self._callbacks.clear()

        def undo() -> None:
            with self._lock:
                with contextlib.suppress(ValueError):  # already undeclared
                    self._subscriptions.remove(subscription)
                self._callbacks.clear()

        return undo

    def has_expression(self, expression: str) -> bool:
        """Return whether a subscription has exactly `expression`, as those to whole channels do."""
        return any(expression in ear.expressions for ear in tuple(self._subscriptions))

    def deliver(self, sender: str, key: str, payload: bytes) -> None:
        receivers = self._callbacks.get((sender, key))
        if receivers is None:
            receivers = self._find(sender, key)
        for on_message in receivers:
            on_message(key, payload)

    def has_subscribers(self, sender: str, key: str) -> bool:
        found = self._callbacks.get((sender, key))
        return bool(self._find(sender, key) if found is None else found)

    def _find(self, sender: str, key: str) -> list[OnMessage]:
        with self._lock:
            receivers = self._callbacks[sender, key] = [
                ear.on_message
                for ear in self._subscriptions
                if (ear.senders is None or sender in ear.senders)
                and any(key_matches(expression, key) for expression in ear.expressions)
            ]
        return receivers


class _InMemoryTransport:
    def __init__(
        self, hub: InMemoryHub, name: str, loop: _SubscriptionTable, best_effort: _SubscriptionTable
    ) -> None:
        self.mailbox = TaskMailbox()
        self.liveliness_subscribers: list[tuple[str, Callable[[str, bool], None]]] = []
        self.tokens: list[str] = []
        self._hub, self._name, self._loop, self._best_effort = hub, name, loop, best_effort
        self._undeclare: list[Callable[[], None]] = []
        self.receive = self.mailbox.receive

    def subscribe(self, expressions: Iterable[str], senders: Iterable[str]) -> None:
        self._declare(self._loop, _Subscription(tuple(expressions), frozenset(senders), self._post))

    def _post(self, key: str, payload: bytes) -> None:
        self.mailbox.post(Delivery(key, payload))

    def _declare(self, table: _SubscriptionTable, subscription: _Subscription) -> Callable[[], None]:
        self._undeclare.append(table.add(subscription))
        return self._undeclare[-1]

    def subscribe_liveliness(self, expression: str) -> None:
        post = self.mailbox.post
        self.declare_liveliness_subscriber(
            expression, lambda key, there: post(Delivery(key, b"" if there else None))
        )

    def declare_liveliness_subscriber(self, expression: str, on_change: Callable[[str, bool], None]) -> None:
        self.liveliness_subscribers.append((expression, on_change))
        for token in sorted(self.liveliness_tokens(expression)):
            on_change(token, True)

    def declare_token(self, key: str) -> None:
        self.tokens.append(key)
        self._hub.publish_liveliness(key, True)

    def liveliness_tokens(self, expression: str) -> frozenset[str]:
        return frozenset(token for token in self._hub.tokens() if key_matches(expression, token))

    def has_subscribers(self, key: str) -> bool:
        return self._loop.has_subscribers(self._name, key)

    def put(self, key: str, payload: bytes) -> None:
        self._loop.deliver(self._name, key, payload)

    def enable_recording(self, periods_per_batch: int) -> None:
        pass

    def flush(self, *, last: bool = False) -> None:
        pass

    def publish_best_effort(self, key: str, payload: bytes) -> None:
        self._best_effort.deliver(self._name, key, payload)

    def declare_subscriber(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        return self._declare(self._best_effort, _Subscription((expression,), None, on_message))

    def matching_listener(self, expression: str) -> Callable[[], bool]:
        return lambda: self._best_effort.has_expression(expression)

    def declare_loop_subscriber(self, expression: str, on_message: OnMessage) -> Callable[[], None]:
        return self._declare(self._loop, _Subscription((expression,), None, on_message))

    def close(self) -> None:
        for undo in self._undeclare:
            undo()
        self._hub.disconnect(self)
