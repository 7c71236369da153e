"""The stand: where it goes and when, and what stands on it while it does."""

import itertools
import math

import msgspec
import numpy as np
import pytest
from grasp_rig import CELLS_M2, FOAM_PA_PER_M, MS, S, close, rig, rig_deployment
from hypothesis import given, settings
from hypothesis import strategies as st

from skinnet.body.environment.stand import TRANSITIONS, HeightTrajectory, StandEvent, StandPhase
from skinnet.deployment import Deployment
from skinnet.deployment.checks import check
from skinnet.deployment.environment.objects import OBJECTS
from skinnet.errors import DeploymentError

G = 9.81
STEP_S = 1e-3


def rows(body, name):
    return body.ground_truth().arrays[name]


def phases(body):
    return {phase: t_ns / S for t_ns, phase in body.stand.history}


@given(
    targets=st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=4),
    limit=st.floats(0.02, 2.0),
    acceleration=st.floats(0.1, 20.0),
    pause=st.integers(1, 700),
)
@settings(max_examples=60, deadline=None)
def test_a_lift_keeps_its_limits_wherever_it_is_sent(targets, limit, acceleration, pause):
    lift = HeightTrajectory(limit, acceleration)
    speed, height, arrived = 0.0, 0.0, False
    for target in targets:
        lift.target_m = target
        for _ in range(pause if target is not targets[-1] else 60_000):
            arrived = lift.step(STEP_S)
            assert abs(lift.speed_m_s) <= limit * (1 + 1e-12)
            assert abs(lift.speed_m_s - speed) <= 2.0 * acceleration * STEP_S + 1e-12
            assert abs(lift.height_m - height) <= (limit + acceleration * STEP_S) * STEP_S + 1e-12
            speed, height = lift.speed_m_s, lift.height_m
            if arrived:
                break
    assert lift.height_m == targets[-1]
    assert lift.speed_m_s == 0.0
    assert not lift.step(STEP_S), "it arrives once"


@pytest.mark.parametrize("step_s", [0.125e-3, 0.25e-3, 0.5e-3, STEP_S, 2e-3])
def test_a_lift_takes_the_time_of_a_trapezoid(step_s):
    lift = HeightTrajectory(0.1, 0.5)
    lift.target_m = 0.4
    heights = []
    while not heights or heights[-1] < 0.4:
        lift.step(step_s)
        heights.append(lift.height_m)
    assert len(heights) * step_s == pytest.approx(0.4 / 0.1 + 0.1 / 0.5, abs=3.0 * step_s)
    assert np.all(np.diff(heights) >= 0.0), "it does not overshoot"


def test_the_table_is_all_that_it_does(tmp_path):
    body = rig(tmp_path)
    for phase, event in itertools.product(StandPhase, StandEvent):
        if (phase, event) not in TRANSITIONS:
            body.stand.phase = phase
            with pytest.raises(KeyError):
                body.stand.apply(event, 0)
            assert body.stand.phase is phase
    reached = {StandPhase.WAITING} | set(TRANSITIONS.values())
    assert reached == set(StandPhase)
    assert not any(phase is StandPhase.RETURNED for phase, _ in TRANSITIONS), "once back it stays"


