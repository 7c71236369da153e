"""Loading models: the shipped robot is what the paper needs, and mistakes are told in one clear line."""

import math

import body_scenes
import mujoco
import numpy as np
import pytest

from skinnet.body.contact.skin_surface import hexagon_m
from skinnet.body.ground_truth.cell_kinematics import activity_matrix, cell_jacobian, cell_poses
from skinnet.deployment.environment.teacher import TouchSpec
from skinnet.deployment.robot import SwaySpec
from skinnet.errors import DeploymentError, ModelError
from skinnet.protocol.messages import STIMULUS_NAMES

DISTANCE = STIMULUS_NAMES.index("distance_m")


@pytest.fixture(scope="module")
def robot():
    body = body_scenes.hrp2()
    body.advance(200_000_000)
    body.stimulus()
    return body


def test_the_robot_has_74_cells_on_seven_bodies_and_14_dofs(robot):
    assert robot.n_cells == 74
    assert robot.n_dofs == 14
    sizes = {name: rows.stop - rows.start for name, rows in robot.cells.items()}
    assert sizes == {
        "torso": 18,
        "left_upper_arm": 10,
        "left_forearm": 12,
        "left_hand": 6,
        "right_upper_arm": 10,
        "right_forearm": 12,
        "right_hand": 6,
    }


def test_the_true_activity_is_seven_parts_with_the_torso_as_root(robot):
    """The body parts and joints of Fig. 4 [M14], as an activity matrix."""
    activity = activity_matrix(robot)
    parts = {name: activity[rows] for name, rows in robot.cells.items()}
    assert all((part == part[0]).all() for part in parts.values())
    assert not parts["torso"].any()
    for side, first in (("left", 0), ("right", 7)):
        for part, count in (("upper_arm", 3), ("forearm", 4), ("hand", 7)):
            expected = np.zeros(14, dtype=bool)
            expected[first : first + count] = True
            np.testing.assert_array_equal(parts[f"{side}_{part}"][0], expected)


def test_at_home_every_joint_axis_is_visible_to_gravity(robot):
    """|Δg| ≈ 0.1 sin β must be above 0.01 g: β > 5.7° (docs/assumptions.md); 12° keep a margin."""
    axes = robot.data.xaxis[robot.model.joint_id]
    from_gravity_deg = np.degrees(np.arccos(np.abs(axes[:, 2])))
    assert from_gravity_deg.min() > 12.0


def test_at_home_no_cell_feels_or_sees_the_robot(robot):
    stimulus = robot.stimulus()
    assert np.isinf(stimulus[:, DISTANCE]).all()
    assert not stimulus[:, :3].any()
    assert robot.data.ncon == 0


def test_cells_lie_on_the_shells_and_not_in_them(robot):
    """No corner of a cell's face, and no point of its axis, is inside a solid of its own body."""
    mj, data = robot.model.mj, robot.data
    position_m, R_world_cell = cell_poses(robot)
    for cell, owner in enumerate(robot.surface.body_id.tolist()):
        normal = R_world_cell[cell][:, 2]
        below = position_m[cell] - 0.012 * normal
        geom = np.array([-1], dtype=np.int32)
        start = below + 0.002 * normal
        depth_m = mujoco.mj_ray(mj, data, start, -normal, None, 1, -1, geom)
        assert depth_m == pytest.approx(0.002, abs=1e-4), "the surface is right below the cell"
        assert mj.geom_bodyid[geom[0]] == owner
        for corner in hexagon_m(0.014):
            rim = position_m[cell] + R_world_cell[cell][:, :2] @ corner
            outward = mujoco.mj_ray(mj, data, rim, normal, None, 1, -1, geom)
            assert outward < 0 or outward > 0.05


def test_faces_of_neighbouring_bodies_do_not_overlap(robot):
    position_m, _ = cell_poses(robot)
    gaps = np.linalg.norm(position_m[:, None] - position_m[None], axis=2)
    np.fill_diagonal(gaps, np.inf)
    assert gaps.min() > math.sqrt(3.0) * 0.014 * 0.99


def test_jacobian_equals_finite_differences(robot):
    mj, data = robot.model.mj, mujoco.MjData(robot.model.mj)
    expected = cell_jacobian(robot)
    _, R_world_cell = cell_poses(robot)
    step_rad = 1e-6

    def faces(d, shift):
        data.qpos[:] = robot.data.qpos
        data.qpos[robot.model.qpos_address[d]] += shift
        mujoco.mj_kinematics(mj, data)
        R_world_body = data.xmat[robot.surface.body_id].reshape(-1, 3, 3)
        lifted = robot.surface.position_m + 0.012 * robot.surface.R_body_cell[:, :, 2]
        return data.xpos[robot.surface.body_id] + np.einsum("nij,nj->ni", R_world_body, lifted)

    for d in range(robot.n_dofs):
        moved = (faces(d, step_rad) - faces(d, -step_rad)) / (2 * step_rad)
        in_cell = np.einsum("nji,nj->ni", R_world_cell, moved)
        np.testing.assert_allclose(expected[:, d], in_cell, atol=1e-8)
    np.testing.assert_array_equal(np.abs(expected).max(axis=2) > 1e-9, activity_matrix(robot))


