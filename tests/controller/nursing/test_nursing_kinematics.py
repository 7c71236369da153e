"""The controller's own model and where contacts are on it, against finite differences and exact surfaces."""

import mujoco
import numpy as np
import pytest
from nursing_robot import FOUR, JOINTS, PITCH_M, POSE, Floats, kinematics, model, sheets, touch
from scipy.spatial.transform import Rotation

from controller.nursing.contacts.contact_frames import Sheet, initial_contacts
from controller.nursing.kinematics.robot_model import Kinematics, ModelErrors, SurfacePoint, draw_model_errors
from skinnet.deployment.skin.sheets import SheetSpec, SurfaceSpec
from skinnet.errors import ModelError
from skinnet.skin.tactile_sheets import place_sheets

ALL = (*JOINTS, "cart_x", "cart_yaw")
TILTED = Rotation.from_rotvec((0.3, -0.5, 0.8)).as_matrix()
POINT = SurfacePoint("left_forearm", np.array([-0.05, -0.12, 0.02]), TILTED)
RIGHT = SurfacePoint("right_upper_arm", np.array([0.05, -0.10, 0.01]), np.eye(3))


def some_pose(n: int) -> Floats:
    return np.random.default_rng(5).uniform(-0.7, 0.7, n)


def test_jacobians_are_the_derivatives_of_position_and_rotation() -> None:
    robot = kinematics(ALL)
    q, h = some_pose(len(ALL)), 1e-6
    poses = robot.surface_poses(q, (POINT, RIGHT))
    for j in range(len(ALL)):
        dq = h * np.eye(len(ALL))[j]
        ahead, behind = (
            robot.surface_poses(q + dq, (POINT, RIGHT)),
            robot.surface_poses(q - dq, (POINT, RIGHT)),
        )
        velocity = (ahead.position_m - behind.position_m) / (2 * h)
        np.testing.assert_allclose(poses.J_x[:, :, j], velocity, atol=1e-9)
        turn = ahead.R_world_surface @ behind.R_world_surface.transpose(0, 2, 1)
        np.testing.assert_allclose(
            poses.J_w[:, :, j], Rotation.from_matrix(turn).as_rotvec() / (2 * h), atol=1e-9
        )
    assert np.abs(poses.J_x).max() > 0.3
    assert (poses.J_x[0, :, : len(JOINTS) // 2 - 1] == 0.0).all()  # the right arm does not move the left one


def test_forward_kinematics_agrees_with_a_chain_written_by_hand() -> None:
    q = some_pose(len(JOINTS))
    named = dict(zip(JOINTS, q, strict=True))

    def turn(axis: str, joint: str) -> Rotation:
        return Rotation.from_euler(axis, named[joint])

    waist = turn("z", "waist_yaw") * turn("x", "waist_pitch")
    upper = waist * turn("x", "left_shoulder_pitch") * turn("z", "left_shoulder_yaw")
    upper *= turn("y", "left_shoulder_roll")
    fore = upper * turn("z", "left_elbow_bend") * turn("y", "left_elbow_roll")
    position_m = np.array([0, 0, 0.7]) + waist.apply([0.22, 0, 0.45]) + upper.apply([0, -0.28, 0])
    poses = kinematics().surface_poses(q, (POINT,))
    np.testing.assert_allclose(poses.position_m[0], position_m + fore.apply(POINT.position_m), atol=1e-12)
    np.testing.assert_allclose(poses.R_world_surface[0], fore.as_matrix() @ TILTED, atol=1e-12)


def test_joint_offsets_and_displaced_links_are_those_of_a_robot_built_so() -> None:
    errors = ModelErrors({"left_elbow_bend": 0.02}, {"left_forearm": (0.003, -0.002, 0.001)})
    built = model()
    built.body("left_forearm").pos += (0.003, -0.002, 0.001)
    given = model()
    wrong, right = Kinematics(given, JOINTS, errors), Kinematics(built, JOINTS)
    shifted = POSE + 0.02 * np.array([name == "left_elbow_bend" for name in JOINTS])
    for found, due in zip(
        wrong.surface_poses(POSE, (POINT, RIGHT)), right.surface_poses(shifted, (POINT, RIGHT)), strict=True
    ):
        np.testing.assert_allclose(found, due, atol=1e-14)
    elbow = JOINTS.index("left_elbow_bend")
    assert wrong.joint_range[elbow].tolist() == pytest.approx(
        [-2.22, 2.18]
    )  # readings at the joint's true limits
    assert given.body("left_forearm").pos.tolist() == model().body("left_forearm").pos.tolist()


def test_drawn_errors_have_their_sigma_and_one_joint_more_shifts_no_other() -> None:
    robot = kinematics()
    drawn = [draw_model_errors(seed, robot, np.radians(0.5), 0.003) for seed in range(1, 60)]
    offsets = np.array([list(errors.joint_offset_rad.values()) for errors in drawn])
    links = np.array([list(errors.link_offset_m.values()) for errors in drawn])
    assert offsets.shape == (59, 12)
    assert links.shape == (59, 7, 3)  # torso, and upper arm, forearm and hand of two arms; no object, no cart
    assert np.degrees(offsets.std()) == pytest.approx(0.5, rel=0.1)
    assert links.std() == pytest.approx(0.003, rel=0.1)
    more = draw_model_errors(7, kinematics(("cart_yaw", *JOINTS)), np.radians(0.5), 0.003)
    less = draw_model_errors(7, robot, np.radians(0.5), 0.003)
    assert {name: more.joint_offset_rad[name] for name in JOINTS} == less.joint_offset_rad
    assert less.link_offset_m.items() <= more.link_offset_m.items()


def test_joints_that_take_no_part_stay_at_home() -> None:
    home = model().qpos0.copy()
    mj = model()
    home[mj.joint("cart_yaw").qposadr[0]] = 0.5
    at_home = Kinematics(mj, JOINTS, home_qpos=home).surface_poses(POSE, (POINT,))
    with_cart = kinematics((*JOINTS, "cart_yaw")).surface_poses(np.append(POSE, 0.5), (POINT,))
    np.testing.assert_allclose(at_home.position_m, with_cart.position_m, atol=1e-14)
    np.testing.assert_allclose(at_home.J_x, with_cart.J_x[:, :, :-1], atol=1e-14)


@pytest.mark.parametrize(
    ("joints", "errors", "word"),
    [
        (("left_knee",), ModelErrors(), "left_knee"),
        (("object",), ModelErrors(), "object"),
        (("waist_yaw", "waist_yaw"), ModelErrors(), "duplicate"),
        (("waist_yaw",), ModelErrors(link_offset_m={"tail": (0, 0, 0)}), "tail"),
        (("waist_yaw",), ModelErrors(joint_offset_rad={"cart_yaw": 0.1}), "cart_yaw"),
    ],
)
def test_what_the_model_does_not_have_is_refused_by_name(
    joints: tuple[str, ...], errors: ModelErrors, word: str
) -> None:
    with pytest.raises(ModelError, match=word):
        Kinematics(model(), joints, errors)
    assert not kinematics().has_body("tail")
    with pytest.raises(ModelError, match="tail"):
        kinematics().surface_poses(POSE, (SurfacePoint("tail", np.zeros(3), np.eye(3)),))


RADIUS_M = 0.06


def around(xi_m: Floats) -> tuple[Floats, Floats]:
    """A cylinder about y: ξ1 along -y, ξ2 around it; exact place and frame."""
    angle = xi_m[:, 1] / RADIUS_M
    zero, one = np.zeros(len(xi_m)), np.ones(len(xi_m))
    normal = np.stack((np.sin(angle), zero, np.cos(angle)), axis=1)
    e1 = np.stack((zero, -one, zero), axis=1)
    place = RADIUS_M * normal + xi_m[:, :1] * e1
    return place, np.stack((e1, np.cross(normal, e1), normal), axis=2)


def bent_sheet(keep: slice = slice(None)) -> Sheet:
    index = (np.arange(8) - 3.5) * PITCH_M
    xi_m = np.array([(a, b) for a in index for b in index])[keep]
    return Sheet("left_forearm", xi_m, *around(xi_m), PITCH_M)


def test_a_bent_sheet_is_known_between_its_elements_too() -> None:
    sheet = bent_sheet()
    xi_m = np.random.default_rng(3).uniform(-3.5 * PITCH_M, 3.5 * PITCH_M, (200, 2))
    place, R = around(xi_m)
    chord_m = RADIUS_M * (1 - np.cos(0.5 * PITCH_M / RADIUS_M))  # what straight interpolation is off
    for n in range(len(xi_m)):
        point = sheet.surface_point(xi_m[n])
        assert np.linalg.norm(point.position_m - place[n]) < 0.04 * chord_m  # 40 µm
        assert Rotation.from_matrix(point.R_body_surface.T @ R[n]).magnitude() < 1e-3
        np.testing.assert_allclose(np.linalg.det(point.R_body_surface), 1.0, atol=1e-12)


def test_elements_are_met_exactly_and_rims_and_gaps_are_continued() -> None:
    whole, comb = bent_sheet(), bent_sheet(slice(None, None, 3))
    element, rim = np.array([[1.5, 0.5]]) * PITCH_M, np.array([[0.3, 4.0]]) * PITCH_M
    for xi_m, tolerance_m in ((element, 1e-15), (rim, 3e-3)):
        np.testing.assert_allclose(
            whole.surface_point(xi_m[0]).position_m, around(xi_m)[0][0], atol=tolerance_m
        )
    for xi_m in np.random.default_rng(4).uniform(-3 * PITCH_M, 3 * PITCH_M, (100, 2)):
        place = around(xi_m[None])[0][0]
        assert np.linalg.norm(comb.surface_point(xi_m).position_m - place) < 5e-4
    with pytest.raises(ValueError, match="not on the sheet of left_forearm"):
        whole.surface_point((0.0, 6.0 * PITCH_M))
    with pytest.raises(ValueError, match="not on the sheet"):
        whole.surface_point((np.nan, 0.0))
    with pytest.raises(ValueError, match="expected"):
        Sheet("left_forearm", np.zeros((2, 2)), np.zeros((3, 3)), np.zeros((2, 3, 3)), PITCH_M)


def test_a_placed_sheet_is_met_where_its_surface_is() -> None:
    """The sheets of the skin, semi-flat and cut like a comb: elements as the controller reads them."""
    surface = SurfaceSpec(
        name="s", body="left_forearm", origin_m=(-0.05, -0.15, 0.0),
        normal=(-1.0, 0.0, 0.0), up=(0.0, -1.0, 0.0), radius_m=0.05, flat_m=0.06,
    )  # fmt: skip
    mask = ("######..", "########", "##.##.##", "##.##.##", "########")
    spec = SheetSpec(name="left", surface="s", columns=8, rows=5, mask=mask)
    (placed,) = place_sheets([surface], [spec])
    sheet = Sheet(placed.surface.body, placed.xi_m, placed.position_m, placed.R_body_element, spec.pitch_m)
    for xi_m in np.random.default_rng(6).uniform((-0.07, -0.04), (0.02, 0.04), (60, 2)):
        place_m, R = placed.surface.frame_at(xi_m)
        point = sheet.surface_point(xi_m)
        assert np.linalg.norm(point.position_m - place_m) < 5e-4
        # the middle of a gap where flat goes over into round turns by so much too early
        assert Rotation.from_matrix(point.R_body_surface.T @ R).magnitude() < 0.2


def test_initial_contacts_are_relative_to_their_middle_and_face_each_other() -> None:
    robot, known = kinematics(), sheets()
    contacts = initial_contacts(robot, POSE, known, [touch(name) for name in FOUR])
    np.testing.assert_allclose(contacts.x_object_contact_m.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        contacts.x_object_contact_m + contacts.object_centre_m,
        robot.surface_poses(POSE, contacts.points).position_m,
    )
    outward = contacts.R_object_contact[:, :, 2]
    assert outward[0, 0] > 0 > outward[1, 0]  # right arm faces left, left arm right
    np.testing.assert_allclose(outward[:2] * (-1, 1, 1), outward[1::-1], atol=1e-12)
    given = initial_contacts(robot, POSE, known, [touch("left_forearm")], (0.0, -0.5, 0.9))
    assert given.object_centre_m.tolist() == [0.0, -0.5, 0.9]
    twice = initial_contacts(robot, POSE, known, [touch("left_forearm"), touch("left_forearm", number=4)])
    assert twice.names == ("left_forearm.1", "left_forearm.4")
    assert contacts.names == FOUR
    with pytest.raises(ValueError, match="no contact"):
        initial_contacts(robot, POSE, known, [])


def test_mujoco_copies_stay_apart() -> None:
    """Two kinematics of one model, one with errors, do not see each other."""
    mj: mujoco.MjModel = model()
    right = Kinematics(mj, JOINTS)
    before = right.surface_poses(POSE, (POINT,)).position_m
    Kinematics(mj, JOINTS, ModelErrors(link_offset_m={"torso": (0.1, 0.0, 0.0)})).surface_poses(
        -POSE, (POINT,)
    )
    np.testing.assert_array_equal(right.surface_poses(POSE, (POINT,)).position_m, before)
