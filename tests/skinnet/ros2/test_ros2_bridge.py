"""The bridge with real Zenoh: what a run tells arrives in ROS 2, as a stranger to its code reads it."""

import json
import math
import queue
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from launching import TOUCH, launched, wait_for
from locations import SUPPORT
from ros2_run import ARM, KEYS, events, joints, stream, topology

from skinnet.body.link_kinematics import LinkKinematics
from skinnet.deployment import load, resolved_json
from skinnet.errors import DeploymentError, PortInUseError, SkinnetError, UnreachableError
from skinnet.protocol.channels import EXTERNAL
from skinnet.protocol.external_messages import DeploymentInfo, ExternalVelocity
from skinnet.protocol.messages import ControllerState, decode, encode
from skinnet.ros2.bridge import NODE_NAME, BridgeOptions, bridge
from skinnet.run.observers.observer_endpoint import ObserverEndpoint, free_endpoint
from skinnet.transport.in_memory import InMemoryHub

pytestmark = [pytest.mark.processes, pytest.mark.timeout(120)]

PATIENCE_S = 60.0
"""Nobody ever waits as long, unless something is lost."""
POSE = (0.3, -0.2, 0.7)
FULL = (0.5, 0.25, 0.125, 0.75, 0.0, 0.0, 1.0, 30.5)


class Run:
    """A run's watch endpoint, and a loop behind it in which nothing happens by itself."""

    def __init__(self, deployed: DeploymentInfo | None) -> None:
        self.watch = ObserverEndpoint(KEYS)
        self.endpoint = self.watch.endpoint
        if deployed is not None:
            self.watch.serve_deployment(deployed)
        hub = InMemoryHub(KEYS)
        self.watch.attach(hub.connect(EXTERNAL))
        self._member = hub.connect("body")
        self.velocities: queue.SimpleQueue[list[float]] = queue.SimpleQueue()
        self._member.declare_loop_subscriber(KEYS.of("velocity"), self._on_velocity)

    def _on_velocity(self, _key: str, payload: bytes) -> None:
        self.velocities.put(decode(payload, ExternalVelocity).velocity_rad_s)

    def put(self, name: str, *fields: str | int, payload: bytes) -> None:
        self._member.put(KEYS.of(name, *fields), payload)
        self._member.flush()

    def publish_best_effort(self, name: str, *fields: str | int, payload: bytes) -> None:
        self._member.session.put(KEYS.of(name, *fields), payload)


@contextmanager
def run_of(deployed: DeploymentInfo | None) -> Iterator[Run]:
    run = Run(deployed)
    try:
        yield run
    finally:
        run.watch.detach()
        run.watch.close()


def arm(*overrides: str) -> DeploymentInfo:
    return DeploymentInfo(
        deployment=resolved_json(load(ARM, overrides)).decode(), base_folder=str(ARM.parent)
    )


class Bridged:
    """A bridge in a thread of its own: what it says, and how it ends."""

    def __init__(self, order: BridgeOptions) -> None:
        self.said: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.sent: dict[str, int] = {}
        self.error: SkinnetError | None = None
        self._thread = threading.Thread(target=self._go, args=(order,))
        self._thread.start()

    def _go(self, order: BridgeOptions) -> None:
        try:
            self.sent = bridge(order, self.said.put)
        except SkinnetError as error:
            self.error = error
            self.said.put("")

    def wait_for(self, text: str) -> str:
        while True:
            line = self.said.get(timeout=PATIENCE_S)
            assert self.error is None, self.error
            if text in line:
                return line

    def join(self) -> None:
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()


