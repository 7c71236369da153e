"""ROS 2 bridge process: a client of a run's observer endpoint, and a node of the ROS graph.

It subscribes to the run's best-effort publications and queues them as they come. At its own rate it publishes
the newest state on the topics that have subscribers. The run never waits for it.
"""

import contextlib
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinnet.body.link_kinematics import LinkKinematics
from skinnet.clock import NS_PER_S, next_multiple
from skinnet.errors import ProtocolError, SkinnetError
from skinnet.protocol.channels import Keys, channel
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import INVALID_CONTENT, encode
from skinnet.ros2 import message_types as types
from skinnet.ros2.message_builder import SUBSCRIBED_CHANNELS, RosMessageBuilder
from skinnet.ros2.node import RosNode, RosPublisher
from skinnet.ros2.qos import Durability, QosProfile, Reliability
from skinnet.ros2.velocity_commands import VelocityCommandParser
from skinnet.transport.queries import query_deployment, query_values
from skinnet.transport.zenoh_session import ZenohSession

__all__ = ["NODE_NAME", "BridgeOptions", "bridge"]

NODE_NAME = "skinnet_bridge"
"""Node name, in the namespace of the robot."""
_QUERY_TIMEOUT_S = 5.0
_QUEUE_CAPACITY = 100_000
"""Queue capacity for messages of the run; the oldest are dropped."""
_MARKERS_HZ, _DIAGNOSTICS_HZ = 10.0, 1.0
_MAX_PRINTED_REASONS = 20
"""Distinct refusal reasons that are printed; further ones are only counted."""

_NEWEST_QOS = QosProfile(reliability=Reliability.BEST_EFFORT, depth=1)
_SENSOR_QOS = QosProfile(reliability=Reliability.BEST_EFFORT, depth=5)
_RELIABLE_QOS = QosProfile()
_COMMAND_QOS = QosProfile(depth=1)
_LATCHED_QOS = QosProfile(durability=Durability.TRANSIENT_LOCAL, depth=1)

Log = Callable[[str], None]


@dataclass(frozen=True)
class BridgeOptions:
    """Options of the bridge's command line.

    Attributes:
        endpoint: Observer endpoint of the run.
        domain_id: ROS_DOMAIN_ID.
        router: Endpoint of the Zenoh router of the ROS 2 system.
        listen: Endpoint at which the bridge is that router itself, if given.
        rate_hz: Highest publication rate of joints, transforms and skin [Hz].
        base: Folder that the model's path starts from, if it differs from the run's.
        accept_velocities: Accept joint velocities from ROS.
    """

    endpoint: str
    domain_id: int = 0
    router: str = "tcp/localhost:7447"
    listen: str | None = None
    rate_hz: float = 50.0
    base: Path | None = None
    accept_velocities: bool = False


@dataclass
class _PublishedTopic:
    """Published topic with its period and message factory."""

    publisher: RosPublisher
    period_ns: int
    make_message: Callable[[], Any]
    ignores_simulated_time: bool
    """Publish also while simulated time stands still."""
    due_ns: int = 0
    t_ns: int = -1
    """Simulated time of the last message [ns]."""


def bridge(options: BridgeOptions, log: Log) -> dict[str, int]:
    """Bridge a run to ROS 2 until it is over; return the number of messages sent on each topic.

    Raises:
        SkinnetError: the run or the ROS 2 router is unreachable, or the run is of an unknown format.
    """
    with contextlib.ExitStack() as stack:
        watch = ZenohSession.open_client(options.endpoint)
        stack.callback(watch.close)
        deployment, told_base = query_deployment(watch, options.endpoint)
        if options.accept_velocities and not deployment.controller.external_velocity:
            raise SkinnetError(
                "--control: the run takes no velocities; start it with "
                "--set controller.external_velocity=true"
            )
        mirror = RosMessageBuilder(deployment, LinkKinematics(deployment, options.base or told_base))
        ros = _open_ros_session(options)
        stack.callback(ros.close)
        node = RosNode(ros, options.domain_id, f"/{mirror.robot}", NODE_NAME)
        where = f"ROS 2, domain {options.domain_id}, node /{mirror.robot}/{NODE_NAME}"
        log(f"robot {deployment.robot} at {options.endpoint} -> {where}")
        return _Bridge(options, mirror, node, watch, Keys(deployment.robot), log).run()


def _open_ros_session(options: BridgeOptions) -> ZenohSession:
    if options.listen is not None:
        return ZenohSession.open_router(options.listen)
    try:
        return ZenohSession.open_client(options.router)
    except SkinnetError as error:
        hint = "start a router with ros2 run rmw_zenoh_cpp rmw_zenohd, or give --listen"
        raise SkinnetError(f"{error}; {hint}") from error


