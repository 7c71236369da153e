"""Touch: the tactile picture, reactions (4), postures (5) and the clamp that has the last word."""

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.touch.posture import PoseReached, PoseTarget, PostureControl
from controller.touch.safety_clamp import SafetyClamp, SafetyLimits
from controller.touch.tactile_reaction import TactileReaction
from controller.touch.tactile_state import COLUMNS, TactileState
from skinnet.deployment.controller.controller import SafetySpec
from skinnet.deployment.controller.stages import StageSpec
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import FOREVER_NS, READING_NAMES, EventKind, Modality

Floats = NDArray[np.float64]
MS = 1_000_000
PERIOD_NS = 5 * MS
FORCE, PROXIMITY = Modality.FORCE, Modality.PROXIMITY
LEVEL, DELTA = EventKind.LEVEL_CROSSING, EventKind.SEND_ON_DELTA

Event = tuple[int, int, int, int, int, int, float]
"""Cell, time [ns], modality, channel, kind, level, value."""


def tell(picture: TactileState, *events: Event) -> None:
    cell, t_ns, modality, channel, kind, level = (
        np.array(column, dtype=np.int64) for column in zip(*(event[:6] for event in events), strict=True)
    )
    value = np.array([event[6] for event in events])
    picture.apply_events(cell, t_ns, modality, channel, kind, level, value)


# --- fusion ---------------------------------------------------------------------------------------


@settings(deadline=None)
@given(
    events=st.lists(
        st.tuples(
            st.integers(0, 2),
            st.integers(0, 4),
            st.sampled_from([(m, c) for m in Modality for c in range(COLUMNS[m].stop - COLUMNS[m].start)]),
            st.sampled_from([LEVEL, DELTA]),
            st.integers(0, 4),
            st.floats(-1, 1),
        ),
        min_size=1,
        max_size=30,
    ),
    cut=st.integers(0, 30),
)
def test_the_newest_sample_wins_in_any_order_and_any_batches(
    events: list[tuple[int, int, tuple[int, int], int, int, float]], cut: int
) -> None:
    flat = [(cell, t, m, c, kind, level, value) for cell, t, (m, c), kind, level, value in events]
    picture = TactileState(3)
    for batch in (flat[:cut], flat[cut:]):
        if batch:
            tell(picture, *batch)

    for cell in range(3):
        for modality in Modality:
            levels = []
            for channel in range(COLUMNS[modality].stop - COLUMNS[modality].start):
                mine = [e for e in flat if (e[0], e[2], e[3]) == (cell, modality, channel)]
                # sorted is stable: of equal times the last delivered is the last
                values = sorted(mine, key=lambda e: e[1])
                with_level = [e for e in values if e[4] == LEVEL]
                assert picture.readings(modality)[cell, channel] == (values[-1][6] if values else 0.0)
                levels.append(with_level[-1][5] if with_level else 0)
            assert picture.level(modality)[cell] == max(levels)
    assert picture.rejected == 0


def test_an_older_row_of_the_stream_overwrites_nothing_newer() -> None:
    rows = {t: np.arange(8.0) + 10 * t for t in (1, 2, 3)}
    for order in permutations(rows):
        picture = TactileState(2)
        picture.apply_stream(np.array([1, 1]), np.array(order[:2]), np.array([rows[t] for t in order[:2]]))
        picture.apply_stream(np.array([1]), np.array(order[2:]), np.array([rows[order[2]]], dtype=np.float32))
        assert [*picture.readings(Modality.ACCELERATION)[1]] == [34.0, 35.0, 36.0]
        assert picture.readings(Modality.TEMPERATURE)[1, 0] == 37.0
        assert not picture.reaction_readings(3)[0].any()
    tell(picture, (1, 2, FORCE, 2, LEVEL, 3, 0.9), (1, 4, FORCE, 0, DELTA, 0, 0.4))
    assert [*picture.readings(FORCE)[1]] == [0.4, 31.0, 32.0]  # newer than the event of time 2
    assert picture.level(FORCE)[1] == 3  # the first level that was told


