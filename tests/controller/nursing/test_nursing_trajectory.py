"""Trajectory generation: the equations one by one, the quadratic programme beside, and experiment A [R11]."""

import itertools

import numpy as np
import pytest
from nursing_robot import FOUR, JOINTS, POSE, Floats, kinematics, sheets, touch
from scipy.spatial.transform import Rotation

from controller.nursing.contacts.contact_frames import InitialContacts, initial_contacts
from controller.nursing.kinematics.joint_limits import JointLimits
from controller.nursing.kinematics.mobility import mobility
from controller.nursing.kinematics.robot_model import Kinematics, Poses
from controller.nursing.object_trajectory import ObjectTrajectory, Waypoint
from controller.nursing.quadratic_programme import quadratic_programme
from controller.nursing.trajectory_generation import (
    Deviations,
    LeastSquaresProblem,
    Solver,
    TrajectoryGenerator,
    Weights,
    closed_form,
    desired_contacts,
    deviations,
)

PERIOD_S = 0.01
S = 1_000_000_000


def contacts_of(robot: Kinematics, q: Floats, names: tuple[str, ...] = FOUR) -> InitialContacts:
    return initial_contacts(robot, q, sheets(), [touch(name) for name in names])


def free(robot: Kinematics) -> JointLimits:
    n = len(robot)
    return JointLimits(np.tile([-np.inf, np.inf], (n, 1)), np.full(n, np.inf), np.full(n, np.inf))


def paper_weights(n: int, factor: float = 1.0) -> Weights:
    position = factor * np.array([0.3, 0.3, 1.0, 1.0])
    return Weights(position, np.array([0.05, 0.05, 0.2, 0.2]), np.full(n, 1e-4))


def test_16_and_17_as_printed_equal_the_axis_times_the_rotational_jacobian() -> None:
    robot = kinematics()
    points = contacts_of(robot, POSE).points
    rng = np.random.default_rng(2)
    R_desired = Rotation.from_rotvec(rng.normal(0, 0.8, (4, 3))).as_matrix()
    poses = robot.surface_poses(POSE, points)
    found, axis = deviations(poses, poses.position_m, R_desired)
    ours = np.einsum("ci,cin->cn", axis, poses.J_w)

    def angle_of_8(q: Floats) -> Floats:
        R = R_desired.transpose(0, 2, 1) @ robot.surface_poses(q, points).R_world_surface
        angle_rad: Floats = np.arccos((np.trace(R, axis1=1, axis2=2) - 1.0) / 2.0)
        return angle_rad

    np.testing.assert_allclose(found.rotation_rad, angle_of_8(POSE), atol=1e-12)
    h = 1e-6
    R = R_desired.transpose(0, 2, 1) @ poses.R_world_surface
    cosine = (np.trace(R, axis1=1, axis2=2) - 1.0) / 2.0
    for j in range(len(JOINTS)):
        dq = h * np.eye(len(JOINTS))[j]
        turn_rate = (
            robot.surface_poses(POSE + dq, points).R_world_surface
            - robot.surface_poses(POSE - dq, points).R_world_surface
        ) / (2 * h)
        d_rkk = np.einsum("cik,cik->ck", R_desired, turn_rate)  # (17)
        printed = -((1.0 - cosine**2) ** -0.5) * 0.5 * d_rkk.sum(axis=1)  # (16)
        np.testing.assert_allclose(ours[:, j], printed, atol=1e-8)
        slope = (angle_of_8(POSE + dq) - angle_of_8(POSE - dq)) / (2 * h)
        np.testing.assert_allclose(ours[:, j], slope, atol=1e-8)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-8, 1e-4, 1.0, np.pi - 1e-7])
def test_the_angle_keeps_its_digits_near_its_ends(angle_rad: float) -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    R = Rotation.from_rotvec(angle_rad * axis).as_matrix()[None]
    pose = Poses(np.zeros((1, 3)), R, np.zeros((1, 3, 1)), np.zeros((1, 3, 1)))
    found, direction = deviations(pose, np.array([[0.0, 0.0, 2.0]]), np.eye(3)[None])
    assert found.position_m[0] == 2.0
    assert found.rotation_rad[0] == pytest.approx(angle_rad, abs=1e-14)
    if angle_rad:
        np.testing.assert_allclose(direction[0], axis, atol=1e-7)


