"""The teacher's finger does what the script says, when its stage is on, and knows what really happened."""

import math

import body_scenes
import numpy as np
import pytest

from skinnet.body.teacher.finger_task import FingerPhase
from skinnet.deployment.environment.teacher import TeacherSpec, TouchSpec
from skinnet.errors import DeploymentError
from skinnet.protocol.messages import STIMULUS_NAMES

MS = 1_000_000
DISTANCE = STIMULUS_NAMES.index("distance_m")


def touch(**keys):
    return TouchSpec(**{"cell": "skin/0", "stage": "guide", "start_s": 0.1, "approach_m": 0.02, **keys})


def run(body, until_ms, every_ms=4, command=None):
    """Stimuli of cell 0 over time; `command` may answer each with velocities."""
    rows = []
    while body.t_ns < until_ms * MS:
        stimulus = body.stimulus()[0]
        rows.append(stimulus)
        if command is not None:
            body.set_command(command(stimulus))
        body.advance(body.t_ns + every_ms * MS)
    return np.array(rows)


def test_a_path_touch_reaches_its_depth_holds_and_leaves(tmp_path):
    """A ball of radius r pressed d deep into Winkler foam feels k π (r d² − d³/3),."""
    body = body_scenes.arm(tmp_path, touches=(touch(depth_m=0.006, hold_s=0.4),))
    body.begin_stage("guide")
    rows = run(body, 2500)
    (truth,) = body.teacher.outcome.touches
    exact_n = 1.5e6 * math.pi * (0.008 * 0.006**2 - 0.006**3 / 3)
    assert truth.mean_hold_force_n == pytest.approx(exact_n, rel=0.015), "the arm yields a little"
    assert truth.begin_ns == 100 * MS
    assert truth.contact_ns == pytest.approx(100 * MS + 0.020 / 0.03 * 1e9, abs=15 * MS)
    assert truth.hold_ns == pytest.approx(100 * MS + 0.026 / 0.03 * 1e9, abs=3 * MS)
    assert truth.end_ns == pytest.approx(truth.hold_ns + 400 * MS + 0.026 / 0.03 * 1e9, abs=3 * MS)
    assert rows[:, :3].sum(axis=1).max() == pytest.approx(truth.peak_force_n, rel=0.02)
    assert not rows[-1, :3].any()
    assert np.isinf(rows[-1, DISTANCE])
    assert body.teacher.phase is FingerPhase.PARKED


def test_a_moving_finger_feels_the_damping_of_the_foam(tmp_path):
    """Just before it stops, p = k d + c v over the touched area; at rest, p = k d."""
    body = body_scenes.arm(tmp_path, touches=(touch(depth_m=0.006, speed_m_s=0.1, hold_s=0.5),))
    body.begin_stage("guide")
    run(body, 1200)
    (truth,) = body.teacher.outcome.touches
    damping_n = 1.0e4 * 0.1 * math.pi * (2 * 0.008 * 0.006 - 0.006**2)
    assert truth.peak_force_n - truth.mean_hold_force_n == pytest.approx(damping_n, rel=0.05)


def test_a_touch_may_stop_short_of_contact(tmp_path):
    body = body_scenes.arm(tmp_path, touches=(touch(depth_m=-0.005, hold_s=0.5),))
    body.begin_stage("guide")
    rows = run(body, 2500)
    assert rows[:, DISTANCE].min() == pytest.approx(0.005, abs=1e-4)
    assert not rows[:, :3].any()
    assert body.teacher.outcome.touches[0].contact_ns is None


@pytest.mark.parametrize("force_n", [0.6, 1.0, 2.7])
def test_a_force_touch_holds_its_force_within_two_percent_on_an_arm_that_evades(tmp_path, force_n):
    """The arm lowers itself at 0.1 rad/s under the finger, which follows."""
    spec = touch(force_n=force_n, hold_s=3.0)
    body = body_scenes.arm(tmp_path, touches=(spec,))
    body.begin_stage("guide")
    rows = run(body, 3500, command=lambda s: [0.05, 0.1 if s[:3].sum() > 0.3 else 0.0])
    assert body.joints()[1] > 0.2, "the arm has evaded"
    steady = rows[400:, :3].sum(axis=1)
    np.testing.assert_allclose(steady, force_n, rtol=0.02)
    (truth,) = body.teacher.outcome.touches
    assert truth.mean_hold_force_n == pytest.approx(force_n, rel=0.02)
    assert truth.mean_felt_force_n == pytest.approx(force_n, rel=0.02), "the whole tip is on cells"
    assert truth.mean_gauge_force_n == pytest.approx(force_n, rel=0.02), "which are flat"


@pytest.mark.parametrize("speed_rad_s", [0.1, -0.1])
def test_the_way_of_the_touched_cell_has_the_sign_of_evasion(tmp_path, speed_rad_s):
    """The cell is 0.3 m from the axis and its face 22 mm above it: inwards is down."""
    body = body_scenes.arm(tmp_path, touches=(touch(force_n=1.0, hold_s=2.0),))
    body.begin_stage("guide")
    run(body, 1500, command=lambda s: [0.0, speed_rad_s if s[:3].sum() > 0.3 else 0.0])
    angle_rad = body.joints()[1]
    assert abs(angle_rad) > 0.04
    expected_m = 0.3 * math.sin(angle_rad) + 0.022 * (1.0 - math.cos(angle_rad))
    assert body.teacher.outcome.touches[0].evaded_m == pytest.approx(expected_m, abs=1e-3)


