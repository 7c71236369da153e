"""Joints of every kind: slides, mimics, tendons, balls and closed loops load, settle and obey their laws."""

import math

import body_scenes
import mujoco
import numpy as np
import pytest
from joint_models import BALL_PENDULUM, FOUR_BAR, GANTRY, GRIPPER, PENDULUM, TENDON_FINGER

from skinnet.body.ground_truth.cell_kinematics import (
    activity_matrix,
    cell_jacobian,
    cell_poses,
    set_joint_positions,
)
from skinnet.body.model import load_model
from skinnet.body.settling import settle
from skinnet.body.simulation import BodySimulation
from skinnet.body.visual_shapes import VisualModel
from skinnet.deployment.servo import ServoSpec
from skinnet.deployment.skin.patches import CellPoseSpec
from skinnet.errors import DeploymentError, ModelError

MS = 1_000_000
SERVO = ServoSpec(frequency_hz=12.0)
OMEGA2 = (2.0 * math.pi * 12.0) ** 2
STIFF = 'solref="0.004 1"'


def body_of(folder, mjcf, joints, **body):
    keys = {"servo": SERVO, **body}
    return body_scenes.body_of(folder, mjcf, (), joints, **keys)


def settled(deployment, folder, duration_ns):
    return settle(BodySimulation(deployment, folder), deployment, duration_ns).metrics


def qpos(body, joint):
    return float(body.data.qpos[body.model.mj.joint(joint).qposadr[0]])


def test_a_gantry_is_in_metres_and_newtons(tmp_path):
    gantry = body_of(tmp_path, GANTRY, ("along", "down", "turn"), home_rad={"down": -0.1})
    kp = gantry.model.gains.kp_nm_per_rad
    np.testing.assert_allclose(kp[:2], [OMEGA2 * 6.0, OMEGA2 * 2.5], rtol=1e-12)
    assert gantry.model.joint_units == ("m", "m", "rad")
    gantry.set_command([0.2, -0.1, 0.3])
    gantry.advance(1_000 * MS)
    gantry.set_command([0.0, 0.0, 0.0])
    gantry.advance(1_300 * MS)
    np.testing.assert_allclose(gantry.joints(), [0.2, -0.2, 0.3], atol=1e-4)
    assert not gantry.set_command([1.6, 0.0, 0.0]), "1.5 m/s is the limit"
    gantry.set_command([1.0, 0.0, 0.0])
    gantry.advance(2_300 * MS)
    assert gantry.joints()[0] == pytest.approx(0.4, abs=1e-4)


def test_messages_of_slide_joints_are_in_metres(tmp_path):
    with pytest.raises(DeploymentError, match=r"down = 0.1: the joint slides from -0.3 to 0 m$"):
        body_of(tmp_path, GANTRY, ("along", "down"), home_rad={"down": 0.1})
    metrics = settled(body_scenes.deployment_of((), ("down", "turn"), servo=SERVO), tmp_path, 100 * MS)
    assert abs(metrics["settle.drift_m.down"]) < 1e-6
    assert abs(metrics["settle.drift_rad.turn"]) < 1e-6


@pytest.mark.parametrize("coefficients", [(0.0, 1.0, 0.0), (0.1, -0.5, 0.3)])
def test_a_mimic_joint_follows_from_the_home_posture_on(tmp_path, coefficients):
    polycoef = " ".join(map(str, coefficients))
    mjcf = GRIPPER.format(polycoef=polycoef, solref=STIFF)
    gripper = body_of(tmp_path, mjcf, ("left",), home_rad={"left": 0.3})

    def expected():
        left = qpos(gripper, "left")
        return sum(c * left**power for power, c in enumerate(coefficients))

    assert qpos(gripper, "right") == pytest.approx(expected(), abs=1e-9)
    gripper.advance(200 * MS)
    assert qpos(gripper, "left") == pytest.approx(0.3, abs=1e-3)
    gripper.set_command([0.8])
    for _ in range(10):
        gripper.advance(gripper.t_ns + 50 * MS)
        assert qpos(gripper, "right") == pytest.approx(expected(), abs=2e-3)
    assert qpos(gripper, "left") > 0.6


