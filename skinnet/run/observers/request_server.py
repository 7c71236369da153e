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

from skinnet.errors import ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import Answer, Request, decode, encode
from skinnet.transport.interface import OnMessage, Query

__all__ = ["MAX_PENDING", "TIMEOUT_S", "RequestServer", "RequestWorker"]

MAX_PENDING = 32
"""Maximum number of pending queries; an assumption: users send one request after the other."""
TIMEOUT_S = 5.0
"""Timeout [s] of a pending query; an assumption, below the default query timeout of Zenoh, 10 s."""
_LIVELINESS_GRACE_S = 0.2
"""Grace period [s]: the loss of the controller's token may overtake its last answers."""
_MAX_ARGUMENT_BYTES = 256
_NAME_PATTERN = re.compile(r"[A-Za-z0-9_\-]{1,64}")

log = logging.getLogger(__name__)


@dataclass
class _PendingQuery:
    query: Query
    key: str
    deadline_s: float


class _RefusalError(Exception):
    """Refusal of a query, with the reason."""


class RequestServer:
    """Request server logic without I/O; all calls come from one thread, with the wall-clock time [s].

    Args:
        keys: Keys of the robot.
        put: Callback that puts a request into the loop.
    """

    def __init__(self, keys: Keys, put: OnMessage) -> None:
        self._keys = keys
        self._put = put
        self._pending: dict[int, _PendingQuery] = {}
        self._serial = 0
        self._unavailable_reason = (
            "the controller is not running yet; repeat the request after the start of the run"
        )
        self._ended = False
        self.counters: Counter[str] = Counter()
        """Counts of forwarded requests, refused queries and unanswered queries."""

    def handle_query(self, query: Query, now_s: float) -> None:
        """Forward a query as a request, or refuse it; drop one with a wildcard, as `skinnet/**`."""
        what = query.key.rpartition("/")[2]
        if "*" in what:
            query.drop()
            return
        try:
            if self._unavailable_reason:
                raise _RefusalError(self._unavailable_reason)
            argument = _argument(what, query)
            if len(self._pending) >= MAX_PENDING:
                raise _RefusalError(f"{MAX_PENDING} requests wait for their answers already; ask again later")
        except _RefusalError as why:
            self.counters["refused_requests"] += 1
            query.reply_error(str(why))
            return
        self._serial += 1
        self.counters["requests"] += 1
        key = self._keys.of("request", what)
        self._pending[self._serial] = _PendingQuery(query, key, now_s + TIMEOUT_S)
        self._put(key, encode(Request(id=self._serial, argument=argument)))

    def handle_answer(self, payload: bytes) -> None:
        """Reply to the pending query with the controller's answer; ignore one after the timeout."""
        try:
            asked = self._pending.pop(decode(payload, Answer).id, None)
        except ProtocolError as error:
            log.warning("dropped a malformed answer: %s", error)
        else:
            if asked is not None:
                asked.query.reply(asked.key, payload)

    def enable(self) -> None:
        """Accept requests from now on: the controller is running."""
        if not self._ended:
            self._unavailable_reason = ""

    def disable(self, reason: str, now_s: float, grace_s: float = _LIVELINESS_GRACE_S) -> None:
        """Refuse requests from now on for reason `reason`: the controller is gone."""
        self._ended, self._unavailable_reason = True, reason
        for asked in self._pending.values():
            asked.deadline_s = min(asked.deadline_s, now_s + grace_s)
        self.expire_queries(now_s)

    def next_timeout_s(self) -> float | None:
        """Return the timeout [s] of the oldest pending query, or None."""
        return next((asked.deadline_s for asked in self._pending.values()), None)

    def expire_queries(self, now_s: float) -> None:
        """Refuse the pending queries that have timed out, oldest first."""
        while (due_s := self.next_timeout_s()) is not None and due_s <= now_s:
            asked = self._pending.pop(next(iter(self._pending)))
            self.counters["unanswered_requests"] += 1
            why = (
                self._unavailable_reason
                or f"nothing came within {TIMEOUT_S:g} s, the request may yet be handled"
            )
            asked.query.reply_error(f"no answer: {why}")


def _argument(name: str, query: Query) -> str:
    """Validate a query for request `name` and return its argument."""
    if not _NAME_PATTERN.fullmatch(name):
        raise _RefusalError(f"{name[:64]!r} is no name; names have up to 64 letters, digits, - and _")
    for name in query.parameters:
        if name != "argument" and not name.startswith("_"):  # reserved by Zenoh
            raise _RefusalError(
                f"unknown parameter {name!r}; there is only argument, as in {name}?argument=…"
            )
    parameter = query.parameters.get("argument", "")
    if parameter and query.payload:
        raise _RefusalError(f"{name}: the argument comes as payload or as parameter, not as both")
    payload = query.payload or parameter.encode()
    if len(payload) > _MAX_ARGUMENT_BYTES:
        raise _RefusalError(f"{name}: an argument of {len(payload)} bytes; at most {_MAX_ARGUMENT_BYTES}")
    try:
        return payload.decode()
    except UnicodeDecodeError:
        raise _RefusalError(f"{name}: the argument is no UTF-8 text") from None


class RequestWorker:
    """Request worker: the thread of a `RequestServer`, so that no slow client blocks the loop or Zenoh."""

    def __init__(self, server: RequestServer) -> None:
        self.server = server
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="requests", daemon=True)
        self._thread.start()

    def handle_query(self, query: Query) -> None:
        """See `RequestServer.handle_query`."""
        self._jobs.put(lambda: self.server.handle_query(query, time.monotonic()))

    def handle_answer(self, payload: bytes) -> None:
        """See `RequestServer.handle_answer`."""
        self._jobs.put(lambda: self.server.handle_answer(payload))

    def enable(self) -> None:
        """See `RequestServer.enable`."""
        self._jobs.put(self.server.enable)

    def disable(self, reason: str) -> None:
        """See `RequestServer.disable`."""
        self._jobs.put(lambda: self.server.disable(reason, time.monotonic()))

    def close(self) -> None:
        """Refuse all pending queries and join the thread."""
        self._jobs.put(lambda: self.server.disable("the run has ended", time.monotonic(), grace_s=0.0))
        self._jobs.put(None)
        self._thread.join()

    def _run(self) -> None:
        while True:
            due_s = self.server.next_timeout_s()
            wait_s = None if due_s is None else max(0.0, due_s - time.monotonic())
            with contextlib.suppress(queue.Empty):
                job = self._jobs.get(timeout=wait_s)
                if job is None:
                    return
                job()
            self.server.expire_queries(time.monotonic())