def test_columns_are_those_of_the_wire() -> None:
    names = {FORCE: "force", PROXIMITY: "prox", Modality.ACCELERATION: "a", Modality.TEMPERATURE: "temp"}
    for modality, beginning in names.items():
        assert all(name.startswith(beginning) for name in READING_NAMES[COLUMNS[modality]])
    assert sum(columns.stop - columns.start for columns in COLUMNS.values()) == len(READING_NAMES)


def test_age_says_when_anything_was_last_heard() -> None:
    picture = TactileState(2)
    tell(picture, (0, 30, FORCE, 0, DELTA, 0, 0.1), (0, 20, FORCE, 2, DELTA, 0, 0.2))
    assert picture.age_ns(100, FORCE).tolist() == [70, 100 + FOREVER_NS]
    assert (picture.age_ns(100, PROXIMITY) >= FOREVER_NS).all()
    assert picture.reaction_readings(100, max_age_ns=75)[0].tolist() == [0.1, 0.0, 0.0, 0.0]
    assert picture.reaction_readings(100)[0].tolist() == [0.1, 0.0, 0.2, 0.0]


@pytest.mark.parametrize(
    "bad",
    [
        (-1, 0, FORCE, 0, LEVEL, 1, 0.5),
        (2, 0, FORCE, 0, LEVEL, 1, 0.5),
        (2**40, 0, FORCE, 0, LEVEL, 1, 0.5),
        (0, 0, 4, 0, LEVEL, 1, 0.5),
        (0, 0, -1, 0, LEVEL, 1, 0.5),
        (0, 0, FORCE, 3, LEVEL, 1, 0.5),
        (0, 0, PROXIMITY, 1, DELTA, 1, 0.5),
        (0, 0, Modality.ACCELERATION, 3, DELTA, 1, 0.5),
        (0, 0, Modality.TEMPERATURE, 1, DELTA, 1, 0.5),
        (0, 0, FORCE, -1, LEVEL, 1, 0.5),
        (0, 0, FORCE, 0, 2, 1, 0.5),
        (0, 0, FORCE, 0, LEVEL, -1, 0.5),
        (0, 0, FORCE, 0, LEVEL, 1, math.nan),
        (0, 0, FORCE, 0, DELTA, 1, math.inf),
    ],
)
def test_nonsense_is_refused_and_counted(bad: Event) -> None:
    picture = TactileState(2)
    tell(picture, bad, (1, 0, FORCE, 0, LEVEL, 1, 0.5))
    assert picture.rejected == 1
    expected = np.zeros((2, 4))
    expected[1, 0] = 0.5
    np.testing.assert_array_equal(picture.reaction_readings(0), expected)
    assert picture.level(FORCE).tolist() == [0, 1]


def test_rows_of_nonsense_and_unequal_columns_are_refused() -> None:
    picture = TactileState(2)
    rows = np.ones((3, 8))
    rows[1, 6] = math.nan
    picture.apply_stream(np.array([2, 0, 1]), np.zeros(3, dtype=np.int64), rows)
    assert picture.rejected == 2
    assert picture.reaction_readings(0).sum(axis=1).tolist() == [0.0, 4.0]
    with pytest.raises(ProtocolError, match="differ in length"):
        picture.apply_stream(np.array([1]), np.zeros(2, dtype=np.int64), rows)
    with pytest.raises(ProtocolError, match="expected"):
        picture.apply_stream(np.array([1]), np.array([0]), np.ones((1, 7)))


