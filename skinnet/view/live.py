"""Live source: best-effort subscription to a run's observer endpoint, with a bounded, counted queue."""

from collections import deque
from collections.abc import Mapping
from pathlib import Path

from skinnet.channels import CHANNELS, Keys
from skinnet.channels import channel as row_of
from skinnet.errors import ProtocolError, SkinnetError, UnreachableError
from skinnet.messages import Answer, decode
from skinnet.transport.client import ask, what_runs
from skinnet.transport.open_session import OpenSession
from skinnet.view.state import Scene, Told

__all__ = ["SHOWN", "LiveSource"]

SHOWN = (
    "joints",
    "world",
    "events",
    "bundle",
    "stream",
    "regions",
    "topology",
    "state",
    "answer",
    "links",
    "machine",
    "processes",
)
"""Channels that the page shows and subscribes to."""
_ASKED = ("topology", "state", "machine")
"""Channels whose newest messages the endpoint answers to queries, for late observers."""
_RING = 50_000
"""Queue capacity in messages: four seconds of the largest robot."""
_AT_ONCE = 20_000
"""Maximum number of messages per update, so that a page that lags stays responsive."""
_ANSWER_S = 3.0
_LOOK_EVERY_S = 0.5


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
        self.over = ""
        self._endpoint = endpoint
        try:
            self._session = OpenSession("client", endpoint)
        except UnreachableError:
            raise
        except SkinnetError as error:
            raise UnreachableError(str(error)) from error
        try:
            self.deployment, told_base = what_runs(self._session, endpoint)
        except BaseException:
            self._session.close()
            raise
        self.base = base or told_base
        self._keys = Keys(self.deployment.robot)
        self._ring: deque[tuple[str, bytes]] = deque(maxlen=_RING)
        self._came = self._taken = 0
        self._looked_s = 0.0
        for row in CHANNELS:
            if row.name in SHOWN:
                self._session.subscribe(self._expression(row.name), self._put_aside)
        for name in _ASKED:
            if any(row.name == name for row in CHANNELS):
                for key, payload in self._session.ask(self._expression(name), _ANSWER_S).items():
                    self._put_aside(key, payload)

    @property
    def dropped(self) -> int:
        """Number of received messages that the full queue dropped."""
        return self._came - self._taken - len(self._ring)

    def feed(self, scene: Scene, now_s: float) -> int:
        """Deliver the queued messages to `scene`; return their number."""
        count = 0
        while self._ring and count < _AT_ONCE:
            key, payload = self._ring.popleft()
            count += 1
            try:
                row, fields = self._keys.parse(key)
                message = decode(payload, row.message)
            except ProtocolError as error:
                scene.refuse(str(error))
                continue
            t_ns = getattr(message, "t_ns", None)
            scene.take(Told(row.name, fields, message, scene.t_ns if t_ns is None else t_ns), now_s)
        self._taken += count
        if now_s - self._looked_s > _LOOK_EVERY_S:
            self._looked_s = now_s
            if not self._session.connected:
                self.over = "the run is over"
        return count

    def facts(self) -> Mapping[str, str]:
        """Received and dropped message counts, as text by name."""
        return {"messages": f"{self._came}", "dropped by the page": f"{self.dropped}"}

    def request(self, what: str, argument: str) -> str:
        """Send a request to the controller; return its answer or the error as one line."""
        try:
            replies = ask(self._endpoint, self._keys.of("request", what), argument.encode(), 2 * _ANSWER_S)
        except SkinnetError as error:
            return str(error)
        if not replies:
            return "nobody takes requests"
        if replies[0].error:
            return str(replies[0].error)
        try:
            answer = decode(replies[0].payload, Answer)
        except ProtocolError as error:
            return str(error)
        return f"accepted: {answer.state}" if answer.accepted else f"refused in {answer.state}: {answer.why}"

    def close(self) -> None:
        """Close the session."""
        self._session.close()

    def _put_aside(self, key: str, payload: bytes, _attachment: bytes | None = None) -> None:
        self._came += 1
        self._ring.append((key, payload))

    def _expression(self, name: str) -> str:
        return self._keys.of(name, *["*"] * row_of(name).pattern.count("<"))
