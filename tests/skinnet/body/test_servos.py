"""Servos by frequency and damping: the closed loop is the one that is asked for, and carries the weight."""

import math

import body_scenes
import mujoco
import numpy as np
import pytest
from joint_models import CHAIN, PENDULUM

from skinnet.body.model import load_model
from skinnet.deployment.checks.servos import check_servos
from skinnet.deployment.servo import JointServoSpec, ServoSpec
from skinnet.errors import DeploymentError

MS = 1_000_000
FREQUENCY_HZ, DAMPING = 12.0, 0.8


def model_of(folder, mjcf, joints, **body):
    (folder / "scene.xml").write_text(mjcf)
    return load_model(body_scenes.deployment_of((), joints, **body), folder)


def step_response(t_s, frequency_hz, damping):
    """Underdamped response of ẍ + 2ζω ẋ + ω² x = ω² to a unit step at 0."""
    omega = 2.0 * math.pi * frequency_hz
    slow = math.sqrt(1.0 - damping**2)
    angle = omega * slow * t_s
    decay = np.exp(-damping * omega * t_s)
    return 1.0 - decay * (np.cos(angle) + damping / slow * np.sin(angle))


def simulated_step(model, joint, step_rad=0.01, duration_s=0.2, h_s=1e-4):
    """Response of a joint, relative to a step of its servo's target, without gravity."""
    model.mj.opt.timestep, model.mj.opt.gravity[:] = h_s, 0.0
    data = mujoco.MjData(model.mj)
    data.qpos[:] = model.home_qpos
    data.ctrl[model.actuator_id] = data.qpos[model.qpos_address]
    data.ctrl[model.actuator_id[joint]] += step_rad
    response = []
    for _ in range(round(duration_s / h_s)):
        mujoco.mj_step(model.mj, data)
        response.append(data.qpos[model.qpos_address[joint]] - model.home_qpos[model.qpos_address[joint]])
    t_s = h_s * (1 + np.arange(len(response)))
    return t_s, np.array(response) / step_rad


@pytest.mark.parametrize(("damping", "own_damping"), [(0.8, 0.0), (0.3, 0.0), (0.8, 0.5)])
def test_a_joint_alone_answers_as_asked_with_its_armature_and_its_own_damping(tmp_path, damping, own_damping):
    servo = ServoSpec(frequency_hz=FREQUENCY_HZ, damping=damping)
    model = model_of(tmp_path, PENDULUM.format(damping=own_damping), ("swing",), servo=servo)
    t_s, response = simulated_step(model, 0)
    np.testing.assert_allclose(response, step_response(t_s, FREQUENCY_HZ, damping), atol=0.01)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_joint_answers_as_asked_while_the_others_are_held(tmp_path, joint):
    names = ("first", "second", "third")
    model = model_of(tmp_path, CHAIN, names, servo=ServoSpec(frequency_hz=FREQUENCY_HZ, damping=DAMPING))
    for dof in set(range(3)) - {joint}:
        model.mj.dof_armature[dof] = 1e9
    t_s, response = simulated_step(model, joint)
    np.testing.assert_allclose(response, step_response(t_s, FREQUENCY_HZ, DAMPING), atol=0.01)


def test_a_joint_is_faster_than_asked_where_the_others_give_way(tmp_path):
    """Without servos on the others it feels 1 / (M⁻¹)jj, which is at most Mjj."""
    names = ("first", "second", "third")
    model = model_of(tmp_path, CHAIN, names, servo=ServoSpec(frequency_hz=FREQUENCY_HZ, damping=0.4))
    mj, data = model.mj, mujoco.MjData(model.mj)
    data.qpos[:] = model.home_qpos
    mujoco.mj_forward(mj, data)
    inertia, rows = np.empty((3, 3)), np.eye(3)
    for row, momentum in zip(rows, inertia, strict=True):
        mujoco.mj_mulM(mj, data, momentum, row)
    np.testing.assert_allclose(
        model.gains.kp_nm_per_rad, (2 * math.pi * FREQUENCY_HZ) ** 2 * np.diag(inertia), rtol=1e-12
    )
    faster = math.sqrt(inertia[1, 1] * np.linalg.inv(inertia)[1, 1])
    assert faster > 1.1, "the joints of this arm are coupled"
    for other in (0, 2):
        mj.actuator_gainprm[other], mj.actuator_biasprm[other] = 0.0, 0.0
    t_s, response = simulated_step(model, 1, duration_s=0.03)
    expected = step_response(t_s, faster * FREQUENCY_HZ, faster * 0.4)
    np.testing.assert_allclose(response, expected, atol=0.01)


