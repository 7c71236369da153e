"""Requests of users to the controller: from their arrival to their answer. No I/O.

A request waits for the next tick, which asks whatever goes on there and then. What it says is the answer.
Few are handled in a tick and few may wait, so that a flood of them costs a bounded time and nothing else.
"""

from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

import msgspec

from skinnet.channels import Keys
from skinnet.messages import Answer, Request, encode

__all__ = ["Asked", "Reply", "Requests"]

_MOST_WAITING = 64
_MOST_PER_TICK = 8
_MOST_KEPT = 10_000
"""Requests that the facts of a run name; all are counted."""


class Reply(NamedTuple):
    """What comes of a request: the state after it, as watchers see it, and if it was refused, why."""

    accepted: bool
    state: str
    why: str = ""


@runtime_checkable
class Asked(Protocol):
    """A stage that takes requests."""

    def ask(self, t_ns: int, what: str, argument: str) -> Reply:
        """Does what is asked for at `t_ns`, or refuses and changes nothing."""


class Requests:
    """The requests that wait, and the answers that have not been sent.

    Args:
        keys: Keys of the robot.
        counters: Where to count what came from outside, and what was dropped since too many waited.
    """

    def __init__(self, keys: Keys, counters: Counter[str]) -> None:
        self.log: list[tuple[int, str, str, bool]] = []
        """Time of the tick [ns], what was asked for, its argument, and whether it was accepted."""
        self._answer_key = keys.of("answer")
        self._counters = counters
        self._waiting: deque[tuple[str, Request]] = deque()
        self._answers: list[tuple[str, bytes]] = []

    @property
    def answers(self) -> tuple[tuple[str, bytes], ...]:
        """The answers that were not sent to watchers yet: those of this tick, until `news` is called."""
        return tuple(self._answers)

    def add(self, what: str, request: Request) -> None:
        """A request came in; who asks past the desk of the launcher, which counts them, may come in vain."""
        self._counters["requests_from_outside"] += 1
        if len(self._waiting) < _MOST_WAITING:
            self._waiting.append((what, request))
        else:
            self._counters["dropped_requests"] += 1

    def handle(self, t_ns: int, ask: Callable[[int, str, str], Reply]) -> bytes:
        """Asks on behalf of those that waited, in the order of their arrival.

        Args:
            t_ns: Time of the tick.
            ask: Answers a request: (t_ns, what, argument).

        Returns:
            What was accepted, for the log; nothing if nothing was. What was refused has changed nothing.
        """
        accepted = []
        for _ in range(min(_MOST_PER_TICK, len(self._waiting))):
            what, request = self._waiting.popleft()
            reply = ask(t_ns, what, request.argument)
            answer = Answer(id=request.id, t_ns=t_ns, **reply._asdict())
            self._answers.append((self._answer_key, encode(answer)))
            if len(self.log) < _MOST_KEPT:
                self.log.append((t_ns, what, request.argument, reply.accepted))
            if reply.accepted:
                accepted.append((t_ns, what, request.argument))
        return msgspec.msgpack.encode(accepted) if accepted else b""

    def news(self) -> list[tuple[str, bytes]]:
        """The answers since the last call, for watchers."""
        news, self._answers = self._answers, []
        return news
