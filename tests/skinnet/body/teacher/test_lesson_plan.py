"""The plan of a lesson: motions that only evasion can make, and that together reach the goals."""

import body_scenes
import numpy as np
import pytest

from skinnet.body.ground_truth.cell_kinematics import set_joint_positions
from skinnet.body.teacher.lesson_plan import PositionGoals, plan_motions_rad
from skinnet.deployment.environment.teacher import GoalSpec
from skinnet.errors import ModelError


def test_a_way_that_cells_span_is_gone():
    rng = np.random.default_rng(1)
    jacobian_m = rng.normal(0.0, 0.3, (6, 4))
    directions = np.vstack([np.eye(4), -np.eye(4)])
    wanted = np.array([0.2, -0.3, 0.0, 0.1])
    motions = plan_motions_rad(jacobian_m @ wanted, jacobian_m, directions)
    assert (motions >= 0.0).all()
    np.testing.assert_allclose(motions @ directions, wanted, atol=0.02)
    assert np.count_nonzero(motions) <= 4, "nobody works against another"


def test_nothing_is_planned_where_evasion_leads_away():
    jacobian_m = np.eye(3)
    assert not plan_motions_rad(np.array([-0.1, 0.0, 0.0]), jacobian_m, np.array([[1.0, 0.0, 0.0]])).any()
    assert plan_motions_rad(np.array([0.1, 0.0, 0.0]), jacobian_m, np.zeros((0, 3))).shape == (0,)


def test_what_one_cell_should_not_move_another_undoes():
    """The elbow alone is wanted; one cell moves shoulder and elbow, another the shoulder backwards."""
    directions = np.array([[0.6, 0.8], [-1.0, 0.0]])
    motions = plan_motions_rad(np.array([0.0, 0.4]), np.eye(2), directions)
    np.testing.assert_allclose(motions, [0.5, 0.3], atol=0.01)


def test_of_equal_cells_one_is_enough():
    directions = np.repeat([[0.0, 1.0]], 16, axis=0)
    assert np.count_nonzero(plan_motions_rad(np.array([0.0, 0.4]), np.eye(2), directions)) == 1


def test_goals_see_points_of_bodies_and_plan_by_their_true_motion():
    body = body_scenes.hrp2()
    elbow, wrist = (body.data.body(name).xpos.copy() for name in ("left_forearm", "left_hand"))
    specs = (
        GoalSpec(body="left_forearm", position_m=tuple(elbow)),
        GoalSpec(body="left_forearm", point_m=(0.0, 0.0, -0.25), position_m=tuple(wrist), weight=4.0),
    )
    goals = PositionGoals(body.model, body.data, specs, "teacher.lessons[0]", "hrp2_upper")
    np.testing.assert_allclose(goals.error_m(), 0.0, atol=1e-9)
    q = body.joints()
    set_joint_positions(body, q + 0.1 * np.eye(body.n_dofs)[3])
    assert goals.error_m()[0] == pytest.approx(0.0, abs=1e-9)
    assert goals.error_m()[1] == pytest.approx(0.025, rel=0.01), "0.25 m of forearm turned by 0.1 rad"
    motions = goals.plan_motions_rad(np.vstack([np.eye(body.n_dofs)[3], -np.eye(body.n_dofs)[3]]))
    np.testing.assert_allclose(motions, [0.0, 0.1], atol=0.002)


def test_a_goal_of_a_body_that_is_not_there_is_named():
    body = body_scenes.hrp2()
    with pytest.raises(ModelError, match=r"teacher.lessons\[2\].goals\[0\].body = \"left_tail\".*left_hand"):
        PositionGoals(
            body.model,
            body.data,
            (GoalSpec(body="left_tail", position_m=(0, 0, 0)),),
            "teacher.lessons[2]",
            "x",
        )