def test_it_follows_its_timetable(tmp_path):
    times = {"rise_delay_s": 0.5, "lower_delay_s": 1.0, "lower_m": 0.2, "lowered_s": 1.5, "speed_m_s": 0.2}
    body = rig(tmp_path, rise_m=0.3, rise_stage="guide", acceleration_m_s2=1.0, **times)
    body.advance(300 * MS)
    body.begin_stage("guide")
    body.advance(500 * MS)
    body.begin_stage("hold")  # too early: it is still below
    body.advance(600 * MS)
    body.begin_stage("guide")  # does not begin for the first time
    body.advance(5 * S)
    body.begin_stage("hold")
    body.advance(12 * S)
    body.begin_stage("guide")
    body.begin_stage("hold")
    body.advance(15 * S)
    t = phases(body)
    assert [phase for _, phase in body.stand.history] == list(StandPhase)
    assert t[StandPhase.RISING] == pytest.approx(0.8, abs=0.002)
    assert t[StandPhase.PRESENTED] - t[StandPhase.RISING] == pytest.approx(0.3 / 0.2 + 0.2 / 1.0, abs=0.01)
    assert t[StandPhase.LOWERING] == pytest.approx(6.0, abs=0.002)
    assert t[StandPhase.LOWERED] - t[StandPhase.LOWERING] == pytest.approx(0.2 / 0.2 + 0.2, abs=0.01)
    assert t[StandPhase.RETURNING] - t[StandPhase.LOWERED] == pytest.approx(1.5, abs=0.002)
    assert t[StandPhase.RETURNED] - t[StandPhase.RETURNING] == pytest.approx(1.2, abs=0.01)
    top_m = rows(body, "stand_top_m")
    assert [top_m[0], top_m.max(), top_m[-1]] == pytest.approx([0.63, 0.93, 0.93], abs=1e-6)
    away = rows(body, "stand_t_ns") == round((t[StandPhase.LOWERED] + 0.5) * 100) * 10 * MS
    assert top_m[away] == pytest.approx(0.73, abs=1e-6)


@pytest.mark.parametrize(
    ("left_s", "first"), [(0.05, None), (0.4, StandPhase.LOWERING), (2.0, StandPhase.LOWERED)]
)
def test_it_comes_back_at_once_when_the_robot_gives_up(tmp_path, left_s, first):
    body = rig(tmp_path, lower_delay_s=0.1, lower_m=0.2, speed_m_s=0.2, acceleration_m_s2=1.0)
    body.begin_stage("hold")
    body.advance(round(left_s * S))
    body.begin_stage("safe")
    body.advance(6 * S)
    if first is None:
        assert body.stand.phase is StandPhase.PRESENTED
        return
    assert body.stand.phase is StandPhase.RETURNED
    (before, gave_up), (_, back) = itertools.pairwise(body.stand.history[-3:])
    assert before[1] is first
    assert gave_up == (round(left_s * S), StandPhase.RETURNING)
    assert back[0] - gave_up[0] < 2 * S
    assert rows(body, "stand_top_m")[-1] == pytest.approx(0.93, abs=1e-9)


@pytest.mark.parametrize("name", OBJECTS)
def test_what_stands_on_it_is_carried_without_bounce_or_drift(tmp_path, name):
    """Its weight, and m (g + a) while it speeds up and slows down, go through the contacts all the time."""
    body = rig(
        tmp_path, name, rise_m=0.2, rise_stage="guide", lower_delay_s=0.5, lowered_s=0.5, max_yaw_deg=20.0
    )
    mass_kg = OBJECTS[name].mass_kg
    body.advance(500 * MS)
    body.begin_stage("guide")
    body.advance(4 * S)
    body.begin_stage("hold")
    body.advance(13 * S)
    assert body.stand.phase is StandPhase.RETURNED
    t_s = rows(body, "object_t_ns") / S
    force_n, pose = rows(body, "object_stand_force_n"), rows(body, "object_pose").astype(np.float64)
    settled = t_s > 0.3
    assert force_n[-1] == pytest.approx(mass_kg * G, rel=1e-4)
    assert force_n[settled].min() == pytest.approx(mass_kg * (G - 0.5), rel=0.01)
    assert force_n[settled].max() == pytest.approx(mass_kg * (G + 0.5), rel=0.01)
    moved = pose[settled] - pose[t_s == 0.3]
    assert np.abs(moved[:, [0, 1]]).max() < 2e-5
    assert np.abs(moved[:, 3:]).max() < 2e-5
    above_m = pose[settled, 2] - rows(body, "stand_top_m")[settled]
    assert np.ptp(above_m) < 2e-5
    truth = body.ground_truth().facts["object"]
    assert truth["lift_off_ns"] is None
    assert truth["carried_s"] == 0.0
    assert truth["peak_speed_m_s"] == 0.0
    assert rows(body, "object_speed_m_s").max() == pytest.approx(0.1, abs=1e-3)
    assert truth["max_descent_m"] == pytest.approx(0.25, abs=1e-4), "nobody held it"
    assert not truth["rigid_contacts"]