class _Bridge:
    def __init__(
        self,
        options: BridgeOptions,
        messages: RosMessageBuilder,
        node: RosNode,
        observer: ZenohSession,
        keys: Keys,
        log: Log,
    ) -> None:
        self._options, self._messages, self._node, self._observer, self._log = (
            options,
            messages,
            node,
            observer,
            log,
        )
        self._inbox: deque[tuple[str, bytes]] = deque(maxlen=_QUEUE_CAPACITY)
        self._refusals: Counter[str] = Counter()
        self._refusal_queue: deque[str] = deque(maxlen=_QUEUE_CAPACITY)
        self._last_advance_ns = time.monotonic_ns()
        self._static_publisher = node.create_publisher("/tf_static", types.TF_MESSAGE, _LATCHED_QOS)
        self._static_publisher.publish(messages.static_transforms())
        self._topics = self._declare(f"/{messages.robot}", options.rate_hz)
        for name in SUBSCRIBED_CHANNELS:
            observer.declare_subscriber(
                keys.of(name, *["*"] * channel(name).pattern.count("<")), self._enqueue
            )
        for key, payload in query_values(observer, keys.of("topology", "*"), _QUERY_TIMEOUT_S).items():
            self._enqueue(key, payload)
        self._control = VelocityCommandParser(messages.n_dofs)
        self._velocity_key = keys.of("velocity")
        if options.accept_velocities:
            topic = f"/{messages.robot}/joint_velocity_commands"
            log(f"  {topic}  {types.FLOAT64_MULTI_ARRAY}, moves the robot")
            node.on_publisher_liveliness(topic, self._control.on_publisher_liveliness)
            node.create_subscription(topic, types.FLOAT64_MULTI_ARRAY, _COMMAND_QOS, self._on_velocity)

    def _declare(self, robot: str, hz: float) -> list[_PublishedTopic]:
        mirror = self._messages
        topics = [
            self._topic("/clock", types.CLOCK, _NEWEST_QOS, hz, mirror.clock),
            self._topic(f"{robot}/joint_states", types.JOINT_STATE, _RELIABLE_QOS, hz, mirror.joint_state),
            self._topic("/tf", types.TF_MESSAGE, _RELIABLE_QOS, hz, mirror.moving_transforms),
        ]
        if mirror.has_cells:
            seldom_hz = min(hz, _MARKERS_HZ)
            topics += [
                self._topic(f"{robot}/skin", types.POINT_CLOUD2, _SENSOR_QOS, hz, mirror.skin_cloud),
                self._topic(
                    f"{robot}/skin/markers", types.MARKER_ARRAY, _RELIABLE_QOS, seldom_hz, mirror.markers
                ),
            ]
        if mirror.has_sheets:
            topics.append(
                self._topic(f"{robot}/skin/regions", types.POINT_CLOUD2, _SENSOR_QOS, hz, mirror.region_cloud)
            )
        seldom_hz = min(hz, _DIAGNOSTICS_HZ)
        topics.append(
            self._topic(
                "/diagnostics",
                types.DIAGNOSTIC_ARRAY,
                _RELIABLE_QOS,
                seldom_hz,
                self._diagnostics,
                ignores_simulated_time=True,
            )
        )
        return topics

    def _topic(
        self,
        name: str,
        type_name: str,
        qos: QosProfile,
        hz: float,
        make_message: Callable[[], Any],
        *,
        ignores_simulated_time: bool = False,
    ) -> _PublishedTopic:
        self._log(f"  {name}  {type_name}, up to {hz:g} Hz")
        return _PublishedTopic(
            self._node.create_publisher(name, type_name, qos),
            round(NS_PER_S / hz),
            make_message,
            ignores_simulated_time,
        )

    def _enqueue(self, key: str, payload: bytes) -> None:
        self._inbox.append((key, payload))

    def run(self) -> dict[str, int]:
        """Run the publication loop until the run has ended."""
        tick_ns = round(NS_PER_S / self._options.rate_hz)
        while self._observer.connected:
            self._process_inbox()
            now_ns = time.monotonic_ns()
            for topic in self._topics:
                self._publish(topic, now_ns)
            now_ns = time.monotonic_ns()
            time.sleep((next_multiple(now_ns, tick_ns) - now_ns) / NS_PER_S)
        self._log(f"the run at {self._options.endpoint} is over")
        for reason, count in self._refusals.items():
            self._log(f"refused {count} times: {reason}")
        publishers = [self._static_publisher, *(topic.publisher for topic in self._topics)]
        return {publisher.entity.topic: publisher.n_sent for publisher in publishers}

    def _publish(self, topic: _PublishedTopic, now_ns: int) -> None:
        fresh = topic.ignores_simulated_time or self._messages.t_ns > topic.t_ns
        if fresh and now_ns >= topic.due_ns and topic.publisher.has_subscribers:
            topic.due_ns = next_multiple(now_ns, topic.period_ns)
            topic.t_ns = self._messages.t_ns
            topic.publisher.publish(topic.make_message())

    def _on_velocity(self, _key: str, payload: bytes, attachment: bytes | None) -> None:
        """Forward a velocity command, in a Zenoh thread; on an invalid one, send zero velocities."""
        try:
            velocity = self._control.parse(payload, attachment)
        except ProtocolError as error:
            velocity = ExternalVelocity(velocity_rad_s=[0.0] * self._messages.n_dofs)
            self._refusal_queue.append(str(error))
        self._observer.put(self._velocity_key, encode(velocity))

    def _process_inbox(self) -> None:
        """Process the queued messages of the run."""
        before_ns = self._messages.t_ns
        for _ in range(len(self._inbox)):
            key, payload = self._inbox.popleft()
            try:
                self._messages.handle(key, payload)
            except INVALID_CONTENT as error:
                self._refusal_queue.append(str(error))
        for _ in range(len(self._refusal_queue)):
            self._count_refusal(self._refusal_queue.popleft())
        if self._messages.t_ns > before_ns:
            self._last_advance_ns = time.monotonic_ns()

    def _count_refusal(self, reason: str) -> None:
        """Print a refusal reason the first time; count every occurrence."""
        if reason not in self._refusals:
            if len(self._refusals) >= _MAX_PRINTED_REASONS:
                reason = "other reasons"
            else:
                self._log(f"refused: {reason}")
        self._refusals[reason] += 1

    def _diagnostics(self) -> Any:
        silent_s = (time.monotonic_ns() - self._last_advance_ns) / NS_PER_S
        values: dict[str, object] = {t.publisher.entity.topic: t.publisher.n_sent for t in self._topics}
        if self._options.accept_velocities:
            values |= {"velocities": self._control.n_accepted, "refused_velocities": self._control.n_refused}
        return self._messages.diagnostics(silent_s, values)
