"""Velocities from outside: on top of the controller's own, if let, while fresh, never past the clamp."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from locations import SHIPPED_DEPLOYMENTS
from wired_controller import TICK_NS, Wired

from skinnet.deployment import load
from skinnet.deployment.checks import check
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.protocol.external_messages import ExternalVelocity

FRESH_TICKS = 100_000_000 // TICK_NS


def resting(**more: bool) -> Wired:
    """A robot that listens: it moves by itself for nothing."""
    return Wired("listen", **({"external_velocity": True} | more))


def test_a_velocity_moves_the_robot_while_it_is_fresh() -> None:
    robot = resting()
    assert robot.step().velocity_rad_s == [0.0, 0.0]
    robot.accept("velocity", ExternalVelocity(velocity_rad_s=[0.25, -0.5]))
    moved = [robot.step().velocity_rad_s for _ in range(FRESH_TICKS + 10)]
    assert moved[:FRESH_TICKS] == [[0.25, -0.5]] * FRESH_TICKS
    assert moved[FRESH_TICKS:] == [[0.0, 0.0]] * 10
    assert robot.node.counters["external_velocities"] == 1


def test_it_comes_on_top_of_the_program() -> None:
    alone, pushed = Wired("bow"), Wired("bow", external_velocity=True)
    pushed.accept("velocity", ExternalVelocity(velocity_rad_s=[0.05, 0.0]))
    for robot in (alone, pushed):
        robot.step()
    difference = np.subtract(pushed.step().velocity_rad_s, alone.step().velocity_rad_s)
    # what it was pushed in the tick before, the program takes back in part
    assert 0.0 < difference[0] <= 0.05
    assert difference[1] == 0.0


@given(st.lists(st.floats(-1e300, 1e300), min_size=2, max_size=2))
def test_the_clamp_has_the_last_word(velocity: list[float]) -> None:
    robot = resting()
    robot.step()
    robot.accept("velocity", ExternalVelocity(velocity_rad_s=velocity))
    for _ in range(3):
        assert np.abs(robot.step().velocity_rad_s).max() <= 1.2


@pytest.mark.parametrize(
    "wrong", [[0.1], [0.1, 0.1, 0.1], [], [0.1, float("nan")], [float("inf"), 0.0], [0.0, -float("inf")]]
)
def test_what_makes_no_sense_stops_the_robot(wrong: list[float]) -> None:
    robot = resting()
    robot.step()
    robot.accept("velocity", ExternalVelocity(velocity_rad_s=[0.25, -0.5]))
    assert robot.step().velocity_rad_s == [0.25, -0.5]
    with pytest.raises(ProtocolError, match=r"external velocity has|velocities are not finite"):
        robot.accept("velocity", ExternalVelocity(velocity_rad_s=wrong))
    assert robot.step().velocity_rad_s == [0.0, 0.0]
    assert robot.node.counters["external_velocities"] == 1


def test_a_message_that_is_none_stops_the_robot() -> None:
    robot = resting()
    robot.step()
    robot.accept("velocity", ExternalVelocity(velocity_rad_s=[0.25, -0.5]))
    with pytest.raises(ProtocolError, match="not a ExternalVelocity"):
        robot.node.accept("velocity", (), b"garbage")
    assert robot.step().velocity_rad_s == [0.0, 0.0]


def test_a_run_takes_none_unless_it_is_let() -> None:
    robot = resting(external_velocity=False)
    robot.step()
    with pytest.raises(ProtocolError, match=r"controller\.external_velocity=true"):
        robot.accept("velocity", ExternalVelocity(velocity_rad_s=[0.25, -0.5]))
    assert robot.step().velocity_rad_s == [0.0, 0.0]
    assert not robot.node.counters


def test_nothing_moves_before_the_skin_is_there() -> None:
    robot = Wired("listen", here=("arm",), lost=False, external_velocity=True)
    robot.node.upstreams["hand"].watermark_ns = 2**62
    robot.accept("velocity", ExternalVelocity(velocity_rad_s=[0.25, -0.5]))
    assert robot.step().velocity_rad_s == [0.0, 0.0]


def test_it_is_part_of_the_log() -> None:
    """Runs that nobody touched have the log they had; others have one that tells the difference."""
    alone, let, pushed = resting(external_velocity=False), resting(), resting()
    pushed.accept("velocity", ExternalVelocity(velocity_rad_s=[0.0, 0.0]))
    logs = []
    for robot in (alone, let, pushed):
        for _ in range(5):
            robot.step()
        logs.append(robot.result.facts["logs"]["controller"])
    assert logs[0] == logs[1] != logs[2]


def test_nursing_takes_none() -> None:
    file = next(file for file in SHIPPED_DEPLOYMENTS if file.stem == "riba_cylinder")
    deployment = load(file, ("controller.external_velocity=true",))
    with pytest.raises(DeploymentError, match="the nursing program accepts no external velocities"):
        check(deployment)