def test_an_object_falls_freely_when_the_stand_is_pulled_away(tmp_path):
    body = rig(tmp_path, lower_delay_s=0.1, lower_m=0.8, speed_m_s=5.0, acceleration_m_s2=40.0)
    body.begin_stage("hold")
    body.advance(400 * MS)
    t_s = (rows(body, "object_t_ns") - body.stand.history[1][0]) / S
    height_m, force_n = rows(body, "object_pose")[:, 2], rows(body, "object_stand_force_n")
    falling = (t_s > 0.01) & (t_s < 0.28)
    assert not force_n[falling].any()
    assert height_m[falling] == pytest.approx(1.07 - 0.5 * G * t_s[falling] ** 2, abs=2e-3)
    speed_m_s = rows(body, "object_speed_m_s")[falling]
    assert speed_m_s == pytest.approx(G * t_s[falling], abs=0.02)
    truth = body.ground_truth().facts["object"]
    assert truth["lift_off_ns"] == pytest.approx(100 * MS, abs=10 * MS)
    assert truth["peak_speed_m_s"] == pytest.approx(speed_m_s.max(), rel=0.15)


def box_n_per_m():
    """Stiffness of the foam of one paddle in series with the box."""
    return CELLS_M2 / (1.0 / FOAM_PA_PER_M + 1.0 / OBJECTS["delivery_box"].stiffness_pa_per_m)


def squeezed(tmp_path, share, **stand):
    """A box between two paddles that press with `share` of what friction needs to carry it."""
    thing = OBJECTS["delivery_box"]
    body = rig(tmp_path, lower_delay_s=0.1, **stand)
    needed_n = thing.mass_kg * G / (2 * 0.6)
    close(body, share * needed_n / box_n_per_m(), thing.size_m[1])
    body.begin_stage("hold")
    return body


def test_friction_of_two_skins_carries_up_to_twice_mu_n(tmp_path):
    body = squeezed(tmp_path, 1.05, lower_m=0.012, speed_m_s=0.005)
    body.advance(body.t_ns + 5 * S)
    truth = body.ground_truth()
    facts, height_m = truth.facts["object"], truth.arrays["object_pose"][:, 2]
    assert body.stand.phase is StandPhase.LOWERED
    assert facts["dropped_ns"] is None
    assert facts["carried_without_stand_s"] == pytest.approx(5.0 - 0.1 - 0.012 / 0.005, abs=0.03)
    sheared_m = 1.1 * G / (2 * 0.5 * box_n_per_m())
    assert facts["max_descent_m"] == pytest.approx(sheared_m, rel=0.05), "the foam's shear, no slip"
    assert np.ptp(height_m[-100:]) < 1e-5
    assert truth.arrays["object_speed_m_s"][-1] < 1e-5
    assert body.data.xfrc_applied[body.model.mj.body("object").id, 2] == pytest.approx(1.1 * G, rel=1e-4)
    assert truth.facts["peak_force_by_stage_n"]["hold"] == pytest.approx(1.05 * 1.1 * G / 1.2 / 12, rel=0.02)


def test_above_that_it_slips_with_the_rest_of_its_weight(tmp_path):
    body = squeezed(tmp_path, 0.8, lower_m=0.4, speed_m_s=2.0, acceleration_m_s2=20.0)
    began_ns = body.t_ns
    body.advance(body.t_ns + 450 * MS)
    t_s = (rows(body, "object_t_ns") - began_ns) / S
    slipping = (t_s > 0.16) & (t_s < 0.38)
    assert not rows(body, "object_stand_force_n")[slipping].any()
    gained = np.polyfit(t_s[slipping], rows(body, "object_speed_m_s")[slipping], 1)[0]
    assert gained == pytest.approx(0.2 * G, rel=0.02)
    body.advance(body.t_ns + 2 * S)
    assert body.ground_truth().facts["object"]["max_descent_m"] > 0.1


