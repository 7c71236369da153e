"""In-memory sessions: all processes of a run in one, with the same bytes on the same keys as Zenoh."""

import contextlib
import threading
from collections.abc import Callable
from typing import NamedTuple

from skinnet.protocol.channels import Keys
from skinnet.transport.interface import OnLiveliness, OnMessage, Undeclare
from skinnet.transport.key_expressions import expressions_intersect, key_matches
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.mailbox import TaskMailbox

__all__ = ["InMemoryHub"]

_MAX_CACHED_KEYS = 100_000


class InMemoryHub:
    """In-memory hub that connects the processes of a run.

    Args:
        keys: Keys of the robot.
    """

    def __init__(self, keys: Keys) -> None:
        self._keys = keys
        self._subscribers = _SubscriberTable()
        self._liveliness = _LivelinessTable()

    def connect(self, name: str) -> LoopTransport:
        """Create the loop transport of process `name`."""
        session = _InMemorySession(self._subscribers, self._liveliness)
        return LoopTransport(session, self._keys, name, TaskMailbox())


class _Subscriber(NamedTuple):
    expression: str
    on_message: OnMessage


class _SubscriberTable:
    """Subscribers with cached lookups by key; external clients call from other threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._subscribers: list[_Subscriber] = []
        self._callbacks: dict[str, list[OnMessage]] = {}
        self._matching: dict[str, bool] = {}

    def declare(self, subscriber: _Subscriber) -> Undeclare:
        with self._lock:
            self._subscribers.append(subscriber)
            self._clear_caches()

        def undeclare() -> None:
            with self._lock, contextlib.suppress(ValueError):  # already undeclared
                self._subscribers.remove(subscriber)
                self._clear_caches()

        return undeclare

    def _clear_caches(self) -> None:
        self._callbacks.clear()
        self._matching.clear()

    def put(self, key: str, payload: bytes) -> None:
        callbacks = self._callbacks.get(key)
        if callbacks is None:
            with self._lock:
                callbacks = [s.on_message for s in self._subscribers if key_matches(s.expression, key)]
                if len(self._callbacks) < _MAX_CACHED_KEYS:
                    self._callbacks[key] = callbacks
        for on_message in callbacks:
            on_message(key, payload)

    def is_matching(self, expression: str) -> bool:
        matching = self._matching.get(expression)
        if matching is None:
            with self._lock:
                matching = self._matching[expression] = any(
                    expressions_intersect(s.expression, expression) for s in self._subscribers
                )
        return matching


class _LivelinessTable:
    """Liveliness tokens and their subscribers."""

    def __init__(self) -> None:
        self._tokens: list[str] = []
        self._subscribers: list[tuple[str, OnLiveliness]] = []

    def tokens(self, expression: str) -> frozenset[str]:
        return frozenset(token for token in self._tokens if key_matches(expression, token))

    def declare_token(self, key: str) -> Undeclare:
        self._tokens.append(key)
        self._publish(key, True)

        def undeclare() -> None:
            if key in self._tokens:
                self._tokens.remove(key)
                self._publish(key, False)

        return undeclare

    def declare_subscriber(self, expression: str, on_change: OnLiveliness) -> Undeclare:
        subscriber = expression, on_change
        self._subscribers.append(subscriber)
        for token in sorted(self.tokens(expression)):
            on_change(token, True)

        def undeclare() -> None:
            with contextlib.suppress(ValueError):  # already undeclared
                self._subscribers.remove(subscriber)

        return undeclare

    def _publish(self, key: str, present: bool) -> None:
        for expression, on_change in tuple(self._subscribers):
            if key_matches(expression, key):
                on_change(key, present)


class _InMemorySession:
    """In-memory session: publications reach the subscribers before `put` returns."""

    def __init__(self, subscribers: _SubscriberTable, liveliness: _LivelinessTable) -> None:
        self._subscribers, self._liveliness = subscribers, liveliness
        self._undeclare: list[Undeclare] = []

    def put(self, key: str, payload: bytes, *, lossless: bool = False) -> None:
        self._subscribers.put(key, payload)

    def declare_subscriber(self, expression: str, on_message: OnMessage) -> Undeclare:
        return self._hold(self._subscribers.declare(_Subscriber(expression, on_message)))

    def matching_listener(self, expression: str) -> Callable[[], bool]:
        return lambda: self._subscribers.is_matching(expression)

    def declare_token(self, key: str) -> Undeclare:
        return self._hold(self._liveliness.declare_token(key))

    def declare_liveliness_subscriber(self, expression: str, on_change: OnLiveliness) -> Undeclare:
        return self._hold(self._liveliness.declare_subscriber(expression, on_change))

    def liveliness_tokens(self, expression: str) -> frozenset[str]:
        return self._liveliness.tokens(expression)

    def close(self) -> None:
        for undeclare in self._undeclare:
            undeclare()

    def _hold(self, undeclare: Undeclare) -> Undeclare:
        self._undeclare.append(undeclare)
        return undeclare
