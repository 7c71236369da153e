"""Teaching and grasping: one table of states, exhaustively; what moves the robot in each; what is refused."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from small_robot import small

from controller.grasping.area_teaching import AreaTeaching, replace_area
from controller.grasping.long_term_memory import LongTermMemory
from controller.grasping.state_machine import (
    CARRYING_STATES,
    GRASPING_STATES,
    RESTING_STATES,
    SENSED_EVENTS,
    TRANSITIONS,
    Event,
    State,
    mermaid_diagram,
    next_state,
)
from controller.grasping.state_parameters import Area, merge_state_parameters
from controller.grasping.teach_and_grasp import TeachAndGrasp
from controller.grasping.touch_events import group_by_limb
from controller.self_model import SelfModel
from controller.selforganisation.kinematic_structure import find_structure
from controller.selforganisation.map_exploration import MapExplorationConfig
from controller.touch.tactile_state import TactileState
from skinnet.protocol.messages import EventKind, Modality

Floats = NDArray[np.float64]
TICK_NS = 5_000_000
S, D = 8, 2
CHEST, LEFT, RIGHT, PAT = (0, 1), (2, 3), (4, 5), (6, 7)
"""Cells: the chest rests, DoF 0 moves the left arm, DoF 1 the right one; the pat area is on the left arm."""
ACTIVITY = np.zeros((S, D), dtype=np.bool_)
ACTIVITY[list(LEFT + PAT), 0] = True
ACTIVITY[list(RIGHT), 1] = True
WEIGHTS = ACTIVITY.astype(np.float64)
POSES = {
    "home": np.zeros(D),
    "open": np.full(D, 0.5),
    "closed": np.full(D, -0.5),
    "pulled": np.full(D, -0.7),
}
AREAS = {"pat": PAT, "contact": LEFT + RIGHT, "chest": CHEST}
GRASP = (State.OPEN, State.APPROACH, State.CONTACT, State.LOAD, State.PULL, State.HOLD)


class Skin(TactileState):
    """A picture whose levels a test can set."""

    def __init__(self) -> None:
        super().__init__(S)
        self.now_ns = 0

    def feel(self, cells: tuple[int, ...], modality: Modality, level: int, value: float) -> None:
        self.now_ns += 1
        n = len(cells)
        self.apply_events(
            np.array(cells),
            np.full(n, self.now_ns),
            np.full(n, int(modality)),
            np.zeros(n, dtype=np.int64),
            np.full(n, int(EventKind.LEVEL_CROSSING)),
            np.full(n, level),
            np.full(n, value),
        )

    def touch_all(self, cells: tuple[int, ...], force: int = 1, value: float = 0.05) -> None:
        self.feel(cells, Modality.FORCE, force, value)

    def near(self, cells: tuple[int, ...], level: int = 2, value: float = 0.03) -> None:
        self.feel(cells, Modality.PROXIMITY, level, value)


class Robot:
    """A session whose joints move exactly as it says."""

    def __init__(self, *, taught: bool = True, **session: Any) -> None:
        control = small(controller={"teach_and_grasp": session}).controller
        self.knowledge = SelfModel(min_row_norm=0.05, min_lever_m=0.005)
        if taught:
            self.knowledge.structure = find_structure(ACTIVITY)
            self.knowledge.sensory_motor_map.add(POSES["home"], WEIGHTS)
            self.knowledge.poses |= POSES
            self.knowledge.areas |= {name: np.array(cells) for name, cells in AREAS.items()}
        self.skin = Skin()
        self.t_ns = 0
        self.position_rad = np.zeros(D)
        self.blocked = False
        config = MapExplorationConfig(frequency_hz=10.0, periods=1, settle_ns=0)
        self.session = TeachAndGrasp(
            control, self.knowledge, LongTermMemory(None, self.knowledge), config, self.skin, D, S, 0
        )

    def tick(self, n: int = 1) -> Floats:
        velocity = np.zeros(D)
        for _ in range(n):
            velocity = self.session.step(self.t_ns, self.position_rad, self.skin)
            if not self.blocked:
                self.position_rad = self.position_rad + velocity * TICK_NS * 1e-9
            self.t_ns += TICK_NS
            self.skin.now_ns = self.t_ns
        return velocity

    def ask(self, what: str, argument: str = "") -> bool:
        return self.session.handle_request(self.t_ns, what, argument).accepted

    def until(self, *states: State, ticks: int = 4000) -> "Robot":
        for _ in range(ticks):
            if self.session.state in states:
                return self
            self.tick()
        raise AssertionError(f"still {self.session.state.value} after {ticks} ticks")

    def grasp(self, state: State) -> "Robot":
        """Brings it into a state of the grasp, with an object that fits."""
        self.ask("grasp")
        for step in (
            lambda: self.until(State.APPROACH),
            lambda: (self.skin.near(LEFT + RIGHT), self.until(State.CONTACT)),
            lambda: (self.skin.near(LEFT + RIGHT, 4, 0.9), self.until(State.LOAD)),
            lambda: (self.skin.touch_all(LEFT + RIGHT, 2, 0.11), self.until(State.PULL)),
            lambda: (self.skin.near(CHEST, 4, 0.9), self.until(State.HOLD)),
        ):
            if self.session.state is state:
                break
            step()
        assert self.session.state is state
        return self


def brought(state: State) -> Robot:
    """A robot in any state."""
    robot = Robot()
    robot.tick()
    match state:
        case State.GUIDE_FORCE | State.GUIDE_PROXIMITY:
            robot.ask("guide", state.value.removeprefix("guide_"))
        case State.ATTEND:
            robot.ask("attend", "pat")
        case State.REMEMBER:
            robot.ask("remember", "here")
        case State.GO:
            robot.ask("go", "open")
        case State.SET_DOWN:
            robot.grasp(State.HOLD).ask("cancel")
        case State.RELEASE:
            robot.grasp(State.HOLD).ask("release")
        case State.SAFE:
            robot.ask("cancel")
        case State.ENDED:
            robot.ask("end")
        case _ if state in GRASP:
            robot.grasp(state)
    assert robot.session.state is state
    return robot


REQUESTS = {
    Event.GUIDE_FORCE: ("guide", "force"),
    Event.GUIDE_PROXIMITY: ("guide", "proximity"),
    Event.GUIDE_OFF: ("guide", "off"),
    Event.ATTEND: ("attend", "chest"),
    Event.ATTEND_OFF: ("attend", "off"),
    Event.REMEMBER: ("remember", "there"),
    Event.GO: ("go", "home"),
    Event.GRASP: ("grasp", ""),
    Event.RELEASE: ("release", ""),
    Event.CANCEL: ("cancel", ""),
    Event.END: ("end", ""),
}


def test_every_event_is_sensed_or_a_request() -> None:
    assert set(SENSED_EVENTS).isdisjoint(REQUESTS)
    assert set(SENSED_EVENTS) | set(REQUESTS) == set(Event)
    assert set(TRANSITIONS) == set(State)


@pytest.mark.parametrize("event", REQUESTS, ids=lambda event: event.name)
@pytest.mark.parametrize("state", State, ids=lambda state: state.name)
def test_every_request_in_every_state(state: State, event: Event) -> None:
    """Either the table knows it, or it is refused, the reason says what is possible, and nothing changes."""
    robot = brought(state)
    if event is Event.ATTEND_OFF and state is State.ATTEND:
        robot.skin.touch_all(PAT)
        robot.tick()
    before = len(robot.session.log), robot.session.gains.tolist(), dict(robot.knowledge.areas)
    target = next_state(state, event)
    reply = robot.session.handle_request(robot.t_ns, *REQUESTS[event])
    assert reply.accepted == (target is not None)
    assert reply.state == robot.session.state.value == (target or state).value
    if target is None:
        assert f"not possible in state {state.value}" in reply.reason
        assert (len(robot.session.log), robot.session.gains.tolist(), dict(robot.knowledge.areas)) == before
        assert robot.session.refused[-1][1:3] == REQUESTS[event]


@pytest.mark.parametrize("state", [s for s in State if s is not State.ENDED], ids=lambda state: state.name)
def test_cancel_leads_to_the_safe_state_from_everywhere(state: State) -> None:
    """At once, or when what it carries can have been taken; then the arms open slowly and evade."""
    robot = brought(state)
    assert robot.ask("cancel")
    if state in CARRYING_STATES:
        assert robot.session.state is State.SET_DOWN
        began_ns = robot.t_ns
        before = robot.position_rad.copy()
        robot.until(State.SAFE)
        assert robot.t_ns - began_ns >= 3_900_000_000
        assert np.abs(robot.position_rad - before).max() < 0.02  # what it holds it goes on to hold
    assert robot.session.state is State.SAFE
    robot.skin.set_present(np.arange(S), False)  # nothing felt
    fastest = max(np.abs(robot.tick()).max() for _ in range(4000))
    assert fastest <= 0.1 + 1e-12
    np.testing.assert_allclose(robot.position_rad, POSES["open"], atol=0.011)


@pytest.mark.parametrize("state", GRASPING_STATES, ids=lambda state: state.name)
@pytest.mark.parametrize("event", [Event.PAIN, Event.SKIN_LOST], ids=lambda event: event.name)
def test_pain_and_lost_skin_end_every_grasp(state: State, event: Event) -> None:
    robot = brought(state)
    if event is Event.PAIN:
        robot.skin.touch_all((7,), 4, 0.5)
    else:
        robot.skin.set_present(np.array(RIGHT), False)
    robot.tick()
    assert robot.session.state is (State.SET_DOWN if state in CARRYING_STATES else State.SAFE)
    assert robot.session.log[-1].event == event.value


@pytest.mark.parametrize(
    "state", [State.APPROACH, State.CONTACT, State.LOAD, State.PULL], ids=lambda state: state.name
)
def test_a_pose_without_its_contact_fails(state: State) -> None:
    """No object, or one that is too small: each state wants more than its pose."""
    robot = brought(state)
    robot.skin.near(tuple(range(S)), 0, 0.0)
    if state is not State.PULL:  # there it would be lost before
        robot.skin.touch_all(tuple(range(S)), 0, 0.0)
    else:
        robot.skin.near(LEFT + RIGHT, 4, 0.9)
    robot.until(State.SAFE, ticks=6000)
    assert robot.session.log[-1].event == Event.POSE_REACHED.value


def test_a_blocked_robot_gives_up() -> None:
    robot = brought(State.PULL)
    robot.blocked = True
    began_ns = robot.t_ns
    robot.until(State.SAFE)
    assert robot.session.log[-1].event == Event.STALLED.value
    assert robot.t_ns - began_ns == pytest.approx(1.5e9, rel=0.02)


def test_an_arm_that_loses_the_object_is_noticed() -> None:
    robot = brought(State.PULL)
    robot.skin.near(LEFT, 0, 0.0)
    robot.skin.touch_all(LEFT, 0, 0.0)
    robot.until(State.SAFE)
    assert robot.session.log[-1].event == Event.OBJECT_LOST.value


def test_a_pat_starts_only_what_can_be_done() -> None:
    robot = Robot()
    robot.skin.touch_all(PAT)
    robot.tick()
    assert robot.session.state is State.OPEN
    ignorant = Robot()
    del ignorant.knowledge.poses["pulled"]
    ignorant.skin.touch_all(PAT)
    ignorant.tick()
    assert ignorant.session.state is State.IDLE
    assert not ignorant.ask("grasp")
    assert "pulled" in ignorant.session.refused[-1][-1]


def test_what_touches_already_is_no_pat() -> None:
    robot = Robot()
    robot.skin.touch_all(PAT)
    robot.ask("attend", "chest")
    robot.skin.touch_all(CHEST)
    robot.tick()
    robot.ask("attend", "off")
    robot.tick(5)
    assert robot.session.state is State.IDLE
    robot.skin.touch_all(PAT, 0, 0.0)
    robot.tick()
    robot.skin.touch_all(PAT)
    robot.tick()
    assert robot.session.state is State.OPEN


def test_an_area_is_what_was_touched_anew() -> None:
    robot = Robot()
    robot.skin.touch_all((0,))
    robot.tick()
    robot.ask("attend", "chest")
    robot.tick(3)
    assert not robot.ask("attend", "off")  # an area without cells
    assert robot.session.state is State.ATTEND
    robot.skin.near((2,), 3, 0.2)  # near is not close enough
    robot.skin.near((1,), 4, 0.9)
    robot.tick()
    robot.skin.near((1,), 0, 0.0)
    robot.skin.touch_all((3,))
    robot.tick()
    assert robot.ask("attend", "off")
    assert robot.knowledge.areas["chest"].tolist() == [1, 3]
    assert robot.knowledge.areas["contact"].tolist() == [2, 4, 5]  # a cell is in one area, the newest


def test_guidance_needs_a_map_and_moves_by_it() -> None:
    assert not Robot(taught=False).ask("guide", "force")
    robot = Robot()
    assert robot.ask("guide", "force")
    robot.skin.touch_all((LEFT[0],), 2, 0.14)
    np.testing.assert_allclose(robot.tick(), [(0.14 - 0.05) * 1.0, 0.0])  # the figure of the paper
    assert robot.ask("guide", "proximity")
    robot.skin.touch_all((LEFT[0],), 0, 0.0)
    robot.skin.near((RIGHT[0],), 2, 0.06)
    np.testing.assert_allclose(robot.tick(), [0.0, (0.06 - 0.01) * 0.4])


def test_a_pose_is_remembered_with_its_map() -> None:
    robot = Robot(taught=False)
    robot.position_rad = np.array([0.2, -0.1])
    assert robot.ask("remember", "here")
    robot.until(State.IDLE)
    np.testing.assert_allclose(robot.knowledge.poses["here"], [0.2, -0.1])
    assert len(robot.knowledge.sensory_motor_map) == 1
    robot.position_rad = np.array([0.3, -0.1])
    robot.ask("remember", "here")
    robot.until(State.IDLE)
    assert len(robot.knowledge.sensory_motor_map) == 1  # the newer in the place of the older
    np.testing.assert_allclose(robot.knowledge.sensory_motor_map.poses_rad[0], [0.3, -0.1])


def test_a_cancelled_exploration_leaves_no_pose() -> None:
    robot = brought(State.REMEMBER)
    robot.tick(3)
    robot.ask("cancel")
    assert "here" not in robot.knowledge.poses
    assert len(robot.knowledge.sensory_motor_map) == 1


@pytest.mark.parametrize(
    ("what", "argument", "why"),
    [
        ("dance", "", "unknown request"),
        ("guide", "gently", "one of force, proximity, off"),
        ("attend", "nose", "one of pat, contact, chest, off"),
        ("attend", "other", "one of pat, contact, chest, off"),
        ("go", "nowhere", "unknown pose"),
        ("remember", "", "name a pose"),
        ("remember", "../x", "name a pose"),
        ("grasp", "gently", "no argument"),
    ],
)
def test_requests_that_make_no_sense_change_nothing(what: str, argument: str, why: str) -> None:
    robot = Robot()
    reply = robot.session.handle_request(0, what, argument)
    assert not reply.accepted
    assert why in reply.reason
    assert robot.session.state is State.IDLE
    assert not robot.session.log


def test_a_grasp_needs_two_arms_and_a_chest() -> None:
    for areas, why in (({"contact": LEFT}, "two arms"), ({"contact": LEFT + RIGHT}, "chest")):
        robot = Robot()
        robot.knowledge.areas = {name: np.array(cells) for name, cells in areas.items()}
        robot.session = TeachAndGrasp(
            small().controller,
            robot.knowledge,
            LongTermMemory(None, robot.knowledge),
            MapExplorationConfig(),
            robot.skin,
            D,
            S,
            0,
        )
        assert not robot.ask("grasp")
        assert why in robot.session.refused[-1][-1]


def test_limbs_are_what_no_joint_moves_together() -> None:
    arms = group_by_limb(np.array(RIGHT + LEFT + CHEST), ACTIVITY)
    assert [arm.tolist() for arm in arms] == [list(LEFT), list(RIGHT)]
    chain = np.array([[1, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 0]], dtype=np.bool_)
    assert [limb.tolist() for limb in group_by_limb(np.arange(4), chain)] == [
        [0, 1, 2, 3]
    ]  # joined by the last


def test_without_pre_contact_only_force_counts() -> None:
    robot = Robot(pre_contact=False)
    robot.ask("grasp")
    robot.until(State.APPROACH)
    robot.skin.near(LEFT + RIGHT, 4, 0.95)
    velocity = robot.tick()
    assert robot.session.state is State.APPROACH
    assert np.abs(velocity).max() == pytest.approx(0.4)  # nothing holds it back
    robot.skin.touch_all(LEFT + RIGHT)
    robot.tick()
    assert robot.session.state is State.CONTACT


def test_table_two_and_what_a_deployment_changes() -> None:
    control = small().controller
    table = merge_state_parameters(control.teach_and_grasp)
    pull = table[State.PULL]
    assert (pull.pose, pull.speed_rad_s, pull.tolerance_rad) == ("pulled", 0.05, 0.01)
    assert (pull.reactions[Area.CONTACT].force_threshold, pull.reactions[Area.CONTACT].force_gain) == (
        0.10,
        0.80,
    )
    assert (pull.reactions[Area.OTHER].proximity_threshold, pull.reactions[Area.OTHER].proximity_gain) == (
        0.01,
        0.01,
    )
    assert table[State.APPROACH].reactions[Area.CONTACT].proximity_gain == 0.4
    assert table[State.CONTACT].reactions[Area.CONTACT].proximity_gain == 0.0
    assert not any(any(gains) for gains in table[State.IDLE].reactions.values())
    changed = {"load": {"speed_rad_s": 0.02, "areas": {"contact": {"force_gain": 0.5}}}}
    own = merge_state_parameters(
        small(controller={"teach_and_grasp": {"states": changed}}).controller.teach_and_grasp
    )
    assert own[State.LOAD].speed_rad_s == 0.02
    assert own[State.LOAD].reactions[Area.CONTACT].force_gain == 0.5
    assert own[State.LOAD].reactions[Area.OTHER] == table[State.LOAD].reactions[Area.OTHER]
    assert own[State.PULL] == pull


def test_the_operator_waits_for_its_state_and_for_quiet() -> None:
    robot = Robot(
        operator_requests=(
            {"state": "idle", "request": "guide", "argument": "force", "delay_s": 0.1},
            {
                "state": "guide_force",
                "request": "guide",
                "argument": "off",
                "contact_free_s": 0.2,
                "delay_s": 0.1,
            },
            {"state": "idle", "request": "end"},
        )
    )
    robot.until(State.GUIDE_FORCE)
    assert robot.t_ns == pytest.approx(0.1e9, abs=2 * TICK_NS)
    robot.skin.touch_all((LEFT[0],), 2, 0.14)
    for _ in range(100):
        robot.skin.touch_all((LEFT[0],), 2, 0.14)
        robot.tick()
    assert robot.session.state is State.GUIDE_FORCE
    robot.skin.touch_all((LEFT[0],), 0, 0.0)
    robot.tick(35)
    assert robot.session.state is State.GUIDE_FORCE
    robot.until(State.ENDED, ticks=200)


def test_an_operator_who_waits_in_vain_ends_the_session() -> None:
    robot = Robot(
        operator_requests=({"state": "idle", "request": "grasp"}, {"state": "hold", "request": "release"}),
        operator_timeout_s=2.0,
    )
    robot.until(State.SAFE)  # there is no object
    robot.until(State.ENDED, ticks=2000)


def test_without_an_operator_a_session_lasts() -> None:
    robot = Robot(operator_timeout_s=0.1)
    robot.tick(200)
    assert robot.session.state is State.IDLE


def _words() -> Iterator[tuple[str, str]]:
    yield from REQUESTS.values()
    yield from (("go", "nowhere"), ("dance", ""))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([*_words(), None]),
            st.sampled_from([PAT, LEFT, RIGHT, LEFT + RIGHT, CHEST]),
            st.integers(0, 4),
            st.integers(0, 4),
            st.integers(1, 150),
        ),
        max_size=25,
    )
)
def test_whatever_happens_the_table_is_kept_and_the_robot_is_slow(steps: list[Any]) -> None:
    robot = Robot()
    values = (0.0, 0.05, 0.12, 0.31, 0.5)
    for words, cells, force, near, ticks in steps:
        if words is not None:
            robot.ask(*words)
        robot.skin.touch_all(cells, force, values[force])
        robot.skin.near(cells, near, (0.0, 0.012, 0.03, 0.2, 0.9)[near])
        for _ in range(ticks):
            state = robot.session.state
            velocity = robot.tick()
            assert np.isfinite(velocity).all()
            assert state is not State.ENDED or not velocity.any()
    for entry in robot.session.log:
        event = next(event for event in Event if event.value == entry.event)
        assert next_state(State(entry.state), event) is State(entry.next_state)
    for one, other in zip(robot.session.log, robot.session.log[1:], strict=False):
        assert one.next_state == other.state


def test_the_diagram_shows_the_whole_table() -> None:
    text = mermaid_diagram()
    for state, row in TRANSITIONS.items():
        for target in row.values():
            end = "[*]" if target is State.ENDED else target.value
            assert f"{state.value} --> {end}:" in text


def test_attention_and_areas() -> None:
    skin = Skin()
    attention = AreaTeaching("pat", skin, 4)
    assert not len(attention.cells)
    areas = replace_area({"pat": np.array([1, 2]), "chest": np.array([3])}, "contact", np.array([3, 4]))
    assert {name: cells.tolist() for name, cells in areas.items()} == {"pat": [1, 2], "contact": [3, 4]}


def test_resting_states_take_the_same_requests() -> None:
    first, second = (TRANSITIONS[state] for state in RESTING_STATES)
    assert first == second