def test_what_falls_off_the_stand_is_dropped(tmp_path):
    """Pushed off by a paddle that goes on."""
    body = rig(tmp_path, "lid", plate_width_m=0.1)
    close(body, -0.03, 0.33)
    body.set_command([0.5, 0.0])
    body.advance(body.t_ns + 350 * MS)
    body.set_command([-1.0, -1.0])
    body.advance(body.t_ns + 1500 * MS)
    truth = body.ground_truth()
    dropped_ns = truth.facts["object"]["dropped_ns"]
    assert dropped_ns is not None
    t_ns, height_m = truth.arrays["object_t_ns"], truth.arrays["object_pose"][:, 2]
    assert (height_m[t_ns < dropped_ns] >= truth.arrays["stand_top_m"][t_ns < dropped_ns]).all()
    assert "floor" in truth.facts["object"]["rigid_contacts"]
    assert truth.facts["object"]["rigid_contacts"]["floor"]["first_ns"] > dropped_ns


def test_a_stuck_object_cannot_be_moved(tmp_path):
    body = rig(tmp_path, fix_object=True, rise_m=0.2, rise_stage="guide", lower_delay_s=0.1)
    body.begin_stage("guide")
    body.advance(3 * S)
    start_m = body.data.body("object").xpos.copy()
    close(body, 0.004, 0.36)
    body.set_command([0.02, -0.02])  # both to the right, 10 mm
    body.advance(body.t_ns + 500 * MS)
    assert body.data.body("object").xpos == pytest.approx(start_m, abs=1e-5)
    body.set_command([0.0, 0.0])
    body.begin_stage("hold")
    body.advance(body.t_ns + 4 * S)
    assert body.data.body("object").xpos[2] == pytest.approx(start_m[2] - 0.25, abs=1e-5)
    assert body.ground_truth().facts["object"]["stuck"]


@pytest.mark.parametrize(
    ("stand", "says"),
    [
        ({"object_face_x_m": 0.2, "max_offset_m": 0.0, "grasp_z_m": 0.3}, "in contact with base"),
        ({"rise_m": 0.95, "rise_stage": "guide"}, "in contact with floor at the start"),
        ({"grasp_z_m": 0.15}, r"grasp_z_m = 0.15: must exceed 0.16"),
        ({"plate_edge_x_m": 0.6}, r"plate_edge_x_m = 0.6: .* at 0.55"),
    ],
)
def test_what_cannot_stand_there_is_refused(tmp_path, stand, says):
    keys = {"object_face_x_m": -0.13, "plate_edge_x_m": -0.1} if "in contact with base" in says else {}
    with pytest.raises(DeploymentError, match=says):
        rig(tmp_path, **(stand | keys))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"stand": None}, r'object = "delivery_box": needs a stand'),
        ({"scripted_stimuli": {}}, "stand, scripted_stimuli: exclude each other"),
        ({"stand": {"rise_m": 0.2}}, "rise_m = 0.2: the plate would never rise"),
        ({"stand": {"lower_stage": "hold"}}, "lower_stage = 'hold': unknown stage; there are guide"),
        ({"stand": {"rise_m": 0.1, "rise_stage": "grasp.open"}}, "rise_stage = 'grasp.open': unknown"),
    ],
)
def test_contradictions_are_refused(changes, says):
    with pytest.raises(DeploymentError, match=says):
        check(changed(changes))


def changed(changes, **guide):
    raw = msgspec.to_builtins(rig_deployment(lower_stage=None))
    guide = guide or {"kind": "passive", "duration_s": 1.0}
    control = {"program": ["guide"], "stages": {"guide": guide}}
    return msgspec.convert(raw | {"controller": raw["controller"] | control} | changes, Deployment)