def test_4_and_5_move_contacts_rigidly_with_the_object() -> None:
    contacts = contacts_of(kinematics(), POSE)
    R = Rotation.from_rotvec((0.1, 0.2, -0.3)).as_matrix()
    object_m = np.array([0.4, 0.1, 1.0])
    place, R_contact = desired_contacts(object_m, R, contacts.x_object_contact_m, contacts.R_object_contact)
    for c in range(4):
        np.testing.assert_allclose(place[c], object_m + R @ contacts.x_object_contact_m[c], atol=1e-15)
        np.testing.assert_allclose(R_contact[c], R @ contacts.R_object_contact[c], atol=1e-15)


def problem(seed: int, m: int = 16, n: int = 12) -> LeastSquaresProblem:
    rng = np.random.default_rng(seed)
    return LeastSquaresProblem(
        rng.normal(size=(m, n)), rng.normal(size=m), rng.uniform(0.1, 5, m), rng.uniform(0.01, 1, n)
    )


def cost(p: LeastSquaresProblem, step: Floats) -> float:
    return float(0.5 * p.weight @ (p.jacobian @ step + p.error) ** 2 + 0.5 * p.damping @ step**2)


def slope(p: LeastSquaresProblem, step: Floats) -> Floats:
    return (p.jacobian * p.weight[:, None]).T @ (p.jacobian @ step + p.error) + p.damping * step


UNBOUNDED = (np.full(12, -np.inf), np.full(12, np.inf))


@pytest.mark.parametrize("m", [4, 16, 40])
def test_18_is_the_least_squares_solution(m: int) -> None:
    p = problem(1, m)
    stacked = np.concatenate((np.sqrt(p.weight)[:, None] * p.jacobian, np.diag(np.sqrt(p.damping))))
    target = np.concatenate((-np.sqrt(p.weight) * p.error, np.zeros(12)))
    due = np.linalg.lstsq(stacked, target)[0]
    np.testing.assert_allclose(closed_form(p, UNBOUNDED), due, atol=1e-10)
    np.testing.assert_allclose(quadratic_programme(kinematics())(p, UNBOUNDED), due, atol=1e-9)


def test_within_limits_the_programme_is_optimal_and_the_closed_form_beats_clipping() -> None:
    solve = quadratic_programme(kinematics())
    better = []
    for seed in range(40):
        p = problem(seed)
        rng = np.random.default_rng(100 + seed)
        box = (-rng.uniform(0.0, 0.3, 12), rng.uniform(0.0, 0.3, 12))
        ours, best = closed_form(p, box), solve(p, box)
        for step in (ours, best):
            assert (step >= box[0]).all()
            assert (step <= box[1]).all()
        pull = slope(p, best)  # Karush, Kuhn and Tucker: nothing can be gained within the box
        low, high = best <= box[0] + 1e-9, best >= box[1] - 1e-9
        assert np.abs(pull[~low & ~high]).max(initial=0.0) < 1e-6
        assert (pull[low & ~high] > -1e-6).all()
        assert (pull[high & ~low] < 1e-6).all()
        clipped = np.clip(closed_form(p, UNBOUNDED), *box)
        assert cost(p, best) <= cost(p, ours) + 1e-9
        better.append(cost(p, ours) - cost(p, clipped))
    assert max(better) < 1e-9
    assert np.mean(better) < -0.1


def test_braking_keeps_position_speed_and_acceleration_at_once() -> None:
    reach, speed, acceleration = np.array([0.5, 1.0]), np.array([0.8, 0.6]), np.array([2.0, 0.7])
    limits = JointLimits(np.stack((-reach, reach), axis=1), speed, acceleration)
    q, last = np.zeros(2), np.zeros(2)
    largest_m = np.zeros(2)
    for tick in range(900):  # always as fast as allowed, back and forth
        smallest, largest = limits.step_bounds(q, last, PERIOD_S)
        step = largest if tick // 300 % 2 == 0 else smallest
        assert (np.abs(step - last) <= acceleration * PERIOD_S**2 + 1e-15).all()
        assert (np.abs(step) <= speed * PERIOD_S + 1e-15).all()
        q, last = q + step, step
        assert (np.abs(q) <= reach + 1e-12).all()
        largest_m = np.maximum(largest_m, np.abs(step) / PERIOD_S)
        if tick == 299:
            np.testing.assert_allclose(q, reach, atol=2e-3)
    assert largest_m[1] == pytest.approx(0.6)