class Listener:
    """The independent process, and what it has found."""

    def __init__(self, router: str, domain: int) -> None:
        line = [sys.executable, str(SUPPORT / "ros2_listener.py"), router, str(domain)]
        self._process = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._facts: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        self.found: dict[str, dict[str, Any]] = {}
        self.nodes: list[str] = []
        self.subscriptions: set[str] = set()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._facts.put(json.loads(line))

    def until(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first fact that is wanted; fails at an error."""
        while True:
            fact = self._facts.get(timeout=PATIENCE_S)
            assert "error" not in fact, fact
            if "found" in fact:
                self.found[fact["found"]] = fact
            if "node" in fact and "found" not in fact:
                self.nodes.append(fact["node"])
            if "subscription" in fact:
                self.subscriptions.add(fact["subscription"])
            if wanted(fact):
                return fact

    def message(self, topic: str, wanted: Callable[[Any], bool] = lambda _: True) -> Any:
        """The first message on a topic that is wanted."""
        return self.until(lambda fact: fact.get("topic") == topic and wanted(fact["message"]))["message"]

    def wait_for_subscription(self, topic: str) -> None:
        """Somebody listens to what is sent on a topic."""
        if topic not in self.subscriptions:
            self.until(lambda fact: fact.get("subscription") == topic)

    def say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def leave(self) -> None:
        """Its input ends, and so should it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        assert self._process.wait(timeout=PATIENCE_S) == 0

    def close(self) -> None:
        """Gone, by force if need be."""
        self._process.kill()
        self._reader.join()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()


@contextmanager
def listener(router: str, domain: int = 0) -> Iterator[Listener]:
    one = Listener(router, domain)
    try:
        yield one
        one.leave()
    finally:
        one.close()


@contextmanager
def zenoh_router() -> Iterator[str]:
    """A router as of ROS 2, by Zenoh alone."""
    endpoint = free_endpoint()
    config = zenoh.Config()
    for key, value in (
        ("mode", "router"),
        ("listen/endpoints", [endpoint]),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config):
        yield endpoint


def keep_telling(run: Run, stop: threading.Event) -> None:
    """Time goes on, the arm stands, one cell streams, another was touched: over and over."""
    t_ns = 0
    touch = events("fore_link", (1, 0, 2, 10, 0.25), (1, 1, 0, 10, 0.5))
    readings = stream("base", (0, 4, 20, FULL))
    while not stop.wait(0.005):
        t_ns += 5_000_000
        run.put("events", "fore_link", 1, payload=encode(touch))
        run.put("stream", "base", payload=encode(readings))
        run.put("joints", payload=joints(t_ns, *POSE))
        run.publish_best_effort(
            "state", payload=encode(ControllerState(t_ns=t_ns, stage="evade", progress=0.5))
        )


@contextmanager
def telling(run: Run) -> Iterator[None]:
    stop = threading.Event()
    thread = threading.Thread(target=keep_telling, args=(run, stop))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def chain(transforms: list[Any], frame: str) -> np.ndarray:
    """Where the origin of `frame` is in the world, by transforms of the graph alone."""
    by_child = {t["child_frame_id"]: t for t in transforms}
    at = np.zeros(3)
    while frame != "world":
        t = by_child[frame]
        turn, shift = t["transform"]["rotation"], t["transform"]["translation"]
        axis, w = np.array([turn["x"], turn["y"], turn["z"]]), turn["w"]
        at = at + 2 * w * np.cross(axis, at) + 2 * np.cross(axis, np.cross(axis, at))
        at = at + np.array([shift["x"], shift["y"], shift["z"]])
        frame = t["header"]["frame_id"]
    return at


def test_a_stranger_reads_the_run_in_ros() -> None:
    """Values are the run's; topics are found by tokens; a late listener gets the fixed transforms."""
    with run_of(arm()) as run, zenoh_router() as router:
        run.publish_best_effort(
            "topology", "upper_link", payload=encode(topology("upper_link", 1, 0, 2, 3, 4, 5))
        )
        with telling(run), listener(router, 3) as ros:
            bridged = Bridged(BridgeOptions(run.endpoint, domain_id=3, router=router))
            bridged.wait_for("/diagnostics")
            fixed = ros.message("/tf_static")["transforms"]
            state = ros.message("/arm/joint_states")
            moving = ros.message("/tf")["transforms"]
            felt = ros.message("/arm/skin", lambda m: max(m["points"]["force"]) > 0.4)["points"]
            markers = ros.message("/arm/skin/markers")["markers"]
            status = {
                s["name"]: s
                for s in ros.message("/diagnostics", lambda m: m["status"][0]["level"] == 0)["status"]
            }
            seconds = ros.message("/clock")["clock"]
            assert f"/arm/{NODE_NAME}" in ros.nodes
            assert {name: fact["type"] for name, fact in ros.found.items()} == {
                "/clock": "rosgraph_msgs/msg/Clock",
                "/arm/joint_states": "sensor_msgs/msg/JointState",
                "/tf": "tf2_msgs/msg/TFMessage",
                "/tf_static": "tf2_msgs/msg/TFMessage",
                "/arm/skin": "sensor_msgs/msg/PointCloud2",
                "/arm/skin/markers": "visualization_msgs/msg/MarkerArray",
                "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
            }
            assert {fact["node"] for fact in ros.found.values()} == {f"/arm/{NODE_NAME}"}
            with listener(router, 3) as late:
                assert late.message("/tf_static")["transforms"] == fixed
            with listener(router, 0) as elsewhere:
                assert elsewhere.until(lambda fact: "tokens" in fact)["tokens"] == 0
    bridged.wait_for(f"the run at {run.endpoint} is over")
    bridged.join()
    assert bridged.sent["/tf_static"] == 1
    assert min(bridged.sent.values()) > 0
    assert state["position"] == list(POSE)
    assert state["name"] == ["shoulder_pitch", "shoulder_roll", "elbow"]
    assert seconds["sec"] + seconds["nanosec"] * 1e-9 > 0.0
    poses = LinkKinematics(load(ARM), ARM.parent).poses(POSE)
    for i, name in enumerate(("arm/base", "arm/upper_link", "arm/fore_link")):
        np.testing.assert_allclose(chain(fixed + moving, name), poses.position_m[i], atol=1e-12)
    rows = list(zip(felt["patch"], felt["cell"], felt["force"], felt["proximity"], strict=True))
    assert (2, 1, 0.25, 0.5) in rows
    assert (0, 4, 0.5, 0.75) in rows
    assert felt["temperature"][4] == 30.5
    assert sum(math.isnan(t) for t in felt["temperature"]) == 14
    assert [m["header"]["frame_id"] for m in markers] == ["arm/base", "arm/upper_link", "arm/fore_link"]
    assert status["arm: run"]["message"] == "evade"
    assert status["arm: skin upper_link"]["message"] == "5 of 6 cells connected"  # asked for at the start


def test_the_bridge_can_be_the_router() -> None:
    """Nodes that know only the bridge find it, and each other."""
    with run_of(arm()) as run:
        endpoint = free_endpoint()
        with telling(run):
            bridged = Bridged(BridgeOptions(run.endpoint, listen=endpoint))
            bridged.wait_for("/diagnostics")
            with listener(endpoint) as ros:
                assert ros.message("/arm/joint_states")["position"] == list(POSE)
            with peer(endpoint) as one, peer(endpoint) as other:
                heard: queue.SimpleQueue[bytes] = queue.SimpleQueue()
                other.declare_subscriber("0/chatter/**", lambda sample: heard.put(sample.payload.to_bytes()))
                publisher = one.declare_publisher("0/chatter/std_msgs::msg::dds_::String_/RIHS01_00")
                matched = threading.Event()
                listening = publisher.declare_matching_listener(
                    lambda s: matched.set() if s.matching else None
                )
                if publisher.matching_status.matching:
                    matched.set()
                assert matched.wait(PATIENCE_S)
                publisher.put(b"hello")
                assert heard.get(timeout=PATIENCE_S) == b"hello"
                listening.undeclare()
    bridged.join()
    assert bridged.error is None


@contextmanager
def peer(router: str) -> Iterator[Any]:
    """A session with the defaults of rmw_zenoh: a peer that knows the router."""
    config = zenoh.Config()
    for key, value in (
        ("mode", "peer"),
        ("connect/endpoints", [router]),
        ("listen/endpoints", ["tcp/localhost:0"]),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", True),
    ):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield session


MOVABLE = "controller.external_velocity=true"
COMMANDS = "/arm/joint_velocity_commands"


def test_velocities_of_ros_reach_the_run() -> None:
    """What makes no sense is refused with one line that names its sender, and stops the robot."""
    with run_of(arm(MOVABLE)) as run, zenoh_router() as router, telling(run), listener(router) as ros:
        bridged = Bridged(BridgeOptions(run.endpoint, router=router, accept_velocities=True))
        bridged.wait_for(COMMANDS)
        ros.wait_for_subscription(COMMANDS)
        ros.say(f"velocities {COMMANDS} 0.25 -0.5 0.125")
        assert run.velocities.get(timeout=PATIENCE_S) == [0.25, -0.5, 0.125]
        wrong = ("0.25 -0.5", "0.25 -0.5 0.125 9.0", "0.25 nan 0.125", "inf 0.0 0.0", "")
        for numbers in (*wrong, wrong[0]):
            ros.say(f"velocities {COMMANDS} {numbers}")
            assert run.velocities.get(timeout=PATIENCE_S) == [0.0, 0.0, 0.0]
        ros.say(f"velocities {COMMANDS} 0.0 0.0 0.25")
        assert run.velocities.get(timeout=PATIENCE_S) == [0.0, 0.0, 0.25]
        lines = {bridged.wait_for("refused") for _ in range(4)}
        assert lines == {
            "refused: /teleop: 2 velocities; expected 3, one for each joint",
            "refused: /teleop: 4 velocities; expected 3, one for each joint",
            "refused: /teleop: velocities are not finite",
            "refused: /teleop: 0 velocities; expected 3, one for each joint",
        }
    assert "refused 2 times: /teleop: 2 velocities" in bridged.wait_for("refused 2 times")
    assert run.velocities.empty()
    bridged.join()


def test_without_control_ros_moves_nothing() -> None:
    with run_of(arm(MOVABLE)) as run, zenoh_router() as router, telling(run), listener(router) as ros:
        bridged = Bridged(BridgeOptions(run.endpoint, router=router))
        bridged.wait_for("/diagnostics")
        ros.say(f"velocities {COMMANDS} 0.25 -0.5 0.125")
        ros.message("/arm/joint_states")
        ros.message("/diagnostics")
        assert run.velocities.empty()
    bridged.join()


def test_a_run_that_takes_no_velocities() -> None:
    with run_of(arm()) as run, pytest.raises(SkinnetError, match=r"controller\.external_velocity=true"):
        bridge(BridgeOptions(run.endpoint, accept_velocities=True), print)


def test_nobody_at_the_watch_endpoint() -> None:
    with pytest.raises(UnreachableError, match="nobody answers there"):
        bridge(BridgeOptions(free_endpoint()), print)


def test_a_zenoh_endpoint_without_a_run() -> None:
    with zenoh_router() as router, pytest.raises(SkinnetError, match="no run serves its deployment there"):
        bridge(BridgeOptions(router), print)


@pytest.mark.parametrize("deployment", ["no json", "{}", '{"name": 1}'])
def test_a_run_of_another_version(deployment: str) -> None:
    with (
        run_of(DeploymentInfo(deployment=deployment, base_folder="/")) as run,
        pytest.raises(SkinnetError, match=run.endpoint),
    ):
        bridge(BridgeOptions(run.endpoint), print)


def test_no_router() -> None:
    with run_of(arm()) as run, pytest.raises(SkinnetError, match="or give --listen"):
        bridge(BridgeOptions(run.endpoint, router=free_endpoint()), print)


def test_the_port_of_the_router_is_taken() -> None:
    with run_of(arm()) as run, socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(PortInUseError, match="already taken"):
            bridge(BridgeOptions(run.endpoint, listen=endpoint), print)


def test_the_model_is_not_on_this_machine(tmp_path: Path) -> None:
    with run_of(arm()) as run, pytest.raises(DeploymentError, match=r"two_link_arm\.xml"):
        bridge(BridgeOptions(run.endpoint, base=tmp_path), print)


def test_two_bridges_of_one_robot() -> None:
    with run_of(arm()) as run, zenoh_router() as router:
        first = Bridged(BridgeOptions(run.endpoint, router=router))
        first.wait_for("/diagnostics")
        with pytest.raises(SkinnetError, match="a node of that name already exists in domain"):
            bridge(BridgeOptions(run.endpoint, router=router), print)
    first.join()


def commanded(*arguments: str, before: str = "pass") -> tuple[int, str]:
    """Exit code and errors of `skinnet bridge ros2`, in a Python that does `before` first."""
    code = f"import sys; {before}; from skinnet.cli.main import main; main()"
    line = [sys.executable, "-c", code, "bridge", "ros2", *arguments]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    return done.returncode, done.stderr


def test_the_command_line_says_in_one_line_what_is_wrong() -> None:
    endpoint = free_endpoint()
    code, errors = commanded(endpoint)
    assert (code, errors.count("\n")) == (2, 1)
    assert errors.startswith(f"skinnet: {endpoint}: no Zenoh endpoint, or nobody answers there")


def test_without_the_extra_it_says_which_one_to_install() -> None:
    code, errors = commanded(free_endpoint(), before="sys.modules['xxhash'] = None")
    assert code == 1
    mend = "install the extra: pip install 'skinnet[ros2]'"
    assert errors == f"skinnet: module xxhash is not installed; {mend}\n"


def test_the_command_line_follows_a_run(tmp_path: Path) -> None:
    """`skinnet run` in processes of its own, `skinnet bridge ros2`, and the stranger, who moves a joint."""
    settings = ('controller.program=["map"]', "controller.map.periods=400", "run.pace=realtime", MOVABLE)
    with launched(TOUCH, tmp_path, settings=settings) as process:
        endpoint = wait_for(process, "connect to").split("connect to ")[1].split(",")[0]
        router = free_endpoint()
        line = [sys.executable, "-m", "skinnet.cli", "bridge", "ros2", endpoint, "--listen", router]
        line += ["--rate", "20", "--control"]
        bridging = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
        assert bridging.stdout is not None
        try:
            said = [bridging.stdout.readline()]
            while "/hrp2/joint_velocity_commands" not in said[-1]:
                assert said[-1], said
                said.append(bridging.stdout.readline())
            with listener(router) as ros:
                first = ros.message("/hrp2/joint_states")
                cloud = ros.message("/hrp2/skin", lambda m: not math.isnan(m["points"]["temperature"][0]))
                ros.wait_for_subscription("/hrp2/joint_velocity_commands")

                def turned(message: Any) -> bool:
                    """Asks for more, until a joint is further away than the map ever takes it."""
                    ros.say("velocities /hrp2/joint_velocity_commands 0.5" + " 0.0" * 13)
                    return abs(message["position"][0] - first["position"][0]) > 0.1

                later = ros.message("/hrp2/joint_states", turned)
            process.terminate()
            rest, _ = bridging.communicate(timeout=PATIENCE_S)
            assert bridging.returncode == 0
        finally:
            bridging.kill()
            bridging.communicate()
    assert len(later["name"]) == 14
    assert len(cloud["points"]["x"]) == 74
    assert f"the run at {endpoint} is over" in rest
    assert "refused" not in "".join(said) + rest