def test_states_of_a_session_are_stages_too():
    stand = {"rise_m": 0.1, "rise_stage": "guide.open", "lower_stage": "guide.hold"}
    check(changed({"stand": stand}, kind="teach_and_grasp"))
    with pytest.raises(DeploymentError, match="unknown stage"):
        check(changed({"stand": stand}))


def test_chunks_and_readings_change_nothing(tmp_path):
    def history(chunk_ms, read):
        body = rig(tmp_path, rise_m=0.05, rise_stage="guide", lower_delay_s=0.02, acceleration_m_s2=5.0)
        for k in range(0, 2400, 20):
            if k in (20, 1000, 1500):
                body.begin_stage({20: "guide", 1000: "hold", 1500: "safe"}[k])
            body.set_command(np.full(2, 0.27 if k < 1000 else -0.02))
            for end in range(k + chunk_ms, k + 21, chunk_ms):
                body.advance(end * MS)
                if read and end % read == 0:
                    body.stimulus()
        truth = body.ground_truth()
        del truth.facts["threshold_crossings"]  # those of proximity are seen when a stimulus is read
        return truth.facts, {name: array.tobytes() for name, array in truth.arrays.items()}

    assert history(20, 0) == history(20, 4) == history(4, 4)
    facts = history(20, 0)[0]
    assert [phase for _, phase in facts["stand"]["phases"]][-2:] == ["returning", "back"]


def test_a_rigid_touch_is_told_with_place_time_and_stage(tmp_path):
    body = rig(tmp_path, bare_m=-0.020)
    body.begin_stage("guide")
    close(body, -0.006, 0.36)
    body.set_command([0.02, 0.0])
    body.advance(body.t_ns + 500 * MS)
    body.begin_stage("hold.it")
    body.advance(body.t_ns + 100 * MS)
    left = body.ground_truth().facts["object"]["rigid_contacts"]["bare"]
    assert left["first_ns"] < body.t_ns - 300 * MS
    assert left["duration_by_stage_s"].keys() == {"guide", "hold.it"}
    assert left["duration_by_stage_s"]["hold.it"] == pytest.approx(0.1, abs=0.005)
    assert math.fsum(left["duration_by_stage_s"].values()) == pytest.approx(left["duration_s"])
    assert left["first_ns"] <= left["peak_ns"] < body.t_ns
    assert left["peak_force_n"] > 0.0


def test_what_a_bare_link_carries_is_not_carried_by_skin(tmp_path):
    """A bare block beside the foam takes its share of the friction; the skin alone is not said to hold."""
    on_skin, on_block = (
        squeezed(tmp_path, 1.6, lower_m=0.012, speed_m_s=0.005, bare_m=bare_m) for bare_m in (0.01, -0.024)
    )
    for body in (on_skin, on_block):
        body.advance(body.t_ns + 5 * S)
    skin, block = (body.ground_truth().facts["object"] for body in (on_skin, on_block))
    assert skin["carried_on_skin_s"] == skin["carried_without_stand_s"] > 2.0
    assert block["carried_without_stand_s"] > 2.0
    assert block["carried_on_skin_s"] < 0.1
    assert skin["weight_n"] == pytest.approx(1.1 * G, rel=1e-6)


def test_an_object_that_falls_onto_the_lowered_stand_is_dropped(tmp_path):
    """It lies on the plate, its centre above it, all the time; the former criterion saw no drop."""
    body = rig(tmp_path, lower_delay_s=0.1, lower_m=0.2, speed_m_s=5.0, acceleration_m_s2=40.0)
    body.begin_stage("hold")
    body.advance(S)
    assert body.stand.phase is StandPhase.LOWERED
    arrays = body.ground_truth().arrays
    assert (arrays["object_pose"][:, 2] > arrays["stand_top_m"]).all()
    lowered_ns = next(t_ns for t_ns, phase in body.stand.history if phase is StandPhase.LOWERED)
    assert body.ground_truth().facts["object"]["dropped_ns"] >= lowered_ns
