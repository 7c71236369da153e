"""What users ask of the controller: handled at a tick, in its turn, answered once, noted if it mattered."""

from collections import Counter
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_robot import SHIPPED
from wired_controller import TICK_NS, Robot, Wired

from controller.process import build
from controller.request_queue import Reply, RequestHandler, RequestQueue
from controller.stages.stages import make_stage
from skinnet.deployment import load
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import Answer, ControllerState, Joints, Request, decode, encode

KEYS = Keys("bot")


def answers(news: list[tuple[str, bytes]]) -> list[Answer]:
    return [decode(payload, Answer) for key, payload in news if key == KEYS.of("answer")]


def states(news: list[tuple[str, bytes]]) -> list[str]:
    return [decode(payload, ControllerState).stage for key, payload in news if key == KEYS.of("state")]


class Lift:
    """A stage that goes up and down, on request only, and never ends."""

    def __init__(self, stage: Any) -> None:
        self._stage, self.floor = stage, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stage, name)

    @property
    def state_name(self) -> str:
        return f"floor{self.floor}"

    def handle_request(self, t_ns: int, name: str, argument: str) -> Reply:
        if name != "go" or not argument.isdecimal():
            return Reply(False, self.state_name, f"{name} {argument}: say go and a floor")
        self.floor = int(argument)
        return Reply(True, self.state_name)