def test_a_lost_patch_feels_nothing_until_it_is_found_again() -> None:
    picture = TactileState(3)
    touch: Event = (1, 10, FORCE, 0, LEVEL, 2, 0.3)
    tell(picture, touch, (2, 10, FORCE, 0, LEVEL, 2, 0.3))
    gains = np.ones((3, 4))
    assert np.flatnonzero(picture.cells_to_stream(10, gains)).tolist() == [1, 2]

    picture.set_present(np.array([1]), False)
    tell(picture, (1, 11, FORCE, 0, LEVEL, 3, 0.4))
    picture.apply_stream(np.array([1]), np.array([12]), np.ones((1, 8)))
    assert picture.present.tolist() == [True, False, True]
    assert picture.level(FORCE).tolist() == [0, 0, 2]
    assert not picture.reaction_readings(20)[1].any()
    assert np.flatnonzero(picture.cells_to_stream(20, gains)).tolist() == [2]

    picture.set_present(np.array([1]), True)
    assert not picture.reaction_readings(20)[1].any()
    tell(picture, touch)  # was known before the loss already
    tell(picture, (1, 13, FORCE, 0, LEVEL, 3, 0.4))
    assert picture.reaction_readings(20)[1, 0] == 0.4
    assert np.flatnonzero(picture.cells_to_stream(20, gains)).tolist() == [1, 2]


def test_streams_follow_contact_with_a_hold_time() -> None:
    picture = TactileState(2, hold_ns=100)
    force_only = np.array([[1.0, 1, 1, 0]] * 2)

    def wanted(t_ns: int, gains: Floats) -> list[int]:
        return np.flatnonzero(picture.cells_to_stream(t_ns, gains)).tolist()

    tell(picture, (0, 0, PROXIMITY, 0, LEVEL, 1, 0.2))
    assert wanted(0, force_only) == []  # a modality without gain needs no stream
    tell(picture, (0, 10, FORCE, 1, LEVEL, 1, 0.05))
    assert wanted(10, force_only) == [0]
    assert wanted(20, force_only) == [0]
    tell(picture, (0, 30, FORCE, 1, LEVEL, 0, 0.01))
    assert wanted(120, force_only) == [0]  # held since 20, when contact was last seen
    tell(picture, (0, 120, FORCE, 0, LEVEL, 1, 0.05))
    assert wanted(121, force_only) == [0]  # contact again: the hold time begins anew
    tell(picture, (0, 122, FORCE, 0, LEVEL, 0, 0.01))
    assert wanted(221, force_only) == [0]
    assert wanted(222, force_only) == []
    assert wanted(224, np.ones((2, 4))) == [0]  # proximity counts once it has a gain


# --- reactions, equation (4) ----------------------------------------------------------------------

S, D = 5, 3
MAP: Floats = np.array([[1.0, 0, 0], [0.6, -0.8, 0], [0, 0, 1], [0, 0, 0], [-1, 0, 0]])
readings = st.lists(st.floats(0, 1), min_size=S * 4, max_size=S * 4).map(lambda x: np.array(x).reshape(S, 4))


def guided(threshold: float = 0.05, gain: float = 1.0) -> TactileReaction:
    reaction = TactileReaction(S)
    reaction.tune(FORCE, threshold=threshold, gain=gain)
    return reaction


def touched(cell: int, channel: int, reading: float) -> Floats:
    touch = np.zeros((S, 4))
    touch[cell, channel] = reading
    return touch


@pytest.mark.parametrize("cell", [0, 1, 2, 4])
def test_the_reading_of_the_paper_gives_the_speed_of_the_paper(cell: int) -> None:
    velocity = guided().velocity(touched(cell, 1, 0.14), MAP)
    assert np.linalg.norm(velocity) == pytest.approx(0.09)
    np.testing.assert_allclose(velocity, 0.09 * MAP[cell])


