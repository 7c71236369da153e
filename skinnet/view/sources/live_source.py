"""Live source: best-effort subscription to a run's observer endpoint, with a bounded, counted queue."""

from collections import deque
from collections.abc import Mapping
from pathlib import Path

from skinnet.errors import ProtocolError, SkinnetError, UnreachableError
from skinnet.protocol.channels import CHANNELS, Keys
from skinnet.protocol.channels import channel as row_of
from skinnet.protocol.messages import Answer, decode
from skinnet.transport.queries import query, query_deployment, query_values
from skinnet.transport.zenoh_session import ZenohSession
from skinnet.view.state.run_state import ReceivedMessage, RunState

__all__ = ["SUBSCRIBED_CHANNELS", "LiveSource"]

SUBSCRIBED_CHANNELS = (
    "joints",
    "free_bodies",
    "events",
    "bundle",
    "stream",
    "regions",
    "topology",
    "state",
    "answer",
    "links",
    "state_machine",
    "processes",
)
"""Channels that the page shows and subscribes to."""
_QUERIED_CHANNELS = ("topology", "state", "state_machine")
"""Channels whose newest messages the endpoint answers to queries, for late observers."""
_QUEUE_CAPACITY = 50_000
"""Queue capacity in messages: four seconds of the largest robot."""
_MAX_MESSAGES_PER_UPDATE = 20_000
"""Maximum number of messages per update, so that a page that lags stays responsive."""
_QUERY_TIMEOUT_S = 3.0
_CONNECTION_CHECK_PERIOD_S = 0.5


class LiveSource:
    """Live source, a client of an observer endpoint.

    Args:
        endpoint: Observer endpoint as the run prints it.
        base: Folder with the model, if it differs from the run's.

    Raises:
        UnreachableError: nothing answers at the endpoint.
        SkinnetError: the endpoint is no run of a version that this program supports.
    """

    def __init__(self, endpoint: str, base: Path | None = None) -> None:
        self.title = endpoint
        self.end_reason = ""
        self._endpoint = endpoint
        try:
            self._session = ZenohSession.open_client(endpoint)
        except UnreachableError:
            raise
        except SkinnetError as error:
            raise UnreachableError(str(error)) from error
        try:
            self.deployment, told_base = query_deployment(self._session, endpoint)
        except BaseException:
            self._session.close()
            raise
        self.base = base or told_base
        self._keys = Keys(self.deployment.robot)
        self._queue: deque[tuple[str, bytes]] = deque(maxlen=_QUEUE_CAPACITY)
        self._n_received = self._n_delivered = 0
        self._last_check_s = 0.0
        for row in CHANNELS:
            if row.name in SUBSCRIBED_CHANNELS:
                self._session.declare_subscriber(self._expression(row.name), self._enqueue)
        for name in _QUERIED_CHANNELS:
            if any(row.name == name for row in CHANNELS):
                values = query_values(self._session, self._expression(name), _QUERY_TIMEOUT_S)
                for key, payload in values.items():
                    self._enqueue(key, payload)

    @property
    def n_dropped(self) -> int:
        """Number of received messages that the full queue dropped."""
        return self._n_received - self._n_delivered - len(self._queue)

    def deliver(self, run_state: RunState, now_s: float) -> int:
        """Deliver the queued messages to `run_state`; return their number."""
        count = 0
        while self._queue and count < _MAX_MESSAGES_PER_UPDATE:
            key, payload = self._queue.popleft()
            count += 1
            try:
                row, fields = self._keys.parse(key)
                message = decode(payload, row.message)
            except ProtocolError as error:
                run_state.count_malformed(str(error))
                continue
            t_ns = getattr(message, "t_ns", None)
            run_state.apply(
                ReceivedMessage(row.name, fields, message, run_state.t_ns if t_ns is None else t_ns), now_s
            )
        self._n_delivered += count
        if now_s - self._last_check_s > _CONNECTION_CHECK_PERIOD_S:
            self._last_check_s = now_s
            if not self._session.connected:
                self.end_reason = "the run has ended"
        return count

    def properties(self) -> Mapping[str, str]:
        """Received and dropped message counts, as text by name."""
        return {"messages": f"{self._n_received}", "dropped by the page": f"{self.n_dropped}"}

    def request(self, name: str, argument: str) -> str:
        """Send a request to the controller; return its answer or the error as one line."""
        try:
            replies = query(
                self._endpoint, self._keys.of("request", name), argument.encode(), 2 * _QUERY_TIMEOUT_S
            )
        except SkinnetError as error:
            return str(error)
        if not replies:
            return "no process answers requests"
        if replies[0].error:
            return str(replies[0].error)
        try:
            answer = decode(replies[0].payload, Answer)
        except ProtocolError as error:
            return str(error)
        return (
            f"accepted: {answer.state}" if answer.accepted else f"refused in {answer.state}: {answer.reason}"
        )

    def close(self) -> None:
        """Close the session."""
        self._session.close()

    def _enqueue(self, key: str, payload: bytes) -> None:
        self._n_received += 1
        self._queue.append((key, payload))

    def _expression(self, name: str) -> str:
        return self._keys.of(name, *["*"] * row_of(name).pattern.count("<"))
