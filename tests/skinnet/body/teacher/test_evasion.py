"""What the teacher expects of an evading cell is what the robot's kinematics give."""

import body_scenes
import numpy as np
import pytest

from skinnet.body.ground_truth.cell_kinematics import (
    activity_matrix,
    cell_jacobian,
    cell_poses,
    set_joint_positions,
)
from skinnet.body.teacher.evasion import Evasion, ideal_sensory_motor_map


@pytest.fixture(scope="module")
def body():
    return body_scenes.hrp2()


def pose(body, seed):
    rng = np.random.default_rng(seed)
    lowest, highest = body.model.range_rad.T
    return np.clip(body.joints() + rng.normal(0.0, 0.3, body.n_dofs), lowest + 0.05, highest - 0.05)


@pytest.mark.parametrize("seed", range(3))
def test_the_jacobian_is_that_of_small_motions(body, seed):
    q, step_rad = pose(body, seed), 1e-6
    set_joint_positions(body, q)
    found = cell_jacobian(body)
    _, R_world_cell = cell_poses(body)
    for dof in range(body.n_dofs):
        ends = []
        for sign in (1.0, -1.0):
            set_joint_positions(body, q + sign * step_rad * np.eye(body.n_dofs)[dof])
            ends.append(cell_poses(body)[0])
        moved_m = (ends[0] - ends[1]) / (2 * step_rad)
        np.testing.assert_allclose(found[:, dof], np.einsum("nji,nj->ni", R_world_cell, moved_m), atol=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_evasion_moves_a_cell_inwards_and_all_of_them_alike(body, seed):
    q = pose(body, seed)
    set_joint_positions(body, q)
    weights = ideal_sensory_motor_map(cell_jacobian(body))
    before_m, R_world_cell = cell_poses(body)
    np.testing.assert_array_equal(weights[~activity_matrix(body)], 0.0)
    norm = np.linalg.norm(weights, axis=1)
    still = np.isclose(norm, 0.0)
    np.testing.assert_allclose(norm[~still], 1.0)
    torso = np.zeros(len(still), dtype=bool)
    torso[body.cells["torso"]] = True
    np.testing.assert_array_equal(still, torso)
    for row in np.flatnonzero(~still):
        set_joint_positions(body, q + 1e-5 * weights[row])
        moved_m = (cell_poses(body)[0][row] - before_m[row]) / 1e-5
        assert moved_m @ R_world_cell[row][:, 2] < -0.01, row


def test_weights_are_shares_of_the_normal():
    """Equation (2): −z / (|x| + |y| + |z|), then rows of norm one."""
    jacobian_m = np.array([[[0.1, 0.0, -0.3], [0.0, 0.2, 0.2], [0.0, 0.0, 0.0]], [[0.5, 0.4, 0.05]] * 3])
    weights = ideal_sensory_motor_map(jacobian_m)
    expected = np.array([0.75, -0.5, 0.0])
    np.testing.assert_allclose(weights[0], expected / np.linalg.norm(expected))
    assert ideal_sensory_motor_map(np.array([[[1.0, 1.0, -0.05]]])) == 0.0, "too little of it inwards"
    assert ideal_sensory_motor_map(np.array([[[0.0, 0.0, -1e-12]]])) == 0.0, "on the axis, but for rounding"


def test_what_was_seen_replaces_what_was_expected(body):
    set_joint_positions(body, pose(body, 0))
    evasion = Evasion(body)
    row = body.cells["left_forearm"].start + 2
    rows = np.array([row, row + 1])
    expected = evasion.directions(rows)
    np.testing.assert_allclose(expected, ideal_sensory_motor_map(cell_jacobian(body))[rows])
    moved = np.zeros(body.n_dofs)
    moved[[1, 3, 9]] = 0.03, -0.04, 0.2
    assert not evasion.observe(row, 0.1 * moved), "too little to tell"
    np.testing.assert_allclose(evasion.directions(rows), expected)
    assert evasion.observe(row, moved)
    seen = np.zeros(body.n_dofs)
    seen[[1, 3]] = 0.6, -0.8
    found = evasion.directions(rows)
    np.testing.assert_allclose(found[0], seen, err_msg="the right arm has nothing to do with it")
    np.testing.assert_allclose(found[1], expected[1])
    evasion.mark_unresponsive(row)
    assert not evasion.directions(rows)[0].any()


def test_a_joint_at_its_limit_goes_no_further(body):
    q = pose(body, 0)
    elbow = 3
    row = np.array([body.cells["left_forearm"].start])
    for at_rad, kept in ((body.model.range_rad[elbow, 0], 1.0), (body.model.range_rad[elbow, 1], -1.0)):
        q[elbow] = at_rad
        set_joint_positions(body, q)
        evasion = Evasion(body)
        weight = ideal_sensory_motor_map(cell_jacobian(body))[row[0], elbow]
        found = evasion.directions(row)[0, elbow]
        assert found == (weight if weight * kept > 0 else 0.0)
