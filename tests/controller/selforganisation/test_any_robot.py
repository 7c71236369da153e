"""Explorations on simulated robots of one trait each: they find the truth, and stay clear of harm."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exploring import ExploredRobot, deployment_of

from controller.self_model import SelfModel
from controller.selforganisation.sensory_motor_map import compare_maps, fuse_with_activity, normal_weights
from skinnet.body.ground_truth.cell_kinematics import activity_matrix, cell_jacobian, set_joint_positions


def ring(z_m: float, radius_m: float = 0.04) -> list[Any]:
    """Three cells around the z axis of a link, at the height `z_m`."""
    return [
        ((x * radius_m, y * radius_m, z_m + dz), (x, y, 0.0), (-y, x, 0.0))
        for x, y, dz in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.02), (-0.8, -0.6, -0.02))
    ]


def link(name: str, joint: str, inside: str = "", *, pos: str = "0 0 .25", more: str = "") -> str:
    """A link of 250 mm along z with a joint at its begin."""
    return (
        f'<body name="{name}" pos="{pos}"><joint name="{name}_joint" {joint}/>'
        f'<geom type="cylinder" size=".04 .1" pos="0 0 .13" mass="1"/>{more}{inside}</body>'
    )


def robot(inside: str, more: str = "") -> str:
    """A base at rest with links on it."""
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body name="base">'
        f'<geom type="box" size=".06 .06 .1" pos="0 0 .1" mass="5"/>{inside}</body></worldbody>'
        f"{more}</mujoco>"
    )


def explored(folder: Path, mjcf: str, body: dict[str, Any], cells: dict[str, list[Any]]) -> ExploredRobot:
    on_base = [((0.06, y, 0.1), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) for y in (-0.03, 0.03)]
    return ExploredRobot(deployment_of(folder, mjcf, body, {"base": on_base} | cells), folder)


def agrees(one: ExploredRobot, **structure: Any) -> SelfModel:
    """The self-model of a robot, after the map has agreed with the truth."""
    knowledge = SelfModel(min_row_norm=0.05, min_lever_m=0.005, dof_names=one.deployment.body.joints)
    knowledge.structure, _ = one.structure(**structure)
    found, _ = one.deflections(tilt_frequency_hz=2.0, periods=2)
    knowledge.add_map(found)
    set_joint_positions(one.body, found.pose_rad)
    truth = fuse_with_activity(activity_matrix(one.body), normal_weights(cell_jacobian(one.body)), 0.05)
    agreement = compare_maps(knowledge.sensory_motor_map.weights[0], truth)
    assert agreement.n_entries >= 8
    assert agreement.sign_fraction >= 0.97
    return knowledge


def test_an_arm_on_a_vertical_axis_with_a_bare_link_and_a_light_wrist(tmp_path: Path) -> None:
    wrist = link("hand", 'axis="0 0 1"', more="").replace('mass="1"', 'mass=".001"')
    bare = link("bare", 'axis="1 0 0"', wrist)
    mjcf = robot(link("upper", 'axis="0 0 1"', link("fore", 'axis="0 1 0"', bare), pos="0 0 .2"))
    joints = ["upper_joint", "fore_joint", "bare_joint", "hand_joint"]
    home = {"fore_joint": 0.6, "bare_joint": 0.5, "hand_joint": 0.3}
    one = explored(
        tmp_path, mjcf, {"joints": joints, "home_rad": home},
        {"upper": ring(0.1), "fore": ring(0.1), "hand": ring(0.15)},
    )  # fmt: skip
    structure, _ = one.structure()
    assert structure.untold.tolist() == [True, False, False, False]
    assert structure.problems == (
        "DoF upper_joint moves no cell: no skin distal to it, or its axis is parallel to gravity",
    )
    knowledge = agrees(one)
    assert knowledge.structure is not None
    assert knowledge.structure.problems == ()
    assert (knowledge.structure.activity == activity_matrix(one.body)).all()
    assert knowledge.structure.joints == (
        (0,),
        (1,),
        (2, 3),
    )  # nothing tells the two beyond the bare link apart


def test_a_follower_moves_with_its_joint(tmp_path: Path) -> None:
    fingers = link("left", 'axis="1 0 0"', pos="0 .08 .25") + link("right", 'axis="1 0 0"', pos="0 -.08 .25")
    mimic = '<equality><joint joint1="right_joint" joint2="left_joint" polycoef="0 -1 0 0 0"/></equality>'
    mjcf = robot(link("palm", 'axis="0 1 0"', fingers, pos="0 0 .2"), mimic)
    one = explored(
        tmp_path, mjcf, {"joints": ["palm_joint", "left_joint"], "home_rad": {"palm_joint": 0.5}},
        {"palm": ring(0.1), "left": ring(0.15), "right": ring(0.15)},
    )  # fmt: skip
    knowledge = agrees(one)
    assert knowledge.structure is not None
    assert knowledge.structure.problems == ()
    assert (knowledge.structure.activity == activity_matrix(one.body)).all()
    assert knowledge.structure.activity[-3:].all()  # the right finger, by a joint that is not controlled
    assert knowledge.structure.parts == ((0, 1), (2, 3, 4), (5, 6, 7, 8, 9, 10))


def test_motion_stays_within_the_limits(tmp_path: Path) -> None:
    ranges = {"upper": (-1.0, 0.5), "fore": (-0.5, 1.0), "hand": (-0.005, 0.005)}
    arm = ""
    for name, (low, high) in reversed(ranges.items()):
        joint = (
            f'axis="{0 if name == "fore" else 1} {int(name == "fore")} 0" range="{low} {high}" limited="true"'
        )
        arm = link(name, joint, arm, pos="0 0 .2" if name == "upper" else "0 0 .25")
    home = {"upper_joint": 0.5, "fore_joint": -0.5}
    one = explored(
        tmp_path, robot(arm), {"joints": [f"{name}_joint" for name in ranges], "home_rad": home},
        {name: ring(0.12) for name in ranges},
    )  # fmt: skip
    structure, watch = one.structure()
    found, shaken = one.deflections()
    limits_rad = np.array(list(ranges.values())).T
    for extremes_rad in (watch.extremes_rad, shaken.extremes_rad):
        assert (extremes_rad[0] > limits_rad[0] - 0.004).all()  # servos sag a little
        assert (extremes_rad[1] < limits_rad[1] + 0.004).all()
    assert watch.extremes_rad[0, 0] < 0.41  # away from the upper limit
    assert watch.extremes_rad[1, 1] > -0.41
    assert structure.problems[0] == (
        "DoF hand_joint was not stepped: no room for a step of 0.1 rad within its limits"
    )
    assert (structure.activity[:, :2] == activity_matrix(one.body)[:, :2]).all()
    assert structure.untold.tolist() == [False, False, True]
    assert found.problems == (
        "DoF hand_joint was not moved: its limits leave no room for its sine of 4.0 Hz",
    )


def folded(folder: Path, wall: str) -> ExploredRobot:
    """An elbow whose forearm is near its own pillar, on the side to which its joint steps first."""
    fore = link(
        "fore",
        'axis="0 1 0"',
        pos="0 0 .2",
        more='<geom type="box" size=".02 .03 .03" pos="0 0 .27" mass=".1"/>',
    )
    cells = [((0.04, y, z), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) for y in (-0.02, 0.02) for z in (0.16, 0.2)]
    cells += [((-0.04, 0.0, 0.18), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    return explored(folder, robot(fore + wall), {"joints": ["fore_joint"]}, {"fore": cells})


PILLAR = '<geom type="box" size=".01 .1 .3" pos="{x} 0 .3"/>'


def test_a_step_turns_back_from_the_own_body(tmp_path: Path) -> None:
    one = folded(tmp_path, PILLAR.format(x=0.115))
    structure, watch = one.structure(step_rad=0.4)
    assert structure.problems == ()
    assert (structure.activity == activity_matrix(one.body)).all()
    assert watch.contacts == set()
    assert watch.extremes_rad[0, 0] < -0.35  # to the other side
    found, _ = one.deflections()
    assert found.problems == ()


def test_a_step_between_two_walls_is_named(tmp_path: Path) -> None:
    one = folded(tmp_path, PILLAR.format(x=0.115) + PILLAR.format(x=-0.115))
    structure, watch = one.structure(step_rad=0.4)
    assert watch.contacts == set()
    assert structure.untold.tolist() == [True]
    assert structure.problems[0].startswith(
        "DoF fore_joint did not complete its step in run 1: something touched or came near cell"
    )
    found, shaken = one.deflections()
    assert shaken.contacts == set()
    knowledge = SelfModel(min_row_norm=0.05, min_lever_m=0.005, structure=structure)
    knowledge.add_map(found)  # the small sines have room, and tell what the step could not
    assert knowledge.structure is not None
    assert (knowledge.structure.activity == activity_matrix(one.body)).all()


def test_without_readings_the_step_would_meet_the_body(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = folded(tmp_path, PILLAR.format(x=0.115))
    monkeypatch.setattr("controller.selforganisation.touch_guard.TouchGuard.add", lambda *_: None)
    _, watch = one.structure(step_rad=0.4)
    assert watch.contacts == {frozenset({"base", "fore"})}
