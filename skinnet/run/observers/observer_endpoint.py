"""Observer endpoint: a Zenoh session outside the loop for external clients.

Observers get best-effort copies of the public channels and can never delay the run: the sessions of the loop
are separate. Only subscribed channels are copied. The newest topology of each patch, state of the controller
and state machine answer queries. External clients may send cell configurations, which take effect on arrival,
joint velocities, and requests to the controller, as queries that its answers reply to.
"""

import socket
import threading
from collections.abc import Callable
from typing import Self

import msgspec

from skinnet.errors import PortInUseError, ProtocolError
from skinnet.protocol.channels import CHANNELS, Channel, Keys, Role
from skinnet.protocol.external_messages import DeploymentInfo
from skinnet.protocol.messages import Config, decode, encode
from skinnet.protocol.telemetry_messages import ProcessLoad
from skinnet.run.observers.request_server import RequestServer, RequestWorker
from skinnet.transport.interface import OnMessage, Query, Undeclare
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.zenoh_session import ZenohSession

__all__ = ["ObserverEndpoint", "free_endpoint"]

_MAX_ATTEMPTS = 5


def free_endpoint() -> str:
    """Return a TCP endpoint on loopback with a port that was free when probed."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _listen_on(listen: str | None) -> tuple[str, ZenohSession]:
    for attempt in range(_MAX_ATTEMPTS):
        endpoint = listen or free_endpoint()
        try:
            return endpoint, ZenohSession.open_hub(endpoint)
        except PortInUseError:
            if listen or attempt == _MAX_ATTEMPTS - 1:
                raise
    raise AssertionError("unreachable")


class ObserverEndpoint:
    """Observer endpoint: copies public channels out of the loop, and external messages into it.

    Args:
        keys: Keys of the robot.
        listen: Zenoh endpoint; a free port on loopback unless given.

    Attributes:
        endpoint: Zenoh endpoint that it listens on.
        copied_messages: Messages copied to observers.
        external_configs: Configurations received from external clients.
        external_velocities: Joint velocities received from external clients.

    Raises:
        PortInUseError: the endpoint is in use.
    """

    def __init__(self, keys: Keys, listen: str | None = None) -> None:
        self._keys = keys
        self.endpoint, self._public = _listen_on(listen)
        self.copied_messages = 0
        self.external_configs = 0
        self.external_velocities = 0
        self._latest_topologies: dict[str, bytes] = {}
        self._latest_values: dict[str, bytes] = {}
        self._load_subscribed = False
        self._loop: LoopTransport | None = None
        self._lock = threading.Lock()
        self._request_server = RequestServer(keys, self._put_external)
        self._request_worker = RequestWorker(self._request_server)
        self._public.declare_queryable(keys.of("request", "*"), self._request_worker.handle_query)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def counters(self) -> dict[str, int]:
        """Nonzero counts of messages copied to observers and received from external clients."""
        counts = {
            "copied_messages": self.copied_messages,
            "external_configs": self.external_configs,
            "external_velocities": self.external_velocities,
        }
        counts |= self._request_server.counters
        return {name: count for name, count in counts.items() if count}

    def serve_deployment(self, deployment_info: DeploymentInfo) -> None:
        """Declare a queryable that replies with the deployment."""
        answer = {self._keys.deployment: encode(deployment_info)}
        self._public.declare_queryable(self._keys.deployment, lambda query: query.reply_values(answer))

    def attach(self, loop: LoopTransport) -> None:
        """Subscribe to the loop at `loop` on demand of observers, and accept external messages."""
        self._loop = loop
        keys = self._keys
        for row in CHANNELS:
            expression = self._expression(row)
            if row.name == "config":
                self._public.declare_subscriber(expression, self._forward_config)
            elif row.name == "velocity":
                self._public.declare_subscriber(expression, self._forward_velocity)
            elif row.name == "links":
                self._public.declare_matching_listener(
                    expression, _CopyOnDemand(loop.session.declare_subscriber, self, expression)
                )
            elif row.public and not row.best_effort:
                self._public.declare_matching_listener(
                    expression, _CopyOnDemand(loop.declare_loop_subscriber, self, expression)
                )
        loop.session.declare_subscriber(keys.of("topology", "*"), self._latest_topologies.__setitem__)
        loop.session.declare_subscriber(keys.of("state"), self._on_state)
        loop.session.declare_subscriber(keys.of("answer"), self._on_answer)
        loop.session.declare_liveliness_subscriber(keys.liveliness(Role.CONTROLLER, "*"), self._on_controller)
        self._public.declare_queryable(keys.of("topology", "*"), self._reply_topologies)
        loop.session.declare_subscriber(keys.of("state_machine"), self._on_state_machine)
        self._public.declare_matching_listener(keys.of("processes"), self._on_load_subscribed)
        for name in ("state", "state_machine"):
            self._public.declare_queryable(keys.of(name), self._reply_latest)

    def _reply_topologies(self, query: Query) -> None:
        query.reply_values(self._latest_topologies.copy())

    def _reply_latest(self, query: Query) -> None:
        query.reply_values(self._latest_values.copy())

    def _expression(self, row: Channel) -> str:
        return self._keys.of(row.name, *["*"] * row.pattern.count("<"))

    def publish_copy(self, key: str, payload: bytes) -> None:
        """Publish a copy to observers, best-effort."""
        self.copied_messages += 1
        self._public.put(key, payload)

    def _forward_config(self, key: str, payload: bytes) -> None:
        """Forward an external configuration, without a send time: only the controller's have one."""
        try:
            config = msgspec.structs.replace(decode(payload, Config), t_ns=0)
        except ProtocolError:
            self._put_external(key, payload)  # the cell process counts it and logs its key
        else:
            self.external_configs += 1
            self._put_external(key, encode(config))

    def _forward_velocity(self, key: str, payload: bytes) -> None:
        """Forward an external joint velocity; the controller checks it."""
        self.external_velocities += 1
        self._put_external(key, payload)

    def _put_external(self, key: str, payload: bytes) -> None:
        """Put an external message into the loop, from any thread; discard it after the end of the loop."""
        with self._lock:
            if self._loop is not None:
                self._loop.put(key, payload)
                self._loop.flush()

    def _on_state(self, key: str, payload: bytes) -> None:
        self._latest_values[key] = payload
        self._request_worker.enable()
        self.publish_copy(key, payload)

    def _on_state_machine(self, key: str, payload: bytes) -> None:
        self._latest_values[key] = payload
        self.publish_copy(key, payload)

    def _on_load_subscribed(self, wanted: bool) -> None:
        self._load_subscribed = wanted

    def publish_process_load(self, load: Callable[[], ProcessLoad]) -> None:
        """Publish the process load if an observer subscribes."""
        if self._load_subscribed:
            self.publish_copy(self._keys.of("processes"), encode(load()))

    def _on_answer(self, key: str, payload: bytes) -> None:
        self._request_worker.handle_answer(payload)
        self.publish_copy(key, payload)

    def _on_controller(self, _key: str, present: bool) -> None:
        if not present:
            self._request_worker.disable("the controller is gone")

    def detach(self) -> None:
        """Detach from the loop; external messages are discarded from now on."""
        with self._lock:
            self._loop = None
        self._request_worker.disable("the run has ended")

    def close(self) -> None:
        """Close the endpoint and the request worker."""
        self._request_worker.close()
        self._public.close()


class _CopyOnDemand:
    """Matching-status handler: subscribes to the loop while an observer subscribes to the copy."""

    def __init__(
        self,
        declare_subscriber: Callable[[str, OnMessage], Undeclare],
        endpoint: ObserverEndpoint,
        expression: str,
    ) -> None:
        self._declare_subscriber, self._endpoint, self._expression = declare_subscriber, endpoint, expression
        self._undeclare: Undeclare | None = None

    def __call__(self, matching: bool) -> None:
        if matching and self._undeclare is None:
            self._undeclare = self._declare_subscriber(self._expression, self._endpoint.publish_copy)
        elif not matching and self._undeclare is not None:
            self._undeclare()
            self._undeclare = None