def test_a_joint_beyond_its_limit_only_comes_back_and_a_box_is_never_empty() -> None:
    limits = JointLimits(np.array([[-1.0, 1.0]]), np.array([0.5]), np.array([0.1]))
    for q, last in itertools.product((-1.5, -1.0, 0.0, 1.0, 1.2), (-0.005, 0.0, 0.005)):
        smallest, largest = limits.step_bounds(np.array([q]), np.array([last]), PERIOD_S)
        assert smallest <= largest
        assert largest <= 0.0 or q < 1.0
        assert smallest >= 0.0 or q > -1.0
    assert limits.step_bounds(np.array([1.2]), np.array([0.0]), PERIOD_S)[1][0] == pytest.approx(-0.005)
    for wrong in (
        {"position_range": np.array([[1.0, -1.0]])},
        {"max_speed": np.array([0.0])},
        {"max_acceleration": np.array([-1.0])},
        {"position_range": np.zeros((2, 2))},
    ):
        values = {
            "position_range": limits.position_range,
            "max_speed": limits.max_speed,
            "max_acceleration": limits.max_acceleration,
        }
        with pytest.raises(ValueError, match="limits"):
            JointLimits(**(values | wrong))


def follow(
    robot: Kinematics,
    q: Floats,
    path: ObjectTrajectory,
    weights: Weights,
    limits: JointLimits | None = None,
    solver: Solver = closed_form,
    names: tuple[str, ...] = FOUR,
    rest_s: float = 2.0,
) -> tuple[list[Floats], list[Deviations], Poses]:
    contacts = contacts_of(robot, q, names)
    generator = TrajectoryGenerator(
        robot, contacts.points, weights, limits or free(robot), q, PERIOD_S, solver
    )
    course, deviated = [generator.q], []
    for tick in range(1, round((path.end_ns / 1e9 + rest_s) / PERIOD_S)):
        moved_m, R = path.pose_at(tick * 10_000_000)
        asked = desired_contacts(
            contacts.object_centre_m + moved_m, R, contacts.x_object_contact_m, contacts.R_object_contact
        )
        step = generator.step(*asked)
        course.append(generator.q)
        deviated.append(step.deviations)
        np.testing.assert_allclose(step.velocity * PERIOD_S, course[-1] - course[-2], atol=1e-15)
    return course, deviated, generator.poses


SIDEWAYS = ObjectTrajectory([Waypoint(5 * S, (0.1, 0.0, 0.0))])
"""Experiment A: 0.1 m in x."""


def test_experiment_a_forearms_deviate_less_and_weights_trade_position_for_rotation() -> None:
    robot = kinematics()
    runs = [follow(robot, POSE, SIDEWAYS, paper_weights(12, factor)) for factor in (1.0, 10.0)]
    (_, one, poses), (_, ten, _) = runs
    end = one[-1]
    assert end.position_m[2:].max() < end.position_m[:2].min()
    assert end.rotation_rad[2:].max() < end.rotation_rad[:2].min()
    assert end.position_m.min() > 0.005  # over-constrained: 24 conditions, 12 joints
    assert (ten[-1].position_m < end.position_m).all()
    assert (ten[-1].rotation_rad > end.rotation_rad).all()
    moved_m = poses.position_m - robot.surface_poses(POSE, contacts_of(robot, POSE).points).position_m
    assert moved_m[:, 0].min() > 0.03  # all go along


def test_sideways_motion_of_the_base_makes_every_deviation_vanish() -> None:
    """Why the cart takes no part in experiment A."""
    robot = kinematics((*JOINTS, "cart_x"))
    _, deviated, _ = follow(robot, np.append(POSE, 0.0), SIDEWAYS, paper_weights(13))
    assert deviated[-1].position_m.max() < 1e-4
    assert deviated[-1].rotation_rad.max() < 1e-3