@pytest.fixture
def lift(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stages of controllers take requests."""
    monkeypatch.setattr(
        "controller.controller.make_stage", lambda *args, **more: Lift(make_stage(*args, **more))
    )


def ask(robot: Wired, number: int, what: str, argument: str = "") -> None:
    robot.accept("request", Request(id=number, argument=argument), what)


@given(bursts=st.lists(st.integers(0, 12), min_size=1, max_size=20))
def test_requests_wait_in_their_order_and_a_tick_handles_few(bursts: list[int]) -> None:
    requests = RequestQueue(KEYS, counters := Counter())
    asked: list[tuple[int, str, str]] = []
    arrived = handled = waiting = 0

    def reply(t_ns: int, what: str, argument: str) -> Reply:
        asked.append((t_ns, what, argument))
        return Reply(int(argument) % 2 == 0, "up", "odd")

    for t_ns, burst in enumerate(bursts):
        for _ in range(burst):
            requests.add("go", Request(id=1000 + arrived, argument=str(arrived)))
            arrived += 1
        waiting = min(waiting + burst, 64)
        noted = requests.handle(t_ns, reply)
        told = answers(requests.take_answers())
        now = asked[handled:]
        assert len(now) == len(told) == min(waiting, 8)
        waiting -= len(now)
        handled = len(asked)
        assert [(1000 + int(argument), t_ns) for _, _, argument in now] == [(a.id, a.t_ns) for a in told]
        assert [a.accepted for a in told] == [int(argument) % 2 == 0 for _, _, argument in now]
        accepted = [list(row) for row in now if int(row[2]) % 2 == 0]
        assert (msgpack.unpackb(noted) if noted else []) == accepted
        assert requests.take_answers() == []
    assert asked == sorted(asked, key=lambda row: int(row[2]))
    assert counters["external_requests"] == arrived
    assert counters["dropped_requests"] == arrived - handled - waiting
    assert requests.log == [(*row, int(row[2]) % 2 == 0) for row in asked]


def test_a_stage_that_takes_none_refuses_and_says_which_it_is() -> None:
    robot = Wired("bow", "home")
    told = []
    while robot.node.needs() is not None:
        ask(robot, len(told), "go", "2")
        robot.step()
        told += answers(robot.node.best_effort_messages())
    begun = "the program has not started: the network of the skin is still forming"
    assert told[0] == Answer(id=0, t_ns=0, accepted=False, state="forming", reason=begun)
    assert [a.id for a in told] == list(range(len(told)))
    assert {(a.accepted, a.state, a.reason) for a in told[1:]} == {
        (False, stage, f"stage '{stage}' takes no requests") for stage in ("bow", "home")
    }
    assert robot.result.facts["requests"] == [(a.t_ns, "go", "2", False) for a in told]


def test_when_the_program_is_over_there_is_nobody_to_ask() -> None:
    robot = Robot("home")
    robot.live()
    assert robot.brain.handle_request(robot.t_ns, "go", "2") == Reply(
        False, "home", "the program is complete"
    )


@pytest.mark.usefixtures("lift")
def test_what_a_stage_makes_of_a_request_is_the_answer() -> None:
    robot = Wired("bow")
    robot.step()
    for number, (what, argument) in enumerate((("go", "2"), ("go", "up"), ("stop", ""), ("go", "1"))):
        ask(robot, number, what, argument)
    robot.step()
    assert answers(robot.node.best_effort_messages()) == [
        Answer(id=0, t_ns=TICK_NS, accepted=True, state="bow.floor2"),
        Answer(id=1, t_ns=TICK_NS, accepted=False, state="bow.floor2", reason="go up: say go and a floor"),
        Answer(id=2, t_ns=TICK_NS, accepted=False, state="bow.floor2", reason="stop : say go and a floor"),
        Answer(id=3, t_ns=TICK_NS, accepted=True, state="bow.floor1"),
    ]
    assert robot.node.counters == {"external_requests": 4}


def log_of(*requests: tuple[str, str], at: int = 2, ticks: int = 5) -> str:
    """Hash of a controller's log; the requests come between two ticks."""
    robot = Wired("bow")
    for tick in range(ticks):
        if tick == at:
            for number, (what, argument) in enumerate(requests):
                ask(robot, number, what, argument)
        robot.step()
        robot.node.best_effort_messages()
    return str(robot.result.facts["logs"]["controller"])


@pytest.mark.usefixtures("lift")
def test_the_log_has_what_was_accepted_and_nothing_else_of_requests() -> None:
    calm = log_of()
    assert log_of(("go", "up"), ("stop", "")) == calm
    logs = [
        log_of(("go", "2")),
        log_of(("go", "3")),
        log_of(("go", "2"), at=3),
        log_of(("go", "2"), ("go", "3")),
    ]
    assert len({calm, *logs}) == 5
    assert log_of(("stop", ""), ("go", "2")) == logs[0]


def test_watchers_see_every_stage_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between changes the wall clock decides, which stands still here."""
    monkeypatch.setattr("controller.telemetry.time.monotonic", lambda: 100.0)
    robot = Wired("bow", "structure", "home", formed_ns=5 * TICK_NS)
    told = []
    while robot.node.needs() is not None:
        robot.step()
        told += states(robot.node.best_effort_messages())
    assert told == ["forming", "bow", "structure", "home", "home"]  # the last says that it is over


def test_a_request_that_is_none_is_refused_by_the_wire() -> None:
    robot = Wired("bow")
    with pytest.raises(ProtocolError, match="not a Request"):
        robot.node.accept("request", ("go",), b"\xc1")
    with pytest.raises(ProtocolError, match="not a Request"):
        robot.node.accept("request", ("go",), encode(Answer(id=1, t_ns=0, accepted=True, state="")))
    robot.step()
    assert not robot.result.facts["requests"]


def test_the_nursing_program_takes_none() -> None:
    deployment = load(SHIPPED.parent / "riba_trajectory.toml")
    keys = Keys(deployment.robot)
    node = build(deployment, "controller", SHIPPED.parent, None)
    home = [deployment.body.home_rad.get(joint, 0.0) for joint in deployment.body.joints]
    node.accept("joints", (), encode(Joints(t_ns=0, watermark_ns=0, position_rad=home)))
    node.accept("request", ("grasp",), encode(Request(id=7)))
    node.step(lambda _key, _payload: None)
    (key, payload), *rest = node.best_effort_messages()
    answer = decode(payload, Answer)
    assert key == keys.of("answer")
    assert (answer.id, answer.accepted, answer.reason) == (
        7,
        False,
        "the nursing controller accepts no requests",
    )
    told = [decode(state, ControllerState).stage for key, state in rest if key == keys.of("state")]
    assert told == [answer.state]


def test_a_stage_takes_requests_if_it_has_a_way_to_ask() -> None:
    assert isinstance(Lift(None), RequestHandler)
    assert not isinstance(object(), RequestHandler)