def test_the_reference_sways_a_little_and_the_arms_hold_their_pose(robot):
    torso = robot.cells["torso"]
    tilts = []
    start = robot.joints()
    for _ in range(40):
        robot.advance(robot.t_ns + 100_000_000)
        gravity = robot.stimulus()[torso, 4:7].mean(axis=0)
        tilts.append(gravity / np.linalg.norm(gravity))
    swing = np.ptp(np.array(tilts), axis=0)
    assert 0.001 < swing.max() < 0.005, "amplitude 0.001 rad: well below the threshold of 0.01 g"
    np.testing.assert_allclose(robot.joints(), start, atol=2e-3)


@pytest.mark.parametrize(
    ("keys", "error", "words"),
    [
        ({"reference_body": "chest"}, ModelError, ["body.reference_body", "chest", "base", "arm"]),
        ({"model": "nowhere.xml"}, DeploymentError, ["body.model", "nowhere.xml", "hrp2_upper"]),
        ({"model": "../models/hrp2_upper"}, DeploymentError, ["body.model"]),
        ({"home_rad": {"lift": 2.0}}, DeploymentError, ["body.home_rad.lift", "2.0", "-1", "1"]),
        ({"home_rad": {"twist": 0.0}}, ModelError, ["body.home_rad", "twist"]),
        ({"body_temperature_c": {"leg": 30.0}}, ModelError, ["body.body_temperature_c", "leg"]),
        ({"sway": SwaySpec(joints=("lift",))}, DeploymentError, ["body.sway.joints", "lift", "twice"]),
    ],
)
def test_mistakes_are_told_in_one_line(tmp_path, keys, error, words):
    with pytest.raises(error) as caught:
        body_scenes.arm(tmp_path, **keys)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


BALL = '<body pos="9 0 0"><joint name="ball" type="ball"/><geom type="sphere" size="0.1"/></body>'


@pytest.mark.parametrize(
    ("joint", "words"),
    [("bend", ["body.joints", '"bend"', "turn, lift"]), ("ball", ["ball", "hinge or slide"])],
)
def test_unknown_and_unsuitable_joints_are_named(tmp_path, joint, words):
    mjcf = body_scenes.ARM.format(more=BALL, sensors="")
    with pytest.raises(ModelError) as caught:
        body_scenes.body_of(
            tmp_path, mjcf, (body_scenes.patch("skin", "arm", *body_scenes.ARM_CELLS),), ("turn", joint)
        )
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "mjcf",
    ["<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "<mujoco><wrldbody/></mujoco>", "<muj"],
)
def test_mjcf_that_does_not_compile_is_named_with_mujocos_words(tmp_path, mjcf):
    with pytest.raises(ModelError) as caught:
        body_scenes.body_of(tmp_path, mjcf, (body_scenes.lattice_patch("skin", "base", 1, 1),), ("turn",))
    assert str(tmp_path / "scene.xml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_height_fields_cannot_be_felt_and_that_is_said(tmp_path):
    mjcf = body_scenes.ARM.format(more='<geom name="hills" type="hfield" hfield="h"/>', sensors="")
    hills = '<asset><hfield name="h" nrow="4" ncol="4" size="1 1 1 1"/></asset>'
    mjcf = mjcf.replace("<worldbody>", f"{hills}<worldbody>")
    with pytest.raises(ModelError, match=r"hills.*hfield.*leave_out.*visual"):
        body_scenes.body_of(
            tmp_path, mjcf, (body_scenes.patch("skin", "arm", *body_scenes.ARM_CELLS),), ("turn",)
        )


def test_patches_and_touches_that_do_not_exist_are_named(tmp_path):
    mjcf = body_scenes.ARM.format(more="", sensors="")
    with pytest.raises(ModelError, match=r'patches.skin.body = "leg".*base, arm'):
        body_scenes.body_of(
            tmp_path, mjcf, (body_scenes.patch("skin", "leg", *body_scenes.ARM_CELLS),), ("turn",)
        )
    for cell, told in (("skin/3", "cells 0 to 2"), ("belly/0", "skin")):
        touch = TouchSpec(cell=cell, stage="guide", start_s=0.0, depth_m=0.001)
        with pytest.raises(DeploymentError, match=told):
            body_scenes.arm(tmp_path, touches=(touch,))


def test_a_models_own_actuators_and_keyframes_give_way(tmp_path):
    mjcf = body_scenes.ARM.format(
        more="",
        sensors='<actuator><motor joint="lift"/></actuator><keyframe><key qpos="0 0" ctrl="1"/></keyframe>',
    )
    body = body_scenes.body_of(
        tmp_path, mjcf, (body_scenes.patch("skin", "arm", *body_scenes.ARM_CELLS),), ("turn", "lift")
    )
    assert body.model.mj.nu == 2
    assert body.model.mj.nkey == 0