def test_13_as_printed_does_not_stand_still_where_18_does() -> None:
    """Without 1/Δt² the damping is 10⁴ times weaker; an over-constrained hold then chatters for ever."""
    robot = kinematics()
    rest = {
        "printed": paper_weights(12)._replace(joint=np.full(12, 1e-4 * PERIOD_S**2)),
        "18": paper_weights(12),
    }
    speed = {}
    for name, weights in rest.items():
        course, _, _ = follow(robot, POSE, SIDEWAYS, weights, rest_s=3.0)
        speed[name] = np.abs(np.diff(course[-100:], axis=0)).max() / PERIOD_S
    assert speed["18"] < 0.01
    assert speed["printed"] > 0.1


@pytest.mark.parametrize("names", [("left_forearm",), FOUR[2:], FOUR])
def test_any_number_of_contacts_keeps_its_shape_when_the_joints_suffice(names: tuple[str, ...]) -> None:
    """With the cart among the joints, the object can be shifted and turned, and the contacts go with it."""
    robot = kinematics((*JOINTS, "cart_x", "cart_y", "cart_yaw"))
    q = np.append(POSE, np.zeros(3))
    turn = (0.0, 0.0, 0.3)
    path = ObjectTrajectory([Waypoint(2 * S, (0.05, 0.0, 0.0)), Waypoint(5 * S, (0.05, -0.04, 0.0), turn)])
    weights = Weights(np.ones(len(names)), np.full(len(names), 0.2), np.full(15, 1e-4))
    _, deviated, after = follow(robot, q, path, weights, names=names, rest_s=4.0)
    before = robot.surface_poses(q, contacts_of(robot, q, names).points)
    R = Rotation.from_rotvec(turn).as_matrix()
    middle_m = before.position_m.mean(axis=0)
    due_m = middle_m + [0.05, -0.04, 0.0] + (before.position_m - middle_m) @ R.T
    np.testing.assert_allclose(after.position_m, due_m, atol=5e-4)
    np.testing.assert_allclose(after.R_world_surface, R @ before.R_world_surface, atol=2e-3)
    assert deviated[-1].position_m.max() < 5e-4


def test_programme_and_closed_form_go_the_same_way_without_active_limits() -> None:
    """Agreement over 300 steps, each from the one before: 1e-9 rad."""
    robot = kinematics()
    path = ObjectTrajectory([Waypoint(3 * S, (0.05, 0.0, 0.03), (0.0, 0.1, 0.0))])
    weights = paper_weights(12)
    ours, _, _ = follow(robot, POSE, path, weights, rest_s=0.0)
    theirs, _, _ = follow(robot, POSE, path, weights, solver=quadratic_programme(robot), rest_s=0.0)
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


@pytest.mark.parametrize("kind", ["closed_form", "qp"])
def test_a_trajectory_stays_within_the_limits_of_the_joints(kind: str) -> None:
    robot = kinematics()
    yaw = JOINTS.index("waist_yaw")
    tight = robot.joint_range.copy()
    tight[yaw] = (-0.02, 0.02)
    speed, acceleration = np.full(12, 0.05), np.full(12, 0.2)
    limits = JointLimits(tight, speed, acceleration)
    solver = closed_form if kind == "closed_form" else quadratic_programme(robot)
    path = ObjectTrajectory([Waypoint(3 * S, (0.1, 0.0, 0.0))])
    course = np.array(follow(robot, POSE, path, paper_weights(12), limits, solver)[0])
    velocity = np.diff(course, axis=0) / PERIOD_S
    assert np.abs(velocity).max() == pytest.approx(0.05)
    assert (np.abs(np.diff(velocity, axis=0)) <= 0.2 * PERIOD_S + 1e-12).all()
    assert (course >= tight[:, 0] - 1e-12).all()
    assert (course <= tight[:, 1] + 1e-12).all()
    assert np.abs(course[:, yaw]).max() == pytest.approx(0.02, abs=1e-4)
    unlimited = np.array(follow(robot, POSE, path, paper_weights(12))[0])
    assert np.abs(unlimited[:, yaw]).max() > 0.03


