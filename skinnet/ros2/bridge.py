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

from skinnet.body.links import Links
from skinnet.channels import Keys, channel
from skinnet.clock import NS_PER_S, next_multiple
from skinnet.errors import ProtocolError, SkinnetError
from skinnet.messages import encode
from skinnet.outside_messages import Velocity
from skinnet.ros2 import types
from skinnet.ros2.control import Control
from skinnet.ros2.mirror import CHANNELS, Mirror
from skinnet.ros2.node import RosNode, RosPublisher
from skinnet.ros2.qos import Durability, Qos, Reliability
from skinnet.transport.client import what_runs
from skinnet.transport.open_session import OpenSession

__all__ = ["NODE", "Order", "bridge"]

NODE = "skinnet_bridge"
"""Node name, in the namespace of the robot."""
_ASK_S = 5.0
_WAITING = 100_000
"""Queue capacity for messages of the run; the oldest are dropped."""
_MARKERS_HZ, _DIAGNOSTICS_HZ = 10.0, 1.0
_REASONS = 20
"""Distinct refusal reasons that are printed; further ones are only counted."""

_NEWEST = Qos(reliability=Reliability.BEST_EFFORT, depth=1)
_SENSOR = Qos(reliability=Reliability.BEST_EFFORT, depth=5)
_RELIABLE = Qos()
_LAST = Qos(depth=1)
_KEPT = Qos(durability=Durability.TRANSIENT_LOCAL, depth=1)

Say = Callable[[str], None]


@dataclass(frozen=True)
class Order:
    """Options of the bridge's command line.

    Attributes:
        endpoint: Observer endpoint of the run.
        domain: ROS_DOMAIN_ID.
        router: Endpoint of the Zenoh router of the ROS 2 system.
        listen: Endpoint at which the bridge is that router itself, if given.
        rate_hz: Highest publication rate of joints, transforms and skin [Hz].
        base: Folder that the model's path starts from, if it differs from the run's.
        control: Accept joint velocities from ROS.
    """

    endpoint: str
    domain: int = 0
    router: str = "tcp/localhost:7447"
    listen: str | None = None
    rate_hz: float = 50.0
    base: Path | None = None
    control: bool = False


@dataclass
class _Topic:
    """Published topic with its period and message factory."""

    publisher: RosPublisher
    period_ns: int
    make: Callable[[], Any]
    always: bool
    """Publish also while simulated time stands still."""
    due_ns: int = 0
    t_ns: int = -1
    """Simulated time of the last message [ns]."""


def bridge(order: Order, say: Say) -> dict[str, int]:
    """Bridge a run to ROS 2 until it is over; return the number of messages sent on each topic.

    Raises:
        SkinnetError: the run or the ROS 2 router is unreachable, or the run is of an unknown format.
    """
    with contextlib.ExitStack() as stack:
        watch = OpenSession("client", order.endpoint)
        stack.callback(watch.close)
        deployment, told_base = what_runs(watch, order.endpoint)
        if order.control and not deployment.controller.outside_velocity:
            raise SkinnetError(
                "--control: the run takes no velocities; start it with --set controller.outside_velocity=true"
            )
        mirror = Mirror(deployment, Links(deployment, order.base or told_base))
        ros = _ros_side(order)
        stack.callback(ros.close)
        node = RosNode(ros, order.domain, f"/{mirror.robot}", NODE)
        where = f"ROS 2, domain {order.domain}, node /{mirror.robot}/{NODE}"
        say(f"robot {deployment.robot} at {order.endpoint} -> {where}")
        return _Bridge(order, mirror, node, watch, Keys(deployment.robot), say).run()


def _ros_side(order: Order) -> OpenSession:
    if order.listen is not None:
        return OpenSession("router", order.listen)
    try:
        return OpenSession("client", order.router)
    except SkinnetError as error:
        hint = "start a router with ros2 run rmw_zenoh_cpp rmw_zenohd, or give --listen"
        raise SkinnetError(f"{error}; {hint}") from error


