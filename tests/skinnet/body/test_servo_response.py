"""Servo response: what linear dynamics and statics say is what the simulated joint does."""

import math

import body_scenes
import mujoco
import numpy as np
import pytest
from joint_models import CHAIN, PENDULUM

from skinnet.body.model import load_model
from skinnet.body.servo_response import servo_response
from skinnet.deployment.servo import JointServoSpec, ServoSpec

ROD_INERTIA = 0.5 * 0.3**2 / 3.0
"""Inertia of a thin rod of the pendulum's mass and length about its end [kg·m²]; its capsule has 3 % more."""


def response_of(folder, mjcf, joints, servo, **body):
    (folder / "scene.xml").write_text(mjcf)
    deployment = body_scenes.deployment_of((), joints, servo=servo, **body)
    model = load_model(deployment, folder)
    return model, servo_response(model, is_compensated=bool(servo.gravity_compensation))


def test_frequency_and_damping_are_those_that_were_asked_for(tmp_path):
    names = ("first", "second", "third")
    own = {"third": JointServoSpec(frequency_hz=20.0, damping=0.5)}
    servo = ServoSpec(frequency_hz=12.0, damping=0.7)
    _, response = response_of(tmp_path, CHAIN, names, servo, joint_servos=own)
    assert response.joints == names
    np.testing.assert_allclose(response.frequency_hz, [12.0, 12.0, 20.0], rtol=1e-12)
    np.testing.assert_allclose(response.damping_ratio, [0.7, 0.7, 0.5], rtol=1e-12)


@pytest.mark.parametrize("spring", [0.0, 40.0])
def test_frequency_and_damping_of_gains_are_in_closed_form(tmp_path, spring):
    """By the textbook: ω² = (kp + k) / I, ζ = (kv + d) / 2 I ω; the armature adds to the inertia."""
    mjcf = PENDULUM.format(damping=0.3).replace("armature", f'stiffness="{spring}" armature')
    servo = ServoSpec(kp_nm_per_rad=80.0, kv_nm_s_per_rad=0.5)
    _, response = response_of(tmp_path, mjcf, ("swing",), servo)
    omega = math.sqrt((80.0 + spring) / (ROD_INERTIA + 0.02))
    assert response.frequency_hz[0] == pytest.approx(omega / (2 * math.pi), rel=0.02)
    assert response.damping_ratio[0] == pytest.approx(0.8 / (2 * (ROD_INERTIA + 0.02) * omega), rel=0.02)


def test_the_deflection_by_a_push_is_that_of_the_simulation(tmp_path):
    servo = ServoSpec(frequency_hz=9.0)
    model, response = response_of(tmp_path, PENDULUM.format(damping=0.0), ("swing",), servo)
    body = body_scenes.body_of(tmp_path, PENDULUM.format(damping=0.0), (), ("swing",), servo=servo)
    box_m = model.mj.geom_aabb[1]
    end_m = np.array([0.15 + box_m[5], 0.0, box_m[3]])  # the capsule's z axis is the link's x axis
    link = model.mj.body("link").id
    force_n = 10.0 * np.array([-end_m[2], 0.0, end_m[0]]) / np.hypot(end_m[0], end_m[2])
    force = np.zeros(model.mj.nv)
    mujoco.mj_applyFT(model.mj, body.data, force_n, np.zeros(3), body.data.xpos[link] + end_m, link, force)
    body.data.qfrc_applied[:] = force
    body.advance(600_000_000)
    assert abs(body.joints()[0]) == pytest.approx(response.sag_pushed_rad[0], rel=1e-3)
    assert response.sag_pushed_rad[0] > 0.02, "a light link at 9 Hz gives way"


def test_a_load_beyond_the_torque_is_told(tmp_path):
    for limit_nm, holds, resists in ((10.0, True, True), (3.0, True, False), (0.5, False, False)):
        servo = ServoSpec(frequency_hz=12.0, torque_limit_nm=limit_nm)
        _, response = response_of(tmp_path, PENDULUM.format(damping=0.0), ("swing",), servo)
        assert response.load_nm[0] == pytest.approx(-0.5 * 9.81 * 0.15)
        assert bool(np.isfinite(response.sag_home_rad[0])) == holds
        assert bool(np.isfinite(response.sag_pushed_rad[0])) == resists
        if holds:
            assert response.sag_home_rad[0] < 1e-12
