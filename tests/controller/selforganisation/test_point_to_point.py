"""Point-to-point motion: it arrives on any servo that comes to rest by itself, and makes none oscillate."""

import math
from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from controller.selforganisation.exploration import MotionState, PointToPoint, PositionControl

TICK_S = 0.005
TICK_NS = 5_000_000
SUBSTEPS = 5


class Servo:
    """Servo q̈ = ω²(target − q) − 2ζω q̇ + load, whose target integrates commands that come late."""

    def __init__(self, omega: float, zeta: float, delay_ticks: int, sag_rad: float = 0.0) -> None:
        self.omega, self.zeta, self.sag_rad = omega, zeta, sag_rad
        self.q = self.v = self.target = 0.0
        self.commands = deque([0.0] * delay_ticks)
        self.transition = expm(
            np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]]) * TICK_S / SUBSTEPS
        ).tolist()

    def tick(self, velocity: float) -> float:
        """Exact solution over each substep of a tick, for a target that moves at the velocity that is due."""
        self.commands.append(velocity)
        due = self.commands.popleft()
        (a, b), (c, d) = self.transition
        for _ in range(SUBSTEPS):
            self.target += due * TICK_S / SUBSTEPS
            rest = self.target - self.sag_rad
            off = self.q - rest
            self.q, self.v = rest + a * off + b * self.v, c * off + d * self.v
        return self.q


def decay_1_s(omega: float, zeta: float) -> float:
    """Rate at which a deflection of a servo decays."""
    return zeta * omega if zeta <= 1.0 else omega * (zeta - math.sqrt(zeta**2 - 1.0))


def test_a_loop_closed_at_every_tick_oscillates_where_the_servo_is_slow() -> None:
    """Why the motion is open loop: K = 15 /s exceeds 2ζω of a heavy joint (kp 3000, kv 60, M 4.4 kg m²)."""
    servo = Servo(math.sqrt(3000.0 / 4.4), 60.0 / (2.0 * math.sqrt(3000.0 * 4.4)), delay_ticks=1)
    q, swing = 0.0, []
    for _ in range(2000):
        q = servo.tick(float(np.clip(15.0 * (0.1 - q), -1.0, 1.0)))
        swing.append(q)
    assert np.ptp(swing[-400:]) > 0.05


@settings(max_examples=25, deadline=None)
@given(
    omega=st.floats(10.0, 300.0),
    zeta=st.floats(0.05, 2.0),
    delay_ticks=st.integers(0, 16),
    sag_rad=st.floats(-0.02, 0.02),
    step_rad=st.sampled_from((0.1, -0.3)),
)
def test_it_arrives_on_any_servo_and_then_commands_nothing(
    omega: float, zeta: float, delay_ticks: int, sag_rad: float, step_rad: float
) -> None:
    servo = Servo(omega, zeta, delay_ticks)
    config = PositionControl(delay_ns=(delay_ticks + 1) * TICK_NS)
    motion = PointToPoint(config, 1)
    target = np.array([step_rad])
    wait_s = 2.0 + 30.0 / decay_1_s(omega, zeta)
    q, errors, commands = 0.0, [], []
    for tick in range(round(wait_s / TICK_S)):
        if motion.state is MotionState.ARRIVED and tick > 400 and not any(commands[-200:]):
            break
        if tick == 1:
            motion.begin(target)
            servo.sag_rad = sag_rad  # the new posture bends the servo
        velocity = float(motion.velocity(tick * TICK_NS, np.array([q]))[0])
        assert abs(velocity) <= config.speed_rad_s + 1e-12
        commands.append(velocity)
        q = servo.tick(velocity)
        errors.append(q - step_rad)
    assert motion.state is MotionState.ARRIVED
    # what may still come when the speed is below that of rest
    creep_rad = config.rest_rad / (config.rest_ns * 1e-9) / decay_1_s(omega, zeta)
    assert abs(errors[-1]) <= config.tolerance_rad + creep_rad
    assert not any(commands[-round(config.rest_ns / TICK_NS) :])
    # never farther out than one step's own overshoot: the motion adds no energy of its own
    assert max(map(abs, errors)) <= abs(step_rad) + 2.0 * abs(sag_rad) + 1e-9
    bursts = sum(1 for a, b in pairwise(commands) if b and not a)
    assert bursts <= 3


def test_a_servo_that_never_rests_is_not_commanded() -> None:
    motion = PointToPoint(PositionControl(), 2)
    for tick in range(400):
        q = np.array([0.0, 0.01 * math.sin(30.0 * tick * TICK_S)])
        assert not motion.velocity(tick * TICK_NS, q).any()
    assert motion.state is MotionState.SETTLING
    assert motion.restless().tolist() == [1]


def test_a_blocked_joint_is_pushed_twice_and_then_left() -> None:
    motion, commanded_rad = PointToPoint(PositionControl(), 2), np.zeros(2)
    blocked = np.zeros(2)
    for tick in range(600):
        if tick == 1:
            motion.begin(np.array([0.1, 0.0]))
        commanded_rad += motion.velocity(tick * TICK_NS, blocked) * TICK_S
    assert motion.state is MotionState.STUCK
    assert motion.behind(blocked).tolist() == [0]
    np.testing.assert_allclose(commanded_rad, [0.2, 0.0])


@pytest.mark.parametrize("speed_rad_s", [0.37, 1.0])
def test_a_displacement_is_commanded_exactly_and_at_most_at_its_speed(speed_rad_s: float) -> None:
    motion = PointToPoint(PositionControl(speed_rad_s=speed_rad_s), 2)
    q = np.zeros(2)
    for tick in range(100):
        if tick == 1:
            motion.begin(np.array([0.1, -0.05]))
        velocity = motion.velocity(tick * TICK_NS, q)
        assert np.abs(velocity).max() <= speed_rad_s
        q = q + velocity * TICK_S
    np.testing.assert_allclose(q, [0.1, -0.05], atol=1e-12)
    assert motion.state is MotionState.ARRIVED
