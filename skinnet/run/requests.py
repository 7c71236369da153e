"""Request server: turns queries of external clients into controller requests, and answers into replies.

Every query gets one reply within the timeout: the controller's `Answer`, or an error text if there is no
controller, the query is invalid, too many are pending, or no answer arrives.
"""

import contextlib
import logging
import queue
import re
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from skinnet.channels import Keys
from skinnet.errors import ProtocolError
from skinnet.messages import Answer, Request, decode, encode
from skinnet.transport.base import OnMessage, Query

__all__ = ["MOST_OPEN", "PATIENCE_S", "Clerk", "RequestDesk"]

MOST_OPEN = 32
"""Maximum number of pending queries; an assumption: users send one request after the other."""
PATIENCE_S = 5.0
"""Timeout [s] of a pending query; an assumption, below the default query timeout of Zenoh, 10 s."""
_GRACE_S = 0.2
"""Grace period [s]: the loss of the controller's token may overtake its last answers."""
_MOST_BYTES = 256
_WHAT = re.compile(r"[A-Za-z0-9_\-]{1,64}")

log = logging.getLogger(__name__)


@dataclass
class _Open:
    query: Query
    key: str
    deadline_s: float


class _RefusedError(Exception):
    """Refusal of a query, with the reason."""


class RequestDesk:
    """Request server logic without I/O; all calls come from one thread, with the wall-clock time [s].

    Args:
        keys: Keys of the robot.
        hand_in: Callback that puts a request into the loop.
    """

    def __init__(self, keys: Keys, hand_in: OnMessage) -> None:
        self._keys = keys
        self._hand_in = hand_in
        self._open: dict[int, _Open] = {}
        self._serial = 0
        self._closed = "the controller is not running yet; ask again when the run has begun"
        self._over = False
        self.counters: Counter[str] = Counter()
        """Counts of forwarded requests, refused queries and unanswered queries."""

    def ask(self, query: Query, now_s: float) -> None:
        """Forward a query as a request, or refuse it; drop one with a wildcard, as `skinnet/**`."""
        what = query.key.rpartition("/")[2]
        if "*" in what:
            query.drop()
            return
        try:
            if self._closed:
                raise _RefusedError(self._closed)
            argument = _argument(what, query)
            if len(self._open) >= MOST_OPEN:
                raise _RefusedError(f"{MOST_OPEN} requests wait for their answers already; ask again later")
        except _RefusedError as why:
            self.counters["refused_requests"] += 1
            query.refuse(str(why))
            return
        self._serial += 1
        self.counters["requests"] += 1
        key = self._keys.of("request", what)
        self._open[self._serial] = _Open(query, key, now_s + PATIENCE_S)
        self._hand_in(key, encode(Request(id=self._serial, argument=argument)))

    def answer(self, payload: bytes) -> None:
        """Reply to the pending query with the controller's answer; ignore one after the timeout."""
        try:
            asked = self._open.pop(decode(payload, Answer).id, None)
        except ProtocolError as error:
            log.warning("dropped an answer: %s", error)
        else:
            if asked is not None:
                asked.query.reply(asked.key, payload)

    def begin(self) -> None:
        """Accept requests from now on: the controller is running."""
        if not self._over:
            self._closed = ""

    def end(self, why: str, now_s: float, grace_s: float = _GRACE_S) -> None:
        """Refuse requests from now on for reason `why`: the controller is gone."""
        self._over, self._closed = True, why
        for asked in self._open.values():
            asked.deadline_s = min(asked.deadline_s, now_s + grace_s)
        self.expire(now_s)

    def due_s(self) -> float | None:
        """Return the timeout [s] of the oldest pending query, or None."""
        return next((asked.deadline_s for asked in self._open.values()), None)

    def expire(self, now_s: float) -> None:
        """Refuse the pending queries that have timed out, oldest first."""
        while (due_s := self.due_s()) is not None and due_s <= now_s:
            asked = self._open.pop(next(iter(self._open)))
            self.counters["unanswered_requests"] += 1
            why = self._closed or f"nothing came within {PATIENCE_S:g} s, the request may yet be handled"
            asked.query.refuse(f"no answer: {why}")


def _argument(what: str, query: Query) -> str:
    """Validate a query for request `what` and return its argument."""
    if not _WHAT.fullmatch(what):
        raise _RefusedError(f"{what[:64]!r} is no name; names have up to 64 letters, digits, - and _")
    for name in query.parameters:
        if name != "argument" and not name.startswith("_"):  # reserved by Zenoh
            raise _RefusedError(
                f"unknown parameter {name!r}; there is only argument, as in {what}?argument=…"
            )
    parameter = query.parameters.get("argument", "")
    if parameter and query.payload:
        raise _RefusedError(f"{what}: the argument comes as payload or as parameter, not as both")
    payload = query.payload or parameter.encode()
    if len(payload) > _MOST_BYTES:
        raise _RefusedError(f"{what}: an argument of {len(payload)} bytes; at most {_MOST_BYTES}")
    try:
        return payload.decode()
    except UnicodeDecodeError:
        raise _RefusedError(f"{what}: the argument is no UTF-8 text") from None


class Clerk:
    """Request worker: the thread of a `RequestDesk`, so that no slow client blocks the loop or Zenoh."""

    def __init__(self, desk: RequestDesk) -> None:
        self.desk = desk
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="requests", daemon=True)
        self._thread.start()

    def ask(self, query: Query) -> None:
        """See `RequestDesk.ask`."""
        self._jobs.put(lambda: self.desk.ask(query, time.monotonic()))

    def answer(self, payload: bytes) -> None:
        """See `RequestDesk.answer`."""
        self._jobs.put(lambda: self.desk.answer(payload))

    def begin(self) -> None:
        """See `RequestDesk.begin`."""
        self._jobs.put(self.desk.begin)

    def end(self, why: str) -> None:
        """See `RequestDesk.end`."""
        self._jobs.put(lambda: self.desk.end(why, time.monotonic()))

    def close(self) -> None:
        """Refuse all pending queries and join the thread."""
        self._jobs.put(lambda: self.desk.end("the run is over", time.monotonic(), grace_s=0.0))
        self._jobs.put(None)
        self._thread.join()

    def _work(self) -> None:
        while True:
            due_s = self.desk.due_s()
            wait_s = None if due_s is None else max(0.0, due_s - time.monotonic())
            with contextlib.suppress(queue.Empty):
                job = self._jobs.get(timeout=wait_s)
                if job is None:
                    return
                job()
            self.desk.expire(time.monotonic())
