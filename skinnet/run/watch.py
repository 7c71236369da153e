"""The window for outsiders: a Zenoh endpoint of its own, beside the loop.

Whoever joins here gets best-effort copies of the public channels and can never hold up the run: the
loop's sessions do not know them. Copies are made only of what somebody subscribes to. The newest topology
of each patch, and the newest state of the controller with all states that there are, answer queries.
Configuration of cells may come in; it takes effect as soon as it arrives. So may requests to the controller,
as queries that its answer answers.
"""

import socket
import threading
from collections.abc import Callable

import msgspec

from skinnet.channels import CHANNELS, OUTSIDE, Channel, Keys, Role
from skinnet.errors import PortInUseError, ProtocolError
from skinnet.messages import Config, decode, encode
from skinnet.outside_messages import Deployed
from skinnet.run.requests import Clerk, RequestDesk
from skinnet.transport.base import OnMessage, Transport
from skinnet.transport.zenoh import ZenohTransport
from skinnet.watch_messages import ProcessLoad

__all__ = ["Watch", "free_endpoint"]

_TRIES = 5


def free_endpoint() -> str:
    """A TCP endpoint on loopback that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _open(keys: Keys, listen: str | None) -> tuple[str, ZenohTransport]:
    for attempt in range(_TRIES):
        endpoint = listen or free_endpoint()
        try:
            return endpoint, ZenohTransport(keys, OUTSIDE, listen=endpoint)
        except PortInUseError:
            if listen or attempt == _TRIES - 1:
                raise
    raise AssertionError("unreachable")


class Watch:
    """Copies the public channels of the loop at `inner` to whoever connects to `endpoint`.

    Args:
        keys: Keys of the robot.
        listen: Endpoint; a free port on loopback unless given.

    Raises:
        PortInUseError: the endpoint is taken.
    """

    def __init__(self, keys: Keys, listen: str | None = None) -> None:
        self._keys = keys
        self.endpoint, self._outer = _open(keys, listen)
        self.copied = 0
        self.configs = 0
        self.velocities = 0
        self._topologies: dict[str, bytes] = {}
        self._newest: dict[str, bytes] = {}
        self._wants_processes = False
        self._inner: Transport | None = None
        self._entrance = threading.Lock()
        self._desk = RequestDesk(keys, self._hand_in)
        self._clerk = Clerk(self._desk)
        self._outer.take_queries(keys.of("request", "*"), self._clerk.ask)

    @property
    def counters(self) -> dict[str, int]:
        """What was copied to outsiders, and what they brought in; nothing if nobody came."""
        counts = {"copied": self.copied, "configs": self.configs, "velocities": self.velocities}
        counts |= self._desk.counters
        return {name: count for name, count in counts.items() if count}

    def tell_deployment(self, deployed: Deployed) -> None:
        """Answers whoever asks what runs here."""
        answer = {self._keys.deployment: encode(deployed)}
        self._outer.serve(self._keys.deployment, lambda: answer)

    def open(self, inner: Transport) -> None:
        """Begins to copy what goes through the loop."""
        self._inner = inner
        keys = self._keys
        for row in CHANNELS:
            expression = self._expression(row)
            if row.name == "config":
                self._outer.tap(expression, self._bring_in)
            elif row.name == "velocity":
                self._outer.tap(expression, self._bring_velocity)
            elif row.name == "links":
                self._outer.on_interest(expression, _Copier(inner.tap, self, expression))
            elif row.public and not row.told:
                self._outer.on_interest(expression, _Copier(inner.overhear, self, expression))
        inner.tap(keys.of("topology", "*"), self._topologies.__setitem__)
        inner.tap(keys.of("state"), self._on_state)
        inner.tap(keys.of("answer"), self._on_answer)
        inner.on_alive(keys.alive(Role.CONTROLLER, "*"), self._on_controller)
        self._outer.serve(keys.of("topology", "*"), self._topologies.copy)
        inner.tap(keys.of("machine"), self._on_machine)
        self._outer.on_interest(keys.of("processes"), self._on_processes_wanted)
        for name in ("state", "machine"):
            self._outer.serve(keys.of(name), self._newest.copy)

    def _expression(self, row: Channel) -> str:
        return self._keys.of(row.name, *["*"] * row.pattern.count("<"))

    def copy(self, key: str, payload: bytes) -> None:
        """Sends a copy to whoever keeps up."""
        self.copied += 1
        self._outer.tell(key, payload)

    def _bring_in(self, key: str, payload: bytes) -> None:
        """Configuration by a stranger: never in the name of the controller, whose messages have a time."""
        try:
            config = msgspec.structs.replace(decode(payload, Config), t_ns=0)
        except ProtocolError:
            self._hand_in(key, payload)  # the host counts it and says who sent it
        else:
            self.configs += 1
            self._hand_in(key, encode(config))

    def _bring_velocity(self, key: str, payload: bytes) -> None:
        """A velocity by a stranger; the controller decides on it."""
        self.velocities += 1
        self._hand_in(key, payload)

    def _hand_in(self, key: str, payload: bytes) -> None:
        """Puts into the loop, from any thread, what a stranger brings; in vain if the loop is over."""
        with self._entrance:
            if self._inner is not None:
                self._inner.put(key, payload)
                self._inner.flush()

    def _on_state(self, key: str, payload: bytes) -> None:
        self._newest[key] = payload
        self._clerk.begin()
        self.copy(key, payload)

    def _on_machine(self, key: str, payload: bytes) -> None:
        self._newest[key] = payload
        self.copy(key, payload)

    def _on_processes_wanted(self, wanted: bool) -> None:
        self._wants_processes = wanted

    def tell_processes(self, load: Callable[[], ProcessLoad]) -> None:
        """Tells what the processes use, if somebody wants to know."""
        if self._wants_processes:
            self.copy(self._keys.of("processes"), encode(load()))

    def _on_answer(self, key: str, payload: bytes) -> None:
        self._clerk.answer(payload)
        self.copy(key, payload)

    def _on_controller(self, _key: str, there: bool) -> None:
        if not there:
            self._clerk.end("the controller is gone")

    def leave(self) -> None:
        """The loop is over: nothing comes in any more."""
        with self._entrance:
            self._inner = None
        self._clerk.end("the run is over")

    def close(self) -> None:
        """Nobody can watch any more."""
        self._clerk.close()
        self._outer.close()


class _Copier:
    """Listens for an expression, in its own way, while somebody is interested."""

    def __init__(
        self, listen: Callable[[str, OnMessage], Callable[[], None]], watch: Watch, expression: str
    ) -> None:
        self._listen, self._watch, self._expression = listen, watch, expression
        self._undo: Callable[[], None] | None = None

    def __call__(self, interested: bool) -> None:
        if interested and self._undo is None:
            self._undo = self._listen(self._expression, self._watch.copy)
        elif not interested and self._undo is not None:
            self._undo()
            self._undo = None