def test_a_mimic_joint_adds_its_inertia_to_that_of_its_leader(tmp_path):
    """With right = −2 left: M = M_left + 4 M_right; thin rods about their ends, spheres at the ends aside."""
    mjcf = GRIPPER.format(polycoef="0 -2 0 0 0", solref=STIFF)
    gripper = body_of(tmp_path, mjcf, ("left",))
    mass = np.zeros(2)
    for i in range(2):
        momentum = np.empty(2)
        mujoco.mj_mulM(gripper.model.mj, gripper.data, momentum, np.eye(2)[i])
        mass[i] = momentum[i]
    assert gripper.model.gains.kp_nm_per_rad[0] == pytest.approx(OMEGA2 * (mass[0] + 4.0 * mass[1]), rel=1e-9)
    np.testing.assert_allclose(gripper.model.joint_motion, [[1.0, -2.0]], atol=1e-9)


@pytest.mark.parametrize(
    ("joints", "polycoef", "mjcf", "words"),
    [
        (("left", "right"), "0 1 0 0 0", GRIPPER, r'"right" follows joint "left" .* control one'),
        (("right",), "0.2 0 0 0 0", GRIPPER.replace('joint2="left"', ""), r'"right" is held by .*; .*locked'),
        (("eye",), "", BALL_PENDULUM, r'"eye" of .* is a ball joint, .*; leave it out, .* body.locked'),
    ],
)
def test_a_joint_that_cannot_be_controlled_is_refused_by_name(tmp_path, joints, polycoef, mjcf, words):
    with pytest.raises(ModelError, match=words) as refused:
        body_of(tmp_path, mjcf.format(polycoef=polycoef, solref=""), joints)
    assert "\n" not in str(refused.value)


def test_a_joint_follows_its_tendon(tmp_path):
    finger = body_of(tmp_path, TENDON_FINGER, ("middle",), home_rad={"middle": 0.25})
    assert qpos(finger, "tip") == pytest.approx(0.2, abs=1e-9)
    finger.set_command([0.6])
    finger.advance(500 * MS)
    assert qpos(finger, "middle") == pytest.approx(0.55, abs=0.05)
    assert qpos(finger, "tip") == pytest.approx(qpos(finger, "middle") / 1.25, abs=2e-3)


def test_a_ball_joint_swings_as_a_pendulum(tmp_path):
    """Half a period is π √(l/g) at small angles, 0.25 % more at 0.2 rad; the energy does not grow."""
    body = body_of(tmp_path, BALL_PENDULUM, ("swing",))
    bob, eye = body.model.mj.body("bob").id, body.model.mj.joint("eye").qposadr[0]
    centre = 0.4**2 + 0.4 * 0.02**2
    half_s = math.pi * math.sqrt(centre / (0.4 * 9.81)) * 1.0025
    body.advance(round(half_s * 1e3) * MS)
    assert body.data.ximat[bob].reshape(3, 3)[2, 0] == pytest.approx(0.199, abs=0.01)
    assert abs(2.0 * body.data.qpos[eye + 2]) == pytest.approx(0.4, abs=0.01)
    metrics = settled(body_scenes.deployment_of((), ("swing",), servo=SERVO), tmp_path, 1_000 * MS)
    assert metrics["settle.energy_ratio"] < 1.0001
    locked = load_model(body_scenes.deployment_of((), ("swing",), servo=SERVO, locked=("eye",)), tmp_path)
    assert locked.mj.nv == 1


def test_a_closed_loop_stays_closed(tmp_path):
    loop = body_of(tmp_path, FOUR_BAR, ("crank",), home_rad={"crank": 0.4})
    coupler, rocker = (loop.model.mj.body(name).id for name in ("coupler", "rocker"))

    def gap_m():
        R_world_coupler = loop.data.xmat[coupler].reshape(3, 3)
        R_world_rocker = loop.data.xmat[rocker].reshape(3, 3)
        pin_m = loop.data.xpos[coupler] + R_world_coupler @ [0.3, 0.0, 0.0]
        return float(np.linalg.norm(pin_m - loop.data.xpos[rocker] - R_world_rocker @ [0.0, 0.0, 0.1]))

    assert gap_m() < 1e-9
    assert qpos(loop, "rocker") == pytest.approx(0.4, abs=1e-9), "a parallelogram"
    loop.set_command([0.5])
    for _ in range(20):
        loop.advance(loop.t_ns + 50 * MS)
        assert gap_m() < 1e-4
    loop.set_command([0.0])
    loop.advance(loop.t_ns + 400 * MS)
    assert qpos(loop, "crank") == pytest.approx(0.9, abs=2e-3)
    assert qpos(loop, "rocker") == pytest.approx(qpos(loop, "crank"), abs=1e-3)