@pytest.mark.parametrize("element", range(3))
def test_a_touch_on_a_force_cell_holds_the_force_there(tmp_path, element):
    body = body_scenes.arm(tmp_path, touches=(touch(force_n=1.0, force_cell=element, hold_s=1.0),))
    body.begin_stage("guide")
    rows = run(body, 2000)
    forces = rows[-1, :3]
    assert forces[element] == pytest.approx(1.0, rel=0.02)
    assert np.delete(forces, element).max() < 0.2


@pytest.mark.parametrize(("tip_radius_m", "force_cell"), [(0.008, None), (0.008, 1), (0.015, None)])
def test_a_force_that_is_accepted_is_reached(tmp_path, tip_radius_m, force_cell):
    """Asked for too much, the refusal names the largest force; that is accepted, and held within 3 %."""
    keys = {"hold_s": 1.0, "force_cell": force_cell}

    def built(force_n):
        spec = TeacherSpec(tip_radius_m=tip_radius_m, touches=(touch(force_n=force_n, **keys),))
        mjcf = body_scenes.ARM.format(more="", sensors="")
        skin = (body_scenes.patch("skin", "arm", *body_scenes.ARM_CELLS),)
        return body_scenes.body_of(tmp_path, mjcf, skin, ("turn", "lift"), teacher=spec)

    with pytest.raises(DeploymentError, match=r"teacher\.touches\[0\]\.force_n = 50: .* at most ") as refusal:
        built(50.0)
    largest_n = float(str(refusal.value).split("at most ")[1].split(" N")[0])
    body = built(largest_n)
    body.begin_stage("guide")
    run(body, 2500)
    (truth,) = body.teacher.outcome.touches
    assert truth.mean_hold_force_n == pytest.approx(largest_n, rel=0.03)


def test_the_largest_force_is_that_of_a_tip_at_the_shell(tmp_path):
    """Foam of 12 mm under a tip of 8 mm: k π (r² (t - r) + 2/3 r³); a touch that asks for more is refused."""
    exact_n = 1.5e6 * math.pi * (0.008**2 * 0.004 + 2.0 / 3.0 * 0.008**3)
    body_scenes.arm(tmp_path, touches=(touch(force_n=0.99 * exact_n),))
    with pytest.raises(DeploymentError, match=r"at most 2\.8\d* N of skin/0, with the foam fully compressed"):
        body_scenes.arm(tmp_path, touches=(touch(force_n=1.01 * exact_n),))


def test_touches_of_a_stage_that_never_begins_never_happen(tmp_path):
    body = body_scenes.arm(tmp_path, touches=(touch(depth_m=0.006), touch(depth_m=0.006, stage="other")))
    run(body, 1000, every_ms=50)
    assert body.teacher.outcome.touches == []
    body.begin_stage("other")
    run(body, 3500, every_ms=50)
    assert [truth.touch for truth in body.teacher.outcome.touches] == [1]
    assert body.teacher.outcome.touches[0].begin_ns == 1100 * MS


def test_the_next_stage_sends_the_finger_away(tmp_path):
    script = (touch(depth_m=0.006, hold_s=9.0), touch(depth_m=0.006, start_s=0.2))
    body = body_scenes.arm(tmp_path, touches=script)
    body.begin_stage("guide")
    run(body, 1200, every_ms=50)
    assert body.teacher.phase is FingerPhase.HOLD
    body.begin_stage("quiet")
    assert body.teacher.phase is FingerPhase.WITHDRAW
    rows = run(body, 3500)
    assert body.teacher.phase is FingerPhase.PARKED
    assert not rows[-1, :3].any()
    assert len(body.teacher.outcome.touches) == 1


def test_a_touch_waits_for_the_one_before(tmp_path):
    script = (touch(depth_m=0.003, hold_s=0.2), touch(depth_m=0.003, cell="skin/1", start_s=0.3))
    body = body_scenes.arm(tmp_path, touches=script)
    body.begin_stage("guide")
    run(body, 4000, every_ms=50)
    first, second = body.teacher.outcome.touches
    assert first.end_ns is not None
    assert 0 <= second.begin_ns - first.end_ns <= 2 * MS
    assert (first.cell, second.cell) == ("skin/0", "skin/1")


def test_the_finger_is_warm(tmp_path):
    body = body_scenes.arm(tmp_path, touches=(touch(depth_m=0.004, hold_s=0.3),))
    body.begin_stage("guide")
    rows = run(body, 2500)
    touched = rows[:, :3].sum(axis=1) > 0
    assert set(rows[touched, 7]) == {33.0}
    assert set(rows[rows[:, DISTANCE] > 0.0, 7]) == {23.0}
