"""Observer endpoint: a Zenoh session outside the loop for external clients.

Observers get best-effort copies of the public channels and can never delay the run: the sessions of the loop
are separate. Only subscribed channels are copied. The newest topology of each patch, state of the controller
and state machine answer queries. External clients may send cell configurations, which take effect on arrival,
joint velocities, and requests to the controller, as queries that its answers reply to.
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
    """Return a TCP endpoint on loopback with a port that was free when probed."""
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
    """Observer endpoint: copies public channels out of the loop, and external messages into it.

    Args:
        keys: Keys of the robot.
        listen: Zenoh endpoint; a free port on loopback unless given.

    Attributes:
        endpoint: Zenoh endpoint that it listens on.
        copied: Messages copied to observers.
        configs: Configurations received from external clients.
        velocities: Joint velocities received from external clients.

    Raises:
        PortInUseError: the endpoint is in use.
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
        """Nonzero counts of messages copied to observers and received from external clients."""
        counts = {"copied": self.copied, "configs": self.configs, "velocities": self.velocities}
        counts |= self._desk.counters
        return {name: count for name, count in counts.items() if count}

    def tell_deployment(self, deployed: Deployed) -> None:
        """Declare a queryable that replies with the deployment."""
        answer = {self._keys.deployment: encode(deployed)}
        self._outer.serve(self._keys.deployment, lambda: answer)

    def open(self, inner: Transport) -> None:
        """Subscribe to the loop at `inner` on demand of observers, and accept external messages."""
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
        """Publish a copy to observers, best-effort."""
        self.copied += 1
        self._outer.tell(key, payload)

    def _bring_in(self, key: str, payload: bytes) -> None:
        """Forward an external configuration, without a send time: only the controller's have one."""
        try:
            config = msgspec.structs.replace(decode(payload, Config), t_ns=0)
        except ProtocolError:
            self._hand_in(key, payload)  # the cell process counts it and logs its key
        else:
            self.configs += 1
            self._hand_in(key, encode(config))

    def _bring_velocity(self, key: str, payload: bytes) -> None:
        """Forward an external joint velocity; the controller checks it."""
        self.velocities += 1
        self._hand_in(key, payload)

    def _hand_in(self, key: str, payload: bytes) -> None:
        """Put an external message into the loop, from any thread; discard it after the end of the loop."""
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
        """Publish the process load if an observer subscribes."""
        if self._wants_processes:
            self.copy(self._keys.of("processes"), encode(load()))

    def _on_answer(self, key: str, payload: bytes) -> None:
        self._clerk.answer(payload)
        self.copy(key, payload)

    def _on_controller(self, _key: str, there: bool) -> None:
        if not there:
            self._clerk.end("the controller is gone")

    def leave(self) -> None:
        """Detach from the loop; external messages are discarded from now on."""
        with self._entrance:
            self._inner = None
        self._clerk.end("the run is over")

    def close(self) -> None:
        """Close the endpoint and the request worker."""
        self._clerk.close()
        self._outer.close()


class _Copier:
    """Matching-status handler: subscribes to the loop while an observer subscribes to the copy."""

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