def test_the_weight_of_a_loop_rests_on_its_servo(tmp_path):
    """The crank carries its own half, the coupler's whole and the rocker's half: by virtual work."""
    loop = body_of(tmp_path, FOUR_BAR, ("crank",), home_rad={"crank": 0.4})
    np.testing.assert_allclose(loop.model.joint_motion, [[1.0, -1.0, 1.0]], atol=1e-9)
    start = loop.joints()
    loop.advance(300 * MS)
    np.testing.assert_allclose(loop.joints(), start, atol=1e-4)
    load_nm = 9.81 * 0.1 * math.sin(0.4) * (0.5 * 0.2 + 0.5 + 0.5 * 0.3)
    assert loop.data.actuator_force[0] == pytest.approx(-load_nm, rel=0.01)


def test_a_home_that_no_loop_can_reach_is_refused(tmp_path):
    """The coupler is too short for the crank to go all round once the rocker stands apart."""
    apart = FOUR_BAR.replace('name="rocker" pos="0.3 0 0"', 'name="rocker" pos="0.45 0 0"')
    apart = apart.replace('body2="rocker" anchor="0.3 0 0"', 'body2="rocker" anchor="0.38 0 0"')
    with pytest.raises(ModelError, match="meets the equality constraints") as refused:
        body_of(tmp_path, apart, ("crank",), home_rad={"crank": -2.5})
    assert "\n" not in str(refused.value)


def test_a_pendulum_has_no_followers(tmp_path):
    body = body_of(tmp_path, PENDULUM.format(damping=0.0), ("swing",))
    assert body.model.joint_motion.tolist() == [[1.0]]


def test_ground_truth_knows_followers(tmp_path):
    """Skin on a finger that mimics moves with its leader; the Jacobian is that of finite differences."""
    coefficients = (0.1, -0.5, 0.3)
    mjcf = GRIPPER.format(polycoef=" ".join(map(str, coefficients)), solref=STIFF)
    cell = CellPoseSpec(position_m=(0.08, 0.0, 0.01), normal=(0, 0, 1), x_axis=(1, 0, 0))
    skin = tuple(body_scenes.patch(name, name, cell) for name in ("base", "left", "right"))
    body = body_scenes.body_of(tmp_path, mjcf, skin, ("left",), servo=SERVO)
    assert activity_matrix(body).tolist() == [[False], [True], [True]]
    set_joint_positions(body, np.array([0.4]))
    found = cell_jacobian(body)
    _, R_world_cell = cell_poses(body)
    ends_m = []
    for left in (0.4 - 1e-5, 0.4 + 1e-5):
        set_joint_positions(body, np.array([left]))
        assert qpos(body, "right") == pytest.approx(0.1 - 0.5 * left + 0.3 * left**2, abs=1e-9)
        ends_m.append(cell_poses(body)[0])
    speed_m = (ends_m[1] - ends_m[0]) / 2e-5
    expected = np.einsum("nij,ni->nj", R_world_cell, speed_m)
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-7)
    assert np.linalg.norm(found[2, 0]) > 0.02


def test_pictures_show_followers_where_they_are(tmp_path):
    body_of(tmp_path, FOUR_BAR, ("crank",))
    visual = VisualModel(body_scenes.deployment_of((), ("crank",), servo=SERVO), tmp_path)
    poses = visual.poses([0.6], {})
    np.testing.assert_allclose(poses["rocker"].wxyz, [math.cos(0.3), 0.0, math.sin(0.3), 0.0], atol=1e-9)
    np.testing.assert_allclose(poses["coupler"].wxyz, [1.0, 0.0, 0.0, 0.0], atol=1e-9)