@settings(deadline=None)
@given(
    touch=readings,
    thresholds=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    gains=st.tuples(*[st.floats(-2, 2)] * 2),
)
def test_reactions_are_the_sums_of_equation_4(
    touch: Floats, thresholds: tuple[float, float], gains: tuple[float, float]
) -> None:
    reaction = TactileReaction(S)
    for modality, threshold, gain in zip((FORCE, PROXIMITY), thresholds, gains, strict=True):
        reaction.tune(modality, threshold=threshold, gain=gain)
    expected = [0.0] * D
    for s in range(S):
        for m in range(4):
            rho, t, gain = touch[s, m], thresholds[m // 3], gains[m // 3]
            for d in range(D):
                expected[d] += MAP[s, d] * (rho > t) * (rho - t) * gain
    np.testing.assert_allclose(reaction.velocity(touch, MAP), np.array(expected), atol=1e-12)


@settings(deadline=None)
@given(touch=readings, t=st.floats(0, 0.5), scale=st.floats(1, 5))
def test_reactions_superimpose_and_are_linear_above_the_threshold(
    touch: Floats, t: float, scale: float
) -> None:
    reaction = guided(t)
    each = [reaction.velocity(np.where(np.arange(S)[:, None] == s, touch, 0.0), MAP) for s in range(S)]
    np.testing.assert_allclose(reaction.velocity(touch, MAP), np.sum(each, axis=0), atol=1e-12)
    stronger = t + scale * (touch - t)
    np.testing.assert_allclose(
        reaction.velocity(stronger, MAP), scale * reaction.velocity(touch, MAP), atol=1e-9
    )


def test_areas_and_modalities_are_tuned_apart_and_inhibited() -> None:
    reaction = guided(gain=0.0)
    assert not reaction.velocity(np.ones((S, 4)), MAP).any()
    reaction.tune(FORCE, threshold=0.1, gain=2.0, cells=[2])
    reaction.tune(PROXIMITY, threshold=0.0, gain=-1.0, cells=np.array([0]))
    np.testing.assert_allclose(reaction.velocity(touched(2, 0, 0.4), MAP), np.array([0, 0, 0.6]))
    np.testing.assert_allclose(reaction.velocity(touched(0, 3, 0.4), MAP), np.array([-0.4, 0, 0]))
    assert not reaction.velocity(touched(2, 3, 0.9) + touched(0, 0, 0.9), MAP).any()
    assert np.argwhere(np.ones((S, 4)) > reaction.thresholds).tolist() == [[0, 3], [2, 0], [2, 1], [2, 2]]
    reaction.gains[:] = 9.0  # a copy
    reaction.inhibit()
    assert not reaction.velocity(np.ones((S, 4)), MAP).any()


def test_a_reading_at_the_threshold_or_not_a_number_does_nothing() -> None:
    reaction = guided()
    for reading in (0.05, 0.0, -3.0, math.nan):
        assert not reaction.velocity(touched(0, 0, reading), MAP).any()


@pytest.mark.parametrize(
    ("modality", "threshold", "gain"),
    [(Modality.TEMPERATURE, 0.1, 1), (FORCE, -0.1, 1), (FORCE, math.nan, 1), (FORCE, 0.1, math.inf)],
)
def test_reactions_refuse_what_makes_no_sense(modality: Modality, threshold: float, gain: float) -> None:
    with pytest.raises(ValueError, match=r"reaction|finite"):
        TactileReaction(S).tune(modality, threshold=threshold, gain=gain)


# --- postures, equation (5) -----------------------------------------------------------------------

joints = st.lists(st.floats(-1.5, 1.5), min_size=D, max_size=D).map(np.array)


@settings(deadline=None, max_examples=50)
@given(start=joints, goal=joints, speed=st.floats(0.5, 2.0))
def test_a_posture_is_reached_at_its_speed_and_told_once(start: Floats, goal: Floats, speed: float) -> None:
    posture, position = PostureControl(), start.copy()
    posture.set_target(PoseTarget("open", goal, speed_rad_s=speed, tolerance_rad=0.01))
    told = []
    ticks = math.ceil(np.abs(goal - start).max() / (speed * 5e-3)) + 2
    for tick in range(ticks):
        velocity, event = posture.step(tick, position)
        if np.abs(goal - position).max() > 0.01:
            assert np.abs(velocity).max() == pytest.approx(speed)
            assert event is None
        rest = np.abs(goal - position) <= 0.01
        assert not velocity[rest].any()
        assert (velocity * (goal - position) >= 0.0).all()
        told += [event] if event else []
        position = position + velocity * 5e-3
    assert np.abs(goal - position).max() <= 0.01
    assert [event.name for event in told] == ["open"]


def test_joints_arrive_together_as_in_equation_5() -> None:
    posture = PostureControl()
    posture.set_target(PoseTarget("closed", np.array([1.0, -0.5, 0.005]), speed_rad_s=0.4))
    velocity, _ = posture.step(0, np.zeros(3))
    np.testing.assert_allclose(velocity, np.array([0.4, -0.2, 0.0]))


def test_speed_and_accuracy_of_the_paper_are_the_defaults() -> None:
    """0.4 rad/s and 0.01 rad [M14, Table II], in the posture and in the deployment's stage."""
    posture = PostureControl()
    posture.set_target(PoseTarget("closed", np.array([1.0, 0.0101, 0.0099])))
    velocity, _ = posture.step(0, np.zeros(D))
    np.testing.assert_allclose(velocity, np.array([0.4, 0.4 * 0.0101, 0.0]))
    stage = StageSpec(kind="posture", pose="closed")
    assert (stage.speed_rad_s, stage.tolerance_rad) == (0.4, 0.01)


@pytest.mark.parametrize("deactivate", [False, True])
def test_a_reached_posture_is_held_or_let_go(deactivate: bool) -> None:
    posture = PostureControl()
    assert posture.step(0, np.ones(D))[1] is None
    target = PoseTarget("home", np.zeros(D), release_when_reached=deactivate)
    posture.set_target(target)
    assert posture.step(7, np.full(D, 0.01))[1] == PoseReached("home", 7)
    assert posture.active is not deactivate
    velocity, event = posture.step(8, np.ones(D))
    assert velocity.any() == (not deactivate)
    assert event is None
    assert posture.step(9, np.zeros(D))[1] is None  # told once, however often it comes back
    posture.set_target(target)
    assert posture.step(10, np.zeros(D))[1] == PoseReached("home", 10)
    posture.set_target(target)
    posture.clear_target()
    assert not posture.step(11, np.ones(D))[0].any()


@pytest.mark.parametrize(
    "change", [{"speed_rad_s": 0.0}, {"tolerance_rad": -1.0}, {"position_rad": np.array([math.nan])}]
)
def test_a_posture_refuses_what_makes_no_sense(change: dict[str, object]) -> None:
    posture = PostureControl()
    with pytest.raises(ValueError, match="pose 'x'"):
        posture.set_target(PoseTarget(**{"name": "x", "position_rad": np.zeros(1), **change}))  # type: ignore[arg-type]
    assert not posture.active


# --- safety ---------------------------------------------------------------------------------------

anything = st.lists(
    st.floats(allow_nan=True, allow_infinity=True) | st.floats(-3, 3), min_size=D, max_size=D
).map(lambda x: np.array(x, dtype=np.float64))
ticks = st.lists(
    st.tuples(anything, joints | anything, st.none() | st.integers(0, 200), st.none() | st.integers(0, 200)),
    min_size=1,
    max_size=12,
)


@settings(deadline=None, max_examples=300)
@given(
    ticks=ticks,
    speed=st.floats(0.01, 2),
    acceleration=st.none() | st.floats(0.1, 20),
    limited=st.booleans(),
)
def test_no_input_gets_past_the_limits(
    ticks: list[tuple[Floats, Floats, int | None, int | None]],
    speed: float,
    acceleration: float | None,
    limited: bool,
) -> None:
    box = (np.array([-1.0, -2.0, -np.inf]), np.array([1.0, 0.5, np.inf]))
    limits = SafetyLimits(speed, acceleration, position_rad=box if limited else None)
    clamp = SafetyClamp(limits, D, PERIOD_NS)
    last = np.zeros(D)
    rejected = stale = 0
    for number, (velocity, position, joints_age_ms, skin_age_ms) in enumerate(ticks):
        t_ns = number * PERIOD_NS
        ages = (None if age is None else t_ns - age * MS for age in (joints_age_ms, skin_age_ms))
        out = clamp.clamp(t_ns, velocity, position, *ages)

        assert np.isfinite(out).all()
        assert (np.abs(out) <= speed).all()
        finite = np.isfinite(velocity).all() and np.isfinite(position).all()
        rejected += not finite
        stale += any(age is None or age > 50 for age in (joints_age_ms, skin_age_ms))
        if not finite and acceleration is None:
            assert not out.any()
        if limited and finite:
            assert not out[(position >= box[1]) & (out > 0)].any()
            assert not out[(position <= box[0]) & (out < 0)].any()
        if acceleration is not None and not limited:
            assert np.abs(out - last).max() <= acceleration * 5e-3 * (1 + 1e-9)
        last = out
    assert clamp.counters.non_finite == rejected
    assert clamp.counters.stale_ticks == stale
    assert clamp.counters.ticks == len(ticks)


@settings(deadline=None)
@given(
    velocity=st.lists(st.floats(-50, 50), min_size=D, max_size=D).map(np.array),
    limit_rad_s=st.sampled_from([0.3, 1.0, 20.0]),
)
@example(velocity=np.full(D, 0.2), limit_rad_s=0.3)
def test_the_speed_limit_keeps_the_direction_and_lets_the_rest_through(
    velocity: Floats, limit_rad_s: float
) -> None:
    clamp = SafetyClamp(SafetyLimits(speed_rad_s=limit_rad_s), D, PERIOD_NS)
    out = clamp.clamp(0, velocity, np.zeros(D), 0, 0)
    largest = np.abs(velocity).max()
    np.testing.assert_allclose(out, velocity / max(1.0, largest / limit_rad_s), atol=1e-12)
    assert clamp.counters.clamped == (largest > limit_rad_s)


def test_the_acceleration_limit_leads_to_the_command_in_equal_steps() -> None:
    """10 rad/s² are 0.05 rad/s in 5 ms; all joints keep step with the one that changes most."""
    clamp = SafetyClamp(SafetyLimits(acceleration_rad_s2=10.0), 2, PERIOD_NS)
    out = [
        clamp.clamp(0, np.array(wanted), np.zeros(2), 0, 0)
        for wanted in 4 * [(0.2, -0.1)] + 4 * [(0.1, -0.05)]
    ]
    share = np.array([0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(out, share[:, None] * (0.2, -0.1), atol=1e-12)


def test_rounding_does_not_exceed_the_limit() -> None:
    clamp = SafetyClamp(SafetyLimits(speed_rad_s=0.7), D, PERIOD_NS)
    velocities = np.random.default_rng(5).uniform(-9.0, 9.0, (500, D))
    largest = np.abs(velocities).max(axis=1)
    assert (largest * (0.7 / largest) > 0.7).any()  # what scaling alone would let through
    for velocity in velocities:
        assert np.abs(clamp.clamp(0, velocity, np.zeros(D), 0, 0)).max() <= 0.7


@pytest.mark.parametrize("which", ["joints", "skin", "never"])
def test_stale_input_ramps_to_rest_and_back(which: str) -> None:
    clamp = SafetyClamp(SafetyLimits(), D, PERIOD_NS)
    wanted = np.array([0.5, -0.2, 0.0])
    share, stale = [], []
    for tick in range(80):
        t_ns = tick * PERIOD_NS
        old = t_ns if tick < 10 or tick >= 50 else 10 * PERIOD_NS - 1
        t_joints, t_skin = (
            (old, t_ns) if which == "joints" else (t_ns, old if which == "skin" or old == t_ns else None)
        )
        out = clamp.clamp(t_ns, wanted, np.zeros(D), t_joints, t_skin)
        np.testing.assert_allclose(out, out[0] / wanted[0] * wanted, atol=1e-12)
        share.append(out[0] / wanted[0])
        stale.append(clamp.stale)
    first = 10 if which == "never" else 20  # 50 ms of grace, if there was anything before
    assert stale == [first <= tick < 50 for tick in range(80)]
    assert clamp.counters.stale_ticks == 50 - first
    assert share[:first] == [1.0] * first
    assert share[first + 20 : 50] == pytest.approx([0.0] * (30 - first), abs=1e-12)
    assert share[70:] == pytest.approx([1.0] * 10)
    assert np.abs(np.diff(share)).max() == pytest.approx(0.05)  # 100 ms for all of it, down and up
    assert clamp.counters.clamped == 0


def test_after_a_number_that_is_none_motion_comes_back_smoothly() -> None:
    clamp = SafetyClamp(SafetyLimits(), 1, PERIOD_NS)
    commands = [0.5, math.nan, 0.5, 0.5]
    out = [clamp.clamp(0, np.array([v]), np.zeros(1), 0, 0)[0] for v in commands]
    np.testing.assert_allclose(out, np.array([0.5, 0.0, 0.025, 0.05]))
    assert clamp.counters.non_finite == 1
    assert clamp.clamp(0, np.ones(1), np.array([math.inf]), 0, 0)[0] == 0.0


def test_a_joint_slows_down_before_its_limit_and_may_come_back() -> None:
    limits = SafetyLimits(speed_rad_s=1.0, position_rad=(np.array([-1.0, -9.0]), np.array([1.0, 9.0])))
    clamp = SafetyClamp(limits, 2, PERIOD_NS)
    position, speeds = np.zeros(2), []
    for tick in range(600):
        out = clamp.clamp(
            tick * PERIOD_NS, np.array([0.8, 0.8]), position, tick * PERIOD_NS, tick * PERIOD_NS
        )
        assert out[1] == 0.8  # the other joint goes on
        speeds.append(out[0])
        position = position + out * 5e-3
    assert 0.99 < position[0] <= 1.0
    assert speeds[-1] < 1e-3
    assert np.diff(speeds).max() <= 0.0
    position[0] = 1.2  # pushed beyond
    t_ns = 600 * PERIOD_NS
    assert clamp.clamp(t_ns, np.array([0.8, 0.0]), position, t_ns, t_ns)[0] == 0.0
    assert clamp.clamp(t_ns, np.array([-0.8, 0.0]), position, t_ns, t_ns)[0] == -0.8


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_near_either_limit_the_speed_falls_linearly(side: float) -> None:
    """Limits at 1.5 and -0.5 rad, a zone of 0.1 rad: half of the speed in its middle."""
    limits = SafetyLimits(speed_rad_s=1.0, position_rad=(np.array([-0.5]), np.array([1.5])))
    limit_rad = 1.5 if side > 0.0 else -0.5
    for distance_rad, speed_rad_s in ((0.2, 0.8), (0.05, 0.5), (0.01, 0.1), (0.0, 0.0), (-0.1, 0.0)):
        clamp = SafetyClamp(limits, 1, PERIOD_NS)
        position = np.array([limit_rad - side * distance_rad])
        out = clamp.clamp(0, np.array([0.8 * side]), position, 0, 0)
        assert out[0] == pytest.approx(side * speed_rad_s, abs=1e-12)
        assert (
            SafetyClamp(limits, 1, PERIOD_NS).clamp(0, np.array([-0.8 * side]), position, 0, 0)[0]
            == -0.8 * side
        )


def test_a_clamp_refuses_limits_that_are_none() -> None:
    for limits in (
        SafetyLimits(speed_rad_s=0.0),
        SafetyLimits(acceleration_rad_s2=math.nan),
        SafetyLimits(ramp_ns=0),
    ):
        with pytest.raises(ValueError, match="positive and finite"):
            SafetyClamp(limits, D, PERIOD_NS)
    with pytest.raises(ValueError, match="the lower below the upper"):
        SafetyClamp(SafetyLimits(position_rad=(np.ones(D), np.ones(D))), D, PERIOD_NS)
    with pytest.raises(ValueError, match="expected"):
        SafetyClamp(SafetyLimits(), D, PERIOD_NS).clamp(0, np.zeros(2), np.zeros(D), 0, 0)


def test_limits_of_a_deployment_are_converted_to_nanoseconds() -> None:
    limits = SafetyLimits.from_spec(
        SafetySpec(max_joint_speed_rad_s=0.8, input_timeout_ms=30.0, ramp_ms=70.0)
    )
    assert limits.speed_rad_s == 0.8
    assert limits.joints_max_age_ns == limits.skin_max_age_ns == 30_000_000
    assert limits.ramp_ns == 70_000_000