def test_the_weight_is_carried_in_every_posture(tmp_path):
    """With compensation the arm stops where its targets are; without, it sags by the change of its load."""
    gaps = {}
    for compensated in (True, False):
        servo = ServoSpec(frequency_hz=6.0, gravity_compensation=compensated)
        body = body_scenes.arm(tmp_path, servo=servo, home_rad={"lift": -0.9})
        start = body.joints()
        body.advance(300 * MS)
        np.testing.assert_allclose(body.joints(), start, atol=1e-9)
        body.set_command([0.0, 0.8])
        body.advance(1_300 * MS)
        body.set_command([0.0, 0.0])
        body.advance(2_300 * MS)
        gaps[compensated] = abs(body.joints()[1] - start[1] - 0.8)
    assert gaps[True] < 1e-6
    assert gaps[False] > 0.005


def test_the_compensation_is_an_inner_force(tmp_path):
    """A free robot falls as a stone does, whatever its servos carry."""
    free = CHAIN.replace('<body name="base" pos="0 0 1">', '<body name="base" pos="0 0 1"><freejoint/>')
    servo = ServoSpec(frequency_hz=FREQUENCY_HZ)
    body = body_scenes.body_of(tmp_path, free, (), ("first", "second", "third"), servo=servo)
    body.advance(200 * MS)
    mujoco.mj_fwdPosition(body.model.mj, body.data)
    mujoco.mj_fwdVelocity(body.model.mj, body.data)
    mujoco.mj_subtreeVel(body.model.mj, body.data)
    np.testing.assert_allclose(body.data.subtree_linvel[1], [0.0, 0.0, -9.81 * 0.2], atol=1e-6)


def test_the_compensation_stays_within_the_torque_limit(tmp_path):
    servo = ServoSpec(frequency_hz=FREQUENCY_HZ, torque_limit_nm=1.0)
    body = body_scenes.arm(tmp_path, servo=servo)
    body.advance(300 * MS)
    assert body.joints()[1] > 0.1, "2 kg at 0.25 m are more than 1 Nm"


def test_single_joints_differ(tmp_path):
    own = {
        "second": JointServoSpec(frequency_hz=20.0, speed_limit_rad_s=0.5),
        "third": JointServoSpec(kp_nm_per_rad=70.0, kv_nm_s_per_rad=2.0, torque_limit_nm=9.0),
    }
    names = ("first", "second", "third")
    common = ServoSpec(frequency_hz=10.0)
    plain = model_of(tmp_path, CHAIN, names, servo=common)
    model = model_of(tmp_path, CHAIN, names, servo=common, joint_servos=own)
    np.testing.assert_allclose(
        model.gains.kp_nm_per_rad, [plain.gains.kp_nm_per_rad[0], 4 * plain.gains.kp_nm_per_rad[1], 70.0]
    )
    assert model.gains.kv_nm_s_per_rad[2] == 2.0
    assert model.torque_range_nm.tolist() == [[-400, 400], [-400, 400], [-9, 9]]
    body = body_scenes.body_of(tmp_path, CHAIN, (), names, servo=common, joint_servos=own)
    assert not body.set_command([0.0, 0.6, 0.0])
    assert body.set_command([0.0, 0.4, 0.6])


@pytest.mark.parametrize(
    ("servo", "words"),
    [
        ({"frequency_hz": 12.0, "kp_nm_per_rad": 3000.0}, "not both"),
        ({"frequency_hz": 12.0, "kv_nm_s_per_rad": 60.0}, "not both"),
        ({"damping": 0.8}, "goes with frequency_hz only"),
    ],
)
def test_contradictory_servos_are_refused_in_one_line(servo, words):
    with pytest.raises(ValueError, match=words) as refused:
        ServoSpec(**servo)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"joint_servos": {"turm": JointServoSpec(frequency_hz=9.0)}}, r'joint_servos."turm": .* turn'),
        ({"joint_servos": {"turn": JointServoSpec(damping=0.5)}}, r'"turn": damping = 0.5: goes with'),
        (
            {
                "servo": ServoSpec(frequency_hz=9.0),
                "joint_servos": {"turn": JointServoSpec(kp_nm_per_rad=9.0)},
            },
            r'"turn": kv_nm_s_per_rad is missing',
        ),
        ({"servo": ServoSpec(frequency_hz=81.0)}, r"body.servo.frequency_hz = 81: must be at most 79.6"),
        (
            {"joint_servos": {"turn": JointServoSpec(frequency_hz=41.0)}, "timestep_ms": 2.0},
            r'body.joint_servos."turn".frequency_hz = 41: must be at most 39.8',
        ),
    ],
)
def test_servos_that_cannot_be_are_refused_by_name(body, words):
    with pytest.raises(DeploymentError, match=words):
        check_servos(body_scenes.deployment_of((), ("turn", "lift"), **body))