def test_the_path_of_the_object_meets_its_waypoints_at_rest_and_turns_about_one_axis() -> None:
    first, second = (0.1, 0.0, 0.02), (0.1, -0.05, 0.1)
    turns = (0.0, 0.3, 0.0), (0.4, 0.3, 0.0)
    path = ObjectTrajectory([Waypoint(2 * S, first, turns[0]), Waypoint(5 * S, second, turns[1])])
    for t_ns, place, turn in ((0, (0, 0, 0), (0, 0, 0)), (2 * S, first, turns[0]), (9 * S, second, turns[1])):
        found_m, R = path.pose_at(t_ns)
        np.testing.assert_allclose(found_m, place, atol=1e-15)
        np.testing.assert_allclose(Rotation.from_matrix(R).as_rotvec(), turn, atol=1e-12)
    for t_ns in (0, 2 * S, 5 * S):  # at rest: the way out of a waypoint begins with the third power of time
        for away_ns in (-1_000_000, 1_000_000):
            step_m = path.pose_at(t_ns + away_ns)[0] - path.pose_at(t_ns)[0]
            assert np.abs(step_m).max() < 1e-9
    spins = [
        Rotation.from_matrix(path.pose_at(t)[1].T @ path.pose_at(t + S // 20)[1])
        for t in range(2 * S, 5 * S, S // 4)
    ]
    axes = np.array([spin.as_rotvec() / spin.magnitude() for spin in spins])
    np.testing.assert_allclose(axes, np.tile(axes[0], (len(axes), 1)), atol=1e-6)
    for wrong in ([], [Waypoint(0, first)], [Waypoint(S, first), Waypoint(S, second)]):
        with pytest.raises(ValueError, match="waypoints"):
            ObjectTrajectory(wrong)
    with pytest.raises(ValueError, match="finite"):
        ObjectTrajectory([Waypoint(S, (np.nan, 0.0, 0.0))])


@pytest.mark.parametrize("field", Weights._fields)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_weights_of_zero_or_below_are_refused(field: str, value: float) -> None:
    robot = kinematics()
    weights = paper_weights(12)
    getattr(weights, field)[1] = value
    with pytest.raises(ValueError, match=f"{field} weights"):
        TrajectoryGenerator(robot, contacts_of(robot, POSE).points, weights, free(robot), POSE, PERIOD_S)
    with pytest.raises(ValueError, match="12 finite numbers"):
        TrajectoryGenerator(
            robot, contacts_of(robot, POSE).points, paper_weights(11), free(robot), POSE, PERIOD_S
        )


def test_the_evaluation_is_equation_6_with_squared_velocities() -> None:
    """E = ½ Σ w_x d² + ½ Σ w_R θ² + ½ Σ w_q q̇², with weights so different that each term shows."""
    robot = kinematics()
    contacts = contacts_of(robot, POSE)
    weights = Weights(np.arange(1.0, 5.0), np.arange(2.0, 6.0), np.linspace(1e-4, 4e-4, len(robot)))
    generator = TrajectoryGenerator(robot, contacts.points, weights, free(robot), POSE, PERIOD_S)
    shift_m = np.array([0.01, -0.02, 0.03])
    step = generator.step(generator.poses.position_m + shift_m, generator.poses.R_world_surface)
    parts = (
        weights.position * step.deviations.position_m**2,
        weights.rotation * step.deviations.rotation_rad**2,
        weights.joint * step.velocity**2,
    )
    assert step.evaluation == pytest.approx(0.5 * sum(float(part.sum()) for part in parts), rel=1e-12)
    assert all(part.sum() > 1e-9 for part in parts)
    assert np.allclose(generator.q - POSE, step.velocity * PERIOD_S)


def test_mobility_is_the_closed_form_for_one_lever_and_vanishes_when_arms_are_straight() -> None:
    lever = np.diag([0.5, 0.2, 0.1])[None]
    assert mobility(lever, np.ones(1), 0.1) == pytest.approx(0.5)
    assert mobility(lever, np.ones(1), 0.05) == pytest.approx(0.8)
    arms = kinematics(JOINTS[:10])
    shares = {}
    for name, pose in (("bent", POSE[:10]), ("straight", np.zeros(10))):
        poses = arms.surface_poses(pose, contacts_of(arms, pose, FOUR[2:]).points)
        shares[name] = mobility(poses.J_x, np.ones(2), 0.05)
    assert shares["bent"] > 0.7
    assert shares["straight"] < 0.2
