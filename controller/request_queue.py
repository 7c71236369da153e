"""Request queue of the controller: from arrival to answer. No I/O.

A request waits for the next tick, at which the current stage accepts or refuses it; its reply is the answer.
Queue length and requests per tick are bounded, so that a flood of requests costs a bounded time.
"""

from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

import msgspec

from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import Answer, Request, encode

__all__ = ["Reply", "RequestHandler", "RequestQueue"]

_MAX_PENDING = 64
_MAX_PER_TICK = 8
_MAX_LOGGED = 10_000
"""Number of requests listed in the facts of a run; all are counted."""


class Reply(NamedTuple):
    """Reply to a request: the published state after it, and the reason of a refusal."""

    accepted: bool
    state: str
    reason: str = ""


@runtime_checkable
class RequestHandler(Protocol):
    """Stage that takes requests."""

    def handle_request(self, t_ns: int, name: str, argument: str) -> Reply:
        """Handle a request at `t_ns`, or refuse it and change nothing."""


class RequestQueue:
    """Queue of pending requests, and of answers that are not sent yet.

    Args:
        keys: Keys of the robot.
        counters: Counters of the process; external requests and dropped ones are counted.
    """

    def __init__(self, keys: Keys, counters: Counter[str]) -> None:
        self.log: list[tuple[int, str, str, bool]] = []
        """Handled requests: time of the tick [ns], request, argument, accepted."""
        self._answer_key = keys.of("answer")
        self._counters = counters
        self._pending: deque[tuple[str, Request]] = deque()
        self._answers: list[tuple[str, bytes]] = []

    @property
    def pending_answers(self) -> tuple[tuple[str, bytes], ...]:
        """Answers not yet published to observers: those since the last call of `take_answers`."""
        return tuple(self._answers)

    def add(self, name: str, request: Request) -> None:
        """Queue a request, or drop it if the queue is full.

        The launcher's request server bounds open requests; clients that bypass it may be dropped.
        """
        self._counters["external_requests"] += 1
        if len(self._pending) < _MAX_PENDING:
            self._pending.append((name, request))
        else:
            self._counters["dropped_requests"] += 1

    def handle(self, t_ns: int, ask: Callable[[int, str, str], Reply]) -> bytes:
        """Handle pending requests in the order of their arrival.

        Args:
            t_ns: Time of the tick.
            ask: Handler of a request: (t_ns, what, argument).

        Returns:
            The accepted requests for the log hash, empty without any; a refused request changes nothing.
        """
        accepted = []
        for _ in range(min(_MAX_PER_TICK, len(self._pending))):
            what, request = self._pending.popleft()
            reply = ask(t_ns, what, request.argument)
            answer = Answer(id=request.id, t_ns=t_ns, **reply._asdict())
            self._answers.append((self._answer_key, encode(answer)))
            if len(self.log) < _MAX_LOGGED:
                self.log.append((t_ns, what, request.argument, reply.accepted))
            if reply.accepted:
                accepted.append((t_ns, what, request.argument))
        return msgspec.msgpack.encode(accepted) if accepted else b""

    def take_answers(self) -> list[tuple[str, bytes]]:
        """Return the answers since the last call, for observers."""
        news, self._answers = self._answers, []
        return news
