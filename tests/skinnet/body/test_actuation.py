"""The control interface: velocity commands in, positions out, and nothing wrong ever reaches a servo."""

import math

import body_scenes
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

MS = 1_000_000


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return body_scenes.arm(tmp_path_factory.mktemp("arm"))


def test_positions_follow_the_integral_of_the_command(tmp_path):
    body = body_scenes.arm(tmp_path)
    start = body.joints()
    assert body.set_command([0.5, -0.25])
    body.advance(1_000 * MS)
    assert body.set_command([0.0, 0.0])
    body.advance(1_300 * MS)
    np.testing.assert_allclose(body.joints() - start, [0.5, -0.25], atol=1e-3)


def test_the_robot_stands_still_from_the_first_step(tmp_path):
    """The servos carry the weight from the start: no transient would excite the accelerometers."""
    body = body_scenes.arm(tmp_path)
    start = body.joints()
    for _ in range(50):
        body.advance(body.t_ns + MS)
        np.testing.assert_allclose(body.joints(), start, atol=1e-9)


@pytest.mark.parametrize(
    "command",
    [
        [math.nan, 0.0],
        [0.0, math.inf],
        [0.0],
        [0.0, 0.0, 0.0],
        [],
        [[0.1, 0.1]],
        [1.51, 0.0],
        [0.0, -1e300],
    ],
)
def test_a_bad_command_is_refused_counted_and_stops_the_motion(tmp_path, command):
    body = body_scenes.arm(tmp_path)
    body.set_command([0.4, 0.0])
    body.advance(200 * MS)
    targets = body.data.ctrl.copy()
    assert not body.set_command(command)
    assert body.actuation.refused_commands == 1
    body.advance(400 * MS)
    np.testing.assert_array_equal(body.data.ctrl, targets)
    assert body.set_command([0.4, 0.0]), "a good command is taken again"
    assert body.actuation.refused_commands == 1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(width=64), max_size=4))
def test_whatever_is_commanded_targets_stay_finite_and_near(arm, command):
    arm.set_command(command)
    arm.advance(arm.t_ns + 5 * MS)
    joints = arm.joints()
    assert np.isfinite(arm.data.ctrl).all()
    assert np.all(np.abs(arm.data.ctrl - joints) <= 400.0 / 3000.0 + 0.02)
    assert -1.02 < joints[1] < 1.02


def test_targets_end_at_the_joint_limit_and_come_back_at_once(tmp_path):
    body = body_scenes.arm(tmp_path)
    body.set_command([0.0, 1.0])
    body.advance(3_000 * MS)
    assert body.data.ctrl[1] == 1.0
    body.set_command([0.0, -1.0])
    body.advance(3_100 * MS)
    assert body.data.ctrl[1] == pytest.approx(0.9)


def test_a_blocked_joint_does_not_wind_up(tmp_path):
    """A wall stops the arm; when the command turns, the arm turns at once."""
    wall = '<geom type="box" size="0.5 0.02 0.5" pos="0.3 0.12 1"/>'
    body = body_scenes.arm(tmp_path, more=wall)
    body.set_command([1.0, 0.0])
    body.advance(4_000 * MS)
    lag_rad = body.data.ctrl[0] - body.joints()[0]
    assert lag_rad <= 400.0 / 3000.0 + 1e-9
    body.set_command([-1.0, 0.0])
    body.advance(4_300 * MS)
    assert body.data.ctrl[0] < body.joints()[0] + 1e-3


def test_joints_hands_out_copies(tmp_path):
    body = body_scenes.arm(tmp_path)
    joints, stimulus = body.joints(), body.stimulus()
    joints[:], stimulus[:] = 99.0, 99.0
    assert not np.any(body.joints() == 99.0)
    assert not np.any(body.stimulus() == 99.0)