class _Bridge:
    def __init__(
        self, order: Order, mirror: Mirror, node: RosNode, watch: OpenSession, keys: Keys, say: Say
    ) -> None:
        self._order, self._mirror, self._node, self._watch, self._say = order, mirror, node, watch, say
        self._inbox: deque[tuple[str, bytes]] = deque(maxlen=_WAITING)
        self._complaints: Counter[str] = Counter()
        self._reasons: deque[str] = deque(maxlen=_WAITING)
        self._heard_ns = time.monotonic_ns()
        self._fixed = node.publisher("/tf_static", types.TRANSFORMS, _KEPT)
        self._fixed.publish(mirror.fixed_links())
        self._topics = self._declare(f"/{mirror.robot}", order.rate_hz)
        for name in CHANNELS:
            watch.subscribe(keys.of(name, *["*"] * channel(name).pattern.count("<")), self._put_aside)
        for key, payload in watch.ask(keys.of("topology", "*"), _ASK_S).items():
            self._put_aside(key, payload)
        self._control = Control(mirror.n_dofs)
        self._velocity_key = keys.of("velocity")
        if order.control:
            topic = f"/{mirror.robot}/joint_velocity_commands"
            say(f"  {topic}  {types.VELOCITIES}, moves the robot")
            node.watch_publishers(topic, self._control.see)
            node.subscribe(topic, types.VELOCITIES, _LAST, self._on_velocity)

    def _declare(self, robot: str, hz: float) -> list[_Topic]:
        mirror = self._mirror
        topics = [
            self._topic("/clock", types.CLOCK, _NEWEST, hz, mirror.clock),
            self._topic(f"{robot}/joint_states", types.JOINT_STATE, _RELIABLE, hz, mirror.joint_state),
            self._topic("/tf", types.TRANSFORMS, _RELIABLE, hz, mirror.moving_links),
        ]
        if mirror.has_cells:
            seldom_hz = min(hz, _MARKERS_HZ)
            topics += [
                self._topic(f"{robot}/skin", types.POINT_CLOUD, _SENSOR, hz, mirror.skin),
                self._topic(f"{robot}/skin/markers", types.MARKERS, _RELIABLE, seldom_hz, mirror.markers),
            ]
        if mirror.has_sheets:
            topics.append(
                self._topic(f"{robot}/skin/regions", types.POINT_CLOUD, _SENSOR, hz, mirror.regions)
            )
        seldom_hz = min(hz, _DIAGNOSTICS_HZ)
        topics.append(
            self._topic("/diagnostics", types.DIAGNOSTICS, _RELIABLE, seldom_hz, self._diagnose, always=True)
        )
        return topics

    def _topic(
        self, name: str, type_name: str, qos: Qos, hz: float, make: Callable[[], Any], *, always: bool = False
    ) -> _Topic:
        self._say(f"  {name}  {type_name}, up to {hz:g} Hz")
        return _Topic(self._node.publisher(name, type_name, qos), round(NS_PER_S / hz), make, always)

    def _put_aside(self, key: str, payload: bytes, _attachment: bytes | None = None) -> None:
        self._inbox.append((key, payload))

    def run(self) -> dict[str, int]:
        """Run the publication loop until the run is over."""
        tick_ns = round(NS_PER_S / self._order.rate_hz)
        while self._watch.connected:
            self._take_in()
            now_ns = time.monotonic_ns()
            for topic in self._topics:
                self._publish(topic, now_ns)
            now_ns = time.monotonic_ns()
            time.sleep((next_multiple(now_ns, tick_ns) - now_ns) / NS_PER_S)
        self._say(f"the run at {self._order.endpoint} is over")
        for reason, count in self._complaints.items():
            self._say(f"refused {count} times: {reason}")
        publishers = [self._fixed, *(topic.publisher for topic in self._topics)]
        return {publisher.entity.topic: publisher.sent for publisher in publishers}

    def _publish(self, topic: _Topic, now_ns: int) -> None:
        fresh = topic.always or self._mirror.t_ns > topic.t_ns
        if fresh and now_ns >= topic.due_ns and topic.publisher.wanted:
            topic.due_ns = next_multiple(now_ns, topic.period_ns)
            topic.t_ns = self._mirror.t_ns
            topic.publisher.publish(topic.make())

    def _on_velocity(self, _key: str, payload: bytes, attachment: bytes | None) -> None:
        """Forward a velocity command, in a Zenoh thread; on an invalid one, send zero velocities."""
        try:
            velocity = self._control.velocity(payload, attachment)
        except ProtocolError as error:
            velocity = Velocity(velocity_rad_s=[0.0] * self._mirror.n_dofs)
            self._reasons.append(str(error))
        self._watch.tell(self._velocity_key, encode(velocity))

    def _take_in(self) -> None:
        """Process the queued messages of the run."""
        before_ns = self._mirror.t_ns
        for _ in range(len(self._inbox)):
            key, payload = self._inbox.popleft()
            try:
                self._mirror.take(key, payload)
            except ProtocolError as error:
                self._reasons.append(str(error))
        for _ in range(len(self._reasons)):
            self._complain(self._reasons.popleft())
        if self._mirror.t_ns > before_ns:
            self._heard_ns = time.monotonic_ns()

    def _complain(self, reason: str) -> None:
        """Print a refusal reason the first time; count every occurrence."""
        if reason not in self._complaints:
            if len(self._complaints) >= _REASONS:
                reason = "for other reasons"
            else:
                self._say(f"refused: {reason}")
        self._complaints[reason] += 1

    def _diagnose(self) -> Any:
        silent_s = (time.monotonic_ns() - self._heard_ns) / NS_PER_S
        figures: dict[str, object] = {t.publisher.entity.topic: t.publisher.sent for t in self._topics}
        if self._order.control:
            figures |= {"velocities": self._control.taken, "refused_velocities": self._control.refused}
        return self._mirror.diagnostics(silent_s, figures)
