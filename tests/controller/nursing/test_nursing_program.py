"""The nursing loop as a state machine: its table, and every state against everything that can go wrong."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from nursing_robot import FOUR, JOINTS, POSE, Floats, kinematics, model, plane, sheets, touch

from controller.nursing.contacts.contact_frames import Region, Sheet, TactileInput
from controller.nursing.contacts.contact_tracking import ContactTracker
from controller.nursing.contacts.tactile_feedback import POSITION_IMPEDANCE, ROTATION_IMPEDANCE
from controller.nursing.kinematics.model_errors import build_kinematics
from controller.nursing.nursing_program import NursingCommand, NursingProgram
from controller.nursing.state_machine import (
    STOP_EVENTS,
    TERMINAL_STATES,
    TRANSITIONS,
    Event,
    State,
    diagram,
    next_state,
)
from skinnet.deployment.controller.nursing import ContactWeightSpec, ImpedanceSpec, NursingSpec, WaypointSpec

PERIOD_NS = 10_000_000
JOINTS_TIMEOUT_NS = 50_000_000
FOREARMS = FOUR[2:]
SIDEWAYS = (WaypointSpec(t_s=0.5, displacement_m=(0.03, 0.0, 0.0)),)


def spec(**settings: object) -> NursingSpec:
    given = {"joints": JOINTS, "waypoints": SIDEWAYS, "hold_s": 0.1, "record_s": 0.05, "settle_s": 0.2}
    return NursingSpec(**(given | settings))  # type: ignore[arg-type]


class Arms:
    """Joints that do what they are told, and skin that feels what the test says."""

    def __init__(
        self, settings: NursingSpec, q: Floats = POSE, known: dict[str, Sheet] | None = None
    ) -> None:
        self.spec = settings
        self.robot = kinematics(settings.joints)
        self.program = NursingProgram(
            settings,
            self.robot,
            sheets() if known is None else known,
            PERIOD_NS,
            joints_timeout_ns=JOINTS_TIMEOUT_NS,
        )
        self.t_ns, self.q = 0, q.copy()
        self.touches: tuple[Region, ...] = tuple(touch(name) for name in FOREARMS)
        self.silent = self.blind = False
        self._heard_ns = self._measured_ns = 0
        self._measured_q = q.copy()

    def tick(self) -> NursingCommand:
        if not self.silent:
            self._heard_ns = self.t_ns
        if not self.blind:
            self._measured_ns, self._measured_q = self.t_ns, self.q
        heard = TactileInput(self._heard_ns, self.touches)
        command = self.program.step(self.t_ns, self._measured_q, self._measured_ns, heard)
        self.q = self.q + command.velocity_rad_s * PERIOD_NS * 1e-9
        self.t_ns += PERIOD_NS
        return command

    def until(self, state: State, limit: int = 400) -> NursingCommand:
        for _ in range(limit):
            command = self.tick()
            if command.state is state or self.program.done:
                return command
        raise AssertionError(f"still {self.program.state} after {limit} periods")

    def ticks(self, count: int) -> list[NursingCommand]:
        return [self.tick() for _ in range(count)]

    def gap_m(self) -> float:
        """Distance between the two contacts."""
        at = self.robot.surface_poses(
            self.q, [sheets()[name].surface_point((0.0, 0.0)) for name in FOREARMS]
        ).position_m
        return float(np.linalg.norm(at[0] - at[1]))


def test_every_state_against_every_event() -> None:
    """The table, written down once more by hand: what is not here raises."""
    always = {Event.SKIN_SILENT, Event.JOINTS_SILENT, Event.PRESSURE_LIMIT}
    at_the_start = {Event.NO_CONTACT, Event.UNKNOWN_LINK, Event.INVALID_CONTACT, Event.SINGULAR_POSTURE}
    underway = {Event.CONTACT_LOST, Event.SINGULAR_POSTURE, Event.UNREACHABLE}
    stops = {
        State.HOLD: always,
        State.RECORD: always | at_the_start,
        State.MOVE: always | underway,
        State.SETTLE: always | underway,
    }
    onward = {
        (State.HOLD, Event.HOLD_ELAPSED): State.RECORD,
        (State.RECORD, Event.RECORDED): State.MOVE,
        (State.MOVE, Event.ARRIVED): State.SETTLE,
        (State.SETTLE, Event.SETTLED): State.REPORT,
    }
    for state, event in itertools.product(State, Event):
        due = State.STOPPED if event in stops.get(state, set()) else onward.get((state, event))
        if due is None:
            with pytest.raises(ValueError, match=f"is not allowed in state {state.name}"):
                next_state(state, event)
        else:
            assert next_state(state, event) is due
    assert {event for _, event in TRANSITIONS} == set(Event)
    assert set(STOP_EVENTS) == {event for (_, event), state in TRANSITIONS.items() if state is State.STOPPED}
    assert {state for state, _ in TRANSITIONS} == set(State) - set(TERMINAL_STATES)


def test_the_diagram_shows_every_transition() -> None:
    lines = diagram().splitlines()
    assert lines[0] == "stateDiagram-v2"
    for (state, event), target in TRANSITIONS.items():
        arrow = [line for line in lines if line.startswith(f"    {state.value} --> {target.value}:")]
        assert len(arrow) == 1
        assert event.value in arrow[0]


@pytest.mark.parametrize("solver", ["closed_form", "qp"])
@pytest.mark.parametrize("feedback", ["none", "position", "rotation", "position_rotation"])
def test_the_program_goes_through_and_reports(solver: str, feedback: str) -> None:
    arms = Arms(spec(solver=solver, feedback=feedback, object_centre_m=(0.0, -0.5, 0.9)))
    before = arms.robot.surface_poses(
        arms.q, [sheets()[name].surface_point((0, 0)) for name in FOREARMS]
    ).position_m
    resting = arms.ticks(14)
    assert {command.state for command in resting} == {State.HOLD, State.RECORD}
    assert all((command.velocity_rad_s == 0.0).all() for command in resting)
    assert arms.until(State.REPORT).stopped_by is None
    assert arms.program.progress == 1.0
    assert [state for state, _ in arms.program.state_history] == [*State][:5]
    times = dict(arms.program.state_history)
    assert times[State.SETTLE] - times[State.MOVE] == 500_000_000
    assert times[State.RECORD] - times[State.HOLD] == 100_000_000
    after_all = arms.robot.surface_poses(
        arms.q, [sheets()[name].surface_point((0, 0)) for name in FOREARMS]
    ).position_m
    assert (after_all - before)[:, 0].min() > 0.015
    course = arms.program.contact_series
    assert course is not None
    for contact, name in zip(course.summarise(), sorted(FOREARMS), strict=True):
        assert contact.name == name
        assert contact.force_start_n == contact.force_end_n == 30.0
        assert contact.cop_peak_m == 0.0
        assert 0.0 < contact.position_dev_end_m <= contact.position_dev_peak_m < 0.02
    rows = course.arrays()
    assert rows["object_m"][-1].tolist() == [0.03, 0.0, 0.0]
    assert (np.diff(rows["t_ns"]) == PERIOD_NS).all()
    assert rows["alpha_rad"].shape == (len(rows["t_ns"]), 2, 2)


def test_progress_rises_to_1_in_every_state_and_stays_there() -> None:
    arms = Arms(spec())
    shown: dict[State, list[float]] = {}
    while not arms.program.done:
        arms.tick()
        shown.setdefault(arms.program.state, []).append(arms.program.progress)
    due_s = {State.HOLD: 0.1, State.RECORD: 0.05, State.MOVE: 0.5, State.SETTLE: 0.2}
    for state, duration_s in due_s.items():
        assert shown[state] == pytest.approx(np.arange(len(shown[state])) * PERIOD_NS * 1e-9 / duration_s)
        assert len(shown[state]) == round(duration_s * 1e9) // PERIOD_NS
    assert shown[State.REPORT] == [1.0]

    waiting = Arms(spec(hold_s=0.02)).program
    for t_ns in range(0, 40_000_001, PERIOD_NS):
        assert waiting.step(t_ns, POSE, t_ns, None).state is State.HOLD  # no board has been heard
        assert waiting.progress == min(1.0, t_ns / 20_000_000)


def test_a_summary_has_extremes_and_ends_of_each_contact() -> None:
    """One contact is pressed harder and wanders by 13 mm, the other stays as it is."""
    arms = Arms(spec(feedback="none", settle_s=0.4))
    arms.until(State.MOVE)
    resting, moved = (touch(name) for name in sorted(FOREARMS))
    for force_n, xi_m in ((20.0, (0.0, 0.004)), (50.0, (0.012, -0.005))):
        arms.touches = (resting, moved._replace(force_n=force_n, xi_m=xi_m))
        arms.ticks(20)
    force_n = 35.0
    while not arms.program.done:
        force_n += 0.125
        arms.touches = (resting, moved._replace(force_n=force_n, xi_m=(0.0, 1e-4 * force_n)))
        arms.tick()
    assert arms.program.state is State.REPORT
    assert arms.program.contact_series is not None
    still, pressed = arms.program.contact_series.summarise()
    assert (pressed.force_start_n, pressed.force_min_n) == (30.0, 20.0)
    assert (pressed.force_max_n, pressed.force_end_n) == (50.0, force_n)
    assert (pressed.cop_peak_m, pressed.cop_end_m) == pytest.approx((0.013, 1e-4 * force_n))
    rows = arms.program.contact_series.arrays()
    for contact, position_m, rotation_rad in zip(
        (still, pressed), rows["position_dev_m"].T, rows["rotation_dev_rad"].T, strict=True
    ):
        assert (contact.position_dev_peak_m, contact.position_dev_end_m) == (position_m.max(), position_m[-1])
        assert contact.rotation_dev_peak_rad == rotation_rad.max()
        assert contact.rotation_dev_end_rad == rotation_rad[-1]
    assert (still.force_start_n, still.force_min_n, still.force_max_n, still.force_end_n) == (30.0,) * 4
    assert (still.cop_peak_m, still.cop_end_m) == (0.0, 0.0)


def test_initial_contacts_are_the_mean_over_the_record() -> None:
    arms = Arms(spec())
    arms.until(State.RECORD)
    for force_n in (28.0, 29.0, 30.0, 31.0, 32.0):
        arms.touches = tuple(touch(name, force_n) for name in FOREARMS)
        arms.tick()
    arms.until(State.MOVE)
    assert arms.program.manipulation is not None
    np.testing.assert_allclose(arms.program.manipulation.contacts.force_n, 30.0, atol=0.5)


WRONG: dict[Event, Callable[[Arms], None]] = {
    Event.SKIN_SILENT: lambda arms: setattr(arms, "silent", True),
    Event.JOINTS_SILENT: lambda arms: setattr(arms, "blind", True),
    Event.PRESSURE_LIMIT: lambda arms: setattr(
        arms, "touches", (*arms.touches, touch("left_forearm", 5.0, 61.0, 9))
    ),
    Event.CONTACT_LOST: lambda arms: setattr(arms, "touches", arms.touches[:1]),
    Event.NO_CONTACT: lambda arms: setattr(arms, "touches", ()),
    Event.UNKNOWN_LINK: lambda arms: setattr(arms, "touches", (*arms.touches, touch("left_knee"))),
    Event.INVALID_CONTACT: lambda arms: setattr(
        arms, "touches", (arms.touches[0], arms.touches[1]._replace(xi_m=(0.3, 0.0)))
    ),
}
"""What a test can do to the arms for it to happen."""


@pytest.mark.parametrize("state", list(State))
@pytest.mark.parametrize("event", list(WRONG))
def test_every_state_of_a_run_against_everything_the_skin_can_do(state: State, event: Event) -> None:
    """A state stops where the table says so; else the next one that can does, or none."""
    arms = Arms(spec(hold_s=0.3, record_s=0.2, object_centre_m=(0.0, -0.5, 0.9)))
    if state is State.STOPPED:
        arms.until(State.MOVE)
        arms.silent = True
    arms.until(state)
    assert arms.program.state is state
    reason = arms.program.reason
    WRONG[event](arms)
    if state in TERMINAL_STATES:
        arms.ticks(30)
        assert arms.program.state is state
        assert arms.program.reason == reason
        return
    arms.until(State.REPORT)
    recorded = state not in (State.HOLD, State.RECORD)
    due: Event | None = event
    if not recorded and event is Event.CONTACT_LOST:
        due = None  # one contact fewer is recorded
    elif recorded and event is Event.UNKNOWN_LINK:
        due = None  # nothing is recorded any more: a touch elsewhere is none of its business
    elif recorded and event in (Event.NO_CONTACT, Event.INVALID_CONTACT):
        due = Event.CONTACT_LOST  # all are gone; one jumped off its sheet
    assert arms.program.stopped_by is due
    if due is not None:
        assert arms.program.reason.startswith(due.value)
        assert len(arms.program.reason) > len(due.value) + 2


def test_what_stops_is_named() -> None:
    for event, word in (
        (Event.PRESSURE_LIMIT, "61 kPa on left_forearm, 60 allowed"),
        (Event.CONTACT_LOST, "left_forearm"),
        (Event.SKIN_SILENT, "last heard at 0.1"),
        (Event.JOINTS_SILENT, "last measured at 0.1"),
    ):
        arms = Arms(spec())
        arms.until(State.MOVE)
        WRONG[event](arms)
        if event is Event.CONTACT_LOST:
            arms.touches = (touch("right_forearm"),)
        arms.until(State.STOPPED)
        assert word in arms.program.reason


def test_a_link_that_the_model_lacks_is_unknown_even_if_its_sheet_is_known() -> None:
    arms = Arms(spec(), known=sheets() | {"left_shin": plane("left_shin", 0.3, 1.0)})
    arms.touches = (*arms.touches, touch("left_shin"))
    command = arms.until(State.MOVE)
    assert command.stopped_by is Event.UNKNOWN_LINK
    assert '"left_shin" presses with 30.0 N' in command.reason
    assert all((later.velocity_rad_s == 0.0).all() for later in arms.ticks(20))


def test_a_contact_without_a_way_to_the_centre_is_refused_before_anything_moves() -> None:
    arms = Arms(spec())
    arms.touches = (touch("left_forearm"),)
    command = arms.until(State.MOVE)
    assert command.stopped_by is Event.INVALID_CONTACT
    assert "inherent centre" in command.reason
    assert (arms.q == POSE).all()


def test_straight_arms_are_singular_at_the_start() -> None:
    arms = Arms(spec(joints=JOINTS[:10]), np.zeros(10))
    command = arms.until(State.MOVE)
    assert command.stopped_by is Event.SINGULAR_POSTURE
    assert (arms.q == 0.0).all()


def test_arms_that_become_straight_on_the_way_stop() -> None:
    far = (WaypointSpec(t_s=3.0, displacement_m=(0.0, -0.6, 0.0)),)
    loose = {name: ContactWeightSpec(rotation=1e-5) for name in FOREARMS}
    way = {"waypoints": far, "weights": loose, "joint_weight": 1e-6}
    arms = Arms(
        spec(
            joints=JOINTS[:10],
            position_tolerance_m=1.0,
            rotation_tolerance_rad=3.0,
            max_joint_speed_rad_s=5.0,
            **way,
        ),
        POSE[:10],
    )
    assert arms.until(State.REPORT).stopped_by is Event.SINGULAR_POSTURE
    assert [state for state, _ in arms.program.state_history][-2:] == [State.MOVE, State.STOPPED]
    elbows = np.abs(arms.q[[3, 8]])
    assert (elbows < 0.5 * POSE[3]).all()
    held = arms.q.copy()
    arms.ticks(50)
    np.testing.assert_allclose(arms.q, held, atol=1e-6)


def test_a_trajectory_out_of_reach_stops_and_is_not_run_after() -> None:
    arms = Arms(spec(waypoints=(WaypointSpec(t_s=2.0, displacement_m=(0.0, -1.5, 0.0)),), min_mobility=0.0))
    command = arms.until(State.REPORT)
    assert command.stopped_by is Event.UNREACHABLE
    assert "deviates by" in command.reason
    held = arms.q.copy()
    arms.ticks(100)
    np.testing.assert_allclose(arms.q, held, atol=1e-2 * 0.5)
    speeds = [np.abs(command.velocity_rad_s).max() for command in arms.ticks(5)]
    assert max(speeds) < 1e-6


def stopped_while_moving(event: Event = Event.PRESSURE_LIMIT, **settings: object) -> Arms:
    """Stopped in the middle of the way, and then felt as in the beginning."""
    arms = Arms(spec(**settings))
    arms.until(State.MOVE)
    arms.ticks(25)
    touches = arms.touches
    WRONG[event](arms)
    assert arms.until(State.STOPPED).stopped_by is event
    if event not in (Event.SKIN_SILENT, Event.JOINTS_SILENT):
        arms.touches = touches
    return arms


@pytest.mark.parametrize("event", [Event.PRESSURE_LIMIT, Event.SKIN_SILENT, Event.JOINTS_SILENT])
@pytest.mark.parametrize("solver", ["closed_form", "qp"])
def test_a_stop_stands_still_at_once(event: Event, solver: str) -> None:
    turned = (WaypointSpec(t_s=0.5, displacement_m=(0.03, 0.0, 0.0), rotation_rad=(0.1, 0.0, 0.3)),)
    arms = stopped_while_moving(event, solver=solver, waypoints=turned)
    assert arms.program.manipulation is not None
    arms.ticks(30)
    where, clearance_m = arms.q.copy(), arms.gap_m()
    arms.ticks(200)
    np.testing.assert_allclose(arms.q, where, atol=1e-6)
    assert 0.0 < arms.program.manipulation.displacement_m[0] < 0.03
    assert arms.gap_m() == pytest.approx(clearance_m, abs=1e-6)


def test_a_stop_goes_on_holding_the_force() -> None:
    """Feedback acts as before the stop: too strong opens the arms, too weak closes them, by (f - f0) / K."""
    arms = stopped_while_moving(joint_weight=1e-6)
    arms.ticks(300)
    rest_m = arms.gap_m()
    for force_n in (50.0, 20.0):
        arms.touches = tuple(touch(name, force_n) for name in FOREARMS)
        arms.ticks(600)
        due_m = 2.0 * (force_n - 30.0) / 2725.0
        assert arms.gap_m() - rest_m == pytest.approx(due_m, rel=0.05)
    assert arms.program.state is State.STOPPED


def test_nobody_pushes_blindly_after_a_stop() -> None:
    """With a silent skin all adjustments stay; with one contact lost, that one does, until felt again."""
    arms = stopped_while_moving(Event.SKIN_SILENT)
    assert arms.program.manipulation is not None
    feedback = arms.program.manipulation.feedback
    arms.touches = tuple(touch(name, 80.0) for name in FOREARMS)  # not heard
    before = feedback.s_m
    arms.ticks(50)
    assert (feedback.s_m == before).all()
    arms.silent = False
    arms.ticks(50)
    assert (feedback.s_m > before + 1e-3).all()

    arms = stopped_while_moving(Event.CONTACT_LOST)
    assert arms.program.manipulation is not None
    feedback = arms.program.manipulation.feedback
    arms.touches = (touch("left_forearm", 50.0),)  # the right one is lost
    arms.ticks(12)
    before = feedback.s_m
    arms.ticks(30)
    moved = feedback.s_m - before
    lost = arms.program.manipulation.contacts.names.index("right_forearm")
    assert moved[lost] == 0.0
    assert moved[1 - lost] > 1e-4


def test_a_moment_without_contact_is_no_loss_and_feedback_closes_the_gap() -> None:
    arms = Arms(spec(settle_s=1.0))
    arms.until(State.SETTLE)
    touches = arms.touches
    arms.touches = touches[:1]
    clearance_m = arms.gap_m()
    arms.ticks(9)
    assert arms.gap_m() < clearance_m
    arms.touches = touches
    assert arms.until(State.REPORT).stopped_by is None


@pytest.mark.parametrize("same_id", [True, False], ids=["same id", "another id"])
@pytest.mark.parametrize(
    ("way_m", "is_matched"), [((0.03, 0.03), True), ((0.05, 0.0), False), ((0.0, -0.05), False)]
)
def test_a_contact_is_followed_as_far_as_it_may_move(
    way_m: tuple[float, float], is_matched: bool, same_id: bool
) -> None:
    """By at most 43 mm in any direction, wherever it is on its sheet."""
    start_m = (0.2, -0.3)
    tracker = ContactTracker([Region("left", 1, start_m, 5.0, 9.0)], 0, 1.0, 0.043)
    end_m = (start_m[0] + way_m[0], start_m[1] + way_m[1])
    tracker.update(1, [Region("left", 1 if same_id else 2, end_m, 7.0, 9.0)])
    assert tracker.force_n.tolist() == [7.0 if is_matched else 0.0]
    assert tracker.xi_m[0] == pytest.approx(end_m if is_matched else start_m)


def test_a_contact_is_followed_under_a_new_number_but_never_by_two() -> None:
    one, two = touch("a", 30.0, number=1), touch("a", 20.0, number=2)._replace(xi_m=(0.03, 0.0))
    following = ContactTracker([one, two], 0, 1.0, 0.043)
    following.update(10, [two._replace(region_id=7, xi_m=(0.025, 0.0)), one])
    assert following.force_n.tolist() == [30.0, 20.0]
    assert following.xi_m[1].tolist() == [0.025, 0.0]
    following.update(
        20, [one._replace(region_id=7, force_n=50.0)]
    )  # merged: the number of the second survives
    assert following.force_n.tolist() == [50.0, 0.0] or following.force_n.tolist() == [0.0, 50.0]
    assert following.time_below_threshold_ns(30).max() == 20
    following.update(30, [touch("b"), touch("a", number=9)._replace(xi_m=(0.2, 0.0))])  # elsewhere
    assert following.force_n.tolist() == [0.0, 0.0]


def test_weights_of_zero_or_below_are_refused_at_construction() -> None:
    for weights in ({"position": 0.0}, {"rotation": -0.1}):
        with pytest.raises(ValueError, match="must be above zero"):
            ContactWeightSpec(**weights)
    with pytest.raises(ValueError, match="joint_weight = 0"):
        spec(joint_weight=0.0)
    with pytest.raises(ValueError, match="stiffness"):
        ImpedanceSpec(inertia=1.0, damping=1.0, stiffness=0.0)
    with pytest.raises(ValueError, match="must ascend strictly"):
        spec(waypoints=(SIDEWAYS[0], SIDEWAYS[0]))
    with pytest.raises(ValueError, match="unknown sheet or body"):
        Arms(spec(weights={"left_knee": ContactWeightSpec()}))
    with pytest.raises(ValueError, match="the program"):
        NursingProgram(
            spec(), kinematics(JOINTS[:4]), sheets(), PERIOD_NS, joints_timeout_ns=JOINTS_TIMEOUT_NS
        )


def test_weights_are_given_by_sheet_or_by_body() -> None:
    """A heavier weight on one arm lowers its deviation."""
    deviations = []
    for weights in ({}, {"left_forearm": ContactWeightSpec(position=30.0)}):
        arms = Arms(spec(weights=weights, feedback="none"))
        arms.until(State.REPORT)
        assert arms.program.contact_series is not None
        deviations.append({c.name: c.position_dev_end_m for c in arms.program.contact_series.summarise()})
    assert deviations[1]["left_forearm"] < 0.5 * deviations[0]["left_forearm"]


def test_the_program_is_a_function_of_its_inputs() -> None:
    runs = []
    for _ in range(2):
        arms = Arms(spec())
        runs.append([command.velocity_rad_s.tobytes() for command in arms.ticks(60)])
    assert runs[0] == runs[1]


def test_the_model_is_as_wrong_as_the_deployment_says() -> None:
    """Named errors stand as they are, the others are drawn from the seed; without any, the model is right."""
    elbow = JOINTS.index("left_elbow_bend")
    right = build_kinematics(spec(), model(), seed=3)
    points = [sheets()[name].surface_point((0.0, 0.0)) for name in FOUR]
    np.testing.assert_array_equal(
        right.surface_poses(POSE, points).position_m, kinematics().surface_poses(POSE, points).position_m
    )
    named = build_kinematics(spec(joint_offset_deg={"left_elbow_bend": 2.0}), model(), seed=3)
    turned = POSE + np.radians(2.0) * (np.arange(12) == elbow)
    np.testing.assert_allclose(
        named.surface_poses(POSE, points).position_m,
        right.surface_poses(turned, points).position_m,
        atol=1e-12,
    )
    moved = build_kinematics(spec(link_error_mm={"torso": (0.0, 0.0, 5.0)}), model(), seed=3)
    way_m = moved.surface_poses(POSE, points).position_m - right.surface_poses(POSE, points).position_m
    np.testing.assert_allclose(way_m, [[0.0, 0.0, 0.005]] * 4, atol=1e-12)
    sigma = {"joint_offset_sigma_deg": 0.5, "link_error_sigma_mm": 3.0}
    ways = [
        build_kinematics(spec(**sigma), model(), seed).surface_poses(POSE, points).position_m
        for seed in (3, 3, 4)
    ]
    assert (ways[0] == ways[1]).all()
    off_m = np.linalg.norm(np.array(ways) - right.surface_poses(POSE, points).position_m, axis=2)
    assert (off_m > 1e-4).all()
    assert (off_m < 0.05).all()
    assert (ways[0] != ways[2]).all()


def squeezed(feedback: str) -> list[float]:
    """Forces [N] on an object between pads of 11 N/mm, moved by arms that are not built as believed."""
    way = (WaypointSpec(t_s=3.0, displacement_m=(0.1, 0.0, 0.0)),)
    wrong = {"joint_offset_sigma_deg": 0.5, "link_error_sigma_mm": 3.0}
    arms = Arms(spec(waypoints=way, feedback=feedback, settle_s=1.0, **wrong))  # `arms.robot` is what is true
    believed = build_kinematics(arms.spec, model(), seed=2)
    arms.program = NursingProgram(
        arms.spec, believed, sheets(), PERIOD_NS, joints_timeout_ns=JOINTS_TIMEOUT_NS
    )
    start_m, forces_n = arms.gap_m(), [60.0]
    while not arms.program.done:
        arms.touches = tuple(touch(name, forces_n[-1]) for name in FOREARMS)
        arms.tick()
        forces_n.append(max(0.0, 60.0 + 5500.0 * (start_m - arms.gap_m())))  # two pads in series
    assert arms.program.state is State.REPORT
    return forces_n


def test_feedback_holds_the_force_that_a_wrong_model_lets_go() -> None:
    without, held = squeezed("none"), squeezed("position")
    assert min(without) < 52.0
    assert min(held) > 55.0
    assert max(held) < 62.0


def test_the_tables_of_the_paper_are_the_defaults() -> None:
    settings = spec()
    for given, due in (
        (settings.position_feedback, POSITION_IMPEDANCE),
        (settings.rotation_feedback, ROTATION_IMPEDANCE),
    ):
        assert (given.inertia, given.damping, given.stiffness) == due
    assert settings.joint_weight == 1e-4
    assert (ContactWeightSpec().position, ContactWeightSpec().rotation) == (1.0, 0.2)
    assert settings.max_pressure_kpa < 90.0
