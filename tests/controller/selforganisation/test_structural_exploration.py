"""Structural self-exploration: trees are found exactly, what is no tree is called so, motion is as stated."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_robot import AXES, TICK_NS, Floats, SkinnedArms, rotation, run

from controller.self_model import SelfModel
from controller.selforganisation.exploration import PositionControl
from controller.selforganisation.kinematic_structure import (
    KinematicStructure,
    activity_matrix,
    complete_structure,
    count_wrong_entries,
    find_structure,
)
from controller.selforganisation.map_exploration import MapExploration, MapExplorationConfig
from controller.selforganisation.structural_exploration import (
    StructuralExploration,
    StructuralExplorationConfig,
)

QUICK = StructuralExplorationConfig(
    average_ns=200_000_000, settle_ns=100_000_000, move_timeout_ns=1_000_000_000
)


def path_of_joints(structure: KinematicStructure, part: int) -> set[int]:
    """Joints from a part to the root, by walking the parents."""
    joints = set()
    while structure.parent_part[part] >= 0:
        joints.add(structure.parent_joint[part])
        part = structure.parent_part[part]
    return joints


@settings(deadline=None)
@given(data=st.data(), n_parts=st.integers(1, 9))
def test_the_tree_of_any_robot_is_found_exactly(data: st.DataObject, n_parts: int) -> None:
    parent = [-1] + [data.draw(st.integers(0, p - 1)) for p in range(1, n_parts)]
    cell_part = np.array(data.draw(st.permutations([p for p in range(n_parts) for _ in range(1 + p % 3)])))
    dof_part = np.array(data.draw(st.permutations([p for p in range(1, n_parts) for _ in range(1 + p % 2)])))
    ancestors: list[set[int]] = []
    for p in range(n_parts):
        ancestors.append({p} | (ancestors[parent[p]] if p else set()))
    activity = np.array([[d in ancestors[c] for d in dof_part] for c in cell_part], dtype=bool).reshape(
        len(cell_part), len(dof_part)
    )

    found = find_structure(activity)

    assert found.problems == ()
    assert {frozenset(cells) for cells in found.parts} == {
        frozenset(np.flatnonzero(cell_part == p).tolist()) for p in range(n_parts)
    }
    for number, cells in enumerate(found.parts):
        p = cell_part[cells[0]]
        if p == 0:
            assert found.parent_part[number] == found.parent_joint[number] == -1
        else:
            assert cell_part[found.parts[found.parent_part[number]][0]] == parent[p]
            assert found.joints[found.parent_joint[number]] == tuple(np.flatnonzero(dof_part == p).tolist())


@settings(deadline=None, max_examples=300)
@given(rows=st.lists(st.lists(st.booleans(), min_size=3, max_size=3), min_size=1, max_size=7))
def test_problems_are_reported_for_exactly_what_is_no_tree(rows: list[list[bool]]) -> None:
    activity = np.array(rows)
    moved = [frozenset(np.flatnonzero(column).tolist()) for column in activity.T]
    joints = set(moved)
    nested = all(not (a & b) or a <= b or b <= a for a in joints for b in joints)
    own_cells = all(a - frozenset[int]().union(*(b for b in joints if b < a)) for a in joints)
    is_tree = (
        nested and own_cells and bool((~activity.any(axis=1)).any())
    )  # an idle DoF has no cells of its own

    found = find_structure(activity)

    assert (found.problems == ()) == is_tree
    if is_tree:
        for part, row in enumerate(found.part_activity):
            assert path_of_joints(found, part) == set(np.flatnonzero(row).tolist())


def test_a_part_between_two_parents_hangs_on_neither() -> None:
    found = find_structure(np.array([[0, 0], [1, 0], [0, 1], [1, 1]], dtype=bool))
    assert found.parent_part == (-1, 0, 0, -1)
    assert found.problems == ("the part of cell 3 has 2 possible parents",)


@pytest.mark.parametrize("beta", [0.02, 0.09, 0.11, 0.6, 1.5])
def test_activity_needs_an_axis_off_gravity(beta: float) -> None:
    axis = np.array([np.sin(beta), 0.0, np.cos(beta)])
    before = np.array([0.0, 0.0, 1.3])  # the length must not matter
    after = 0.7 * rotation(axis, 0.1) @ before
    change = 2 * np.sin(0.05) * np.sin(beta)
    active, unknown = activity_matrix(before[None, None, None], after[None, None, None], threshold_g=0.01)
    assert bool(active[0, 0]) == (change > 0.01)
    assert not unknown.any()


def test_runs_combine_by_or_and_what_was_not_measured_is_unknown() -> None:
    still, moved, lost = [0.0, 0, 1], [0.0, 0.2, 1], [np.nan] * 3
    before = np.full((2, 1, 4, 3), still)
    after = np.array([[[still, still, lost, lost]], [[still, moved, still, moved]]])
    active, unknown = activity_matrix(before, after)
    assert active.tolist() == [[False], [True], [False], [True]]
    assert unknown.tolist() == [[False], [False], [True], [False]]
    assert find_structure(active, unknown).unmeasured == (2,)


def test_two_arms_with_sensor_noise_have_no_wrong_entry() -> None:
    arms = SkinnedArms()
    program = StructuralExploration(StructuralExplorationConfig(), arms.n_dofs, arms.n_cells, 0)
    servos = run(program, arms, noise_g=0.004, lsb_g=0.004)
    found = program.result
    assert found.problems == ()
    assert count_wrong_entries(found, arms.activity) == 0
    assert found.joints == ((0, 1, 2), (3,), (4,), (5, 6), (7, 8, 9), (10,), (11,), (12, 13))
    assert found.parent_part == (-1, 0, 0, 1, 2, 3, 4, 5, 6)
    assert (
        np.abs(servos.q - arms.home_rad).max() <= PositionControl().tolerance_rad
    )  # went forth and came back


def test_much_noise_is_owned_up_to() -> None:
    arms = SkinnedArms(n_arms=1)
    program = StructuralExploration(StructuralExplorationConfig(), arms.n_dofs, arms.n_cells, 0)
    run(program, arms, noise_g=0.05, lsb_g=0.004)
    assert count_wrong_entries(program.result, arms.activity) > 0
    assert program.result.problems


def test_a_dead_cell_and_a_stuck_joint_are_reported() -> None:
    arms = SkinnedArms(n_arms=1, cells_per_part=2, torso_cells=3)
    program = StructuralExploration(QUICK, arms.n_dofs, arms.n_cells, 0)
    run(program, arms, noise_g=0.0, dead_cells=(3,), stuck_dof=3)
    found = program.result
    assert found.unmeasured == (3,)
    assert not any(3 in cells for cells in found.parts)
    assert not found.activity[:, 3].any()
    text = "\n".join(found.problems)
    assert "cell 3 measured with too few samples" in text
    assert "DoF 3 did not complete its step in run 1: DoF 3 rested up to 0.100 rad from the target" in text
    assert "DoF 3 moves no cell" in text


def drive(program: StructuralExploration, n_dofs: int, *, late_ns: int = 0) -> tuple[list[int], Floats]:
    """Begins of motion and end [ns], and furthest positions, with one sample a tick, told late.

    Servos are ideal. The only cell points up, but anywhere while something moves and until 240 ms later.
    """
    position, furthest = np.zeros(n_dofs), np.zeros(n_dofs)
    begins: list[int] = []
    samples: list[Floats] = []
    t_ns, motion_ns = 0, -(10**9)
    garbage = np.random.default_rng(3)
    while not program.done:
        velocity = program.step(t_ns, position)
        if velocity.any():
            if t_ns - motion_ns > TICK_NS:
                begins.append(t_ns)
            motion_ns = t_ns
        position = position + velocity * TICK_NS * 1e-9
        furthest = np.maximum(furthest, position)
        calm = t_ns - motion_ns > 240_000_000
        samples.append(np.array([0.0, 0.0, 1.0]) if calm else garbage.standard_normal(3))
        if t_ns >= late_ns:
            sampled_ns = t_ns - late_ns
            program.add_samples(np.array([0]), np.array([sampled_ns]), samples[sampled_ns // TICK_NS][None])
        t_ns += TICK_NS
    return [*begins, t_ns], furthest


def test_each_step_takes_the_time_of_the_paper_and_only_the_windows_count() -> None:
    program = StructuralExploration(
        StructuralExplorationConfig(position_control=PositionControl(speed_rad_s=1.0)), 2, 1, 0
    )
    begins, furthest = drive(program, 2)
    step_s = np.diff(begins[:-1]) * 1e-9
    assert begins[0] == 1_000_000_000
    assert ((step_s >= 2.5) & (step_s < 2.65)).all()  # 28 of them are the paper's 70 s
    assert not program.result.activity.any()  # no garbage came in
    assert program.result.unmeasured == ()
    np.testing.assert_allclose(furthest, 0.1, atol=PositionControl().tolerance_rad)


@pytest.mark.parametrize("late_ns", [0, 60_000_000, 400_000_000])
def test_samples_that_come_late_count_in_full(late_ns: int) -> None:
    program = StructuralExploration(StructuralExplorationConfig(min_samples=200), 2, 1, 0)
    drive(program, 2, late_ns=late_ns)
    assert program.result.unmeasured == ()
    assert not program.result.activity.any()


def test_progress_rises_to_one_and_the_result_waits_for_it() -> None:
    program = StructuralExploration(QUICK, 1, 1, 1_000_000_000)
    with pytest.raises(RuntimeError, match="not done"):
        _ = program.result
    position, t_ns, seen = np.zeros(1), 0, [program.progress]
    while not program.done:
        velocity = program.step(t_ns, position)
        assert t_ns >= 1_000_000_000 or not velocity.any()
        position = position + velocity * TICK_NS * 1e-9
        seen.append(program.progress)
        t_ns += TICK_NS
    assert all(a <= b for a, b in pairwise(seen))
    assert seen[0] == 0.0
    assert seen[-1] == 1.0
    assert program.result.unmeasured == (0,)  # no sample ever came


def shake(until_s: float) -> KinematicStructure:
    """Structure of two DoFs and one cell that DoF 1 moves; the wrist shakes until a time."""
    names = ("elbow", "wrist")
    program = StructuralExploration(
        StructuralExplorationConfig(), 2, 2, 0, dof_names=names, cell_names=("arm/0", "hand/0")
    )
    position, t_ns = np.zeros(2), 0
    while not program.done:
        swing = 0.005 * np.sin(2.0 * np.pi * 3.0 * t_ns * 1e-9) if t_ns < until_s * 1e9 else 0.0
        velocity = program.step(t_ns, position + np.array([0.0, swing]))
        position = position + velocity * TICK_NS * 1e-9
        tilted = rotation(np.array([1.0, 0.0, 0.0]), position[1] + swing) @ np.array([0.0, 0.0, 1.0])
        program.add_samples(np.array([0, 1]), np.full(2, t_ns), np.array([[0.0, 0.0, 1.0], tilted]))
        t_ns += TICK_NS
    return program.result


def test_a_step_without_rest_is_repeated() -> None:
    found = shake(until_s=3.0)
    assert found.problems == (
        "DoF elbow moves no cell: no skin distal to it, or its axis is parallel to gravity",
    )
    assert found.activity.tolist() == [[False, False], [False, True]]


def test_joints_that_do_not_rest_are_named_and_their_steps_not_believed() -> None:
    found = shake(until_s=np.inf)
    assert found.untold.all()
    says = "DoF {} did not complete its step in run {}: DoF wrist did not come to rest, so it is not measured"
    expected = [says.format(dof, run) for run in (1, 2) for dof in ("elbow", "wrist")]
    assert list(found.problems[:4]) == expected
    assert found.unmeasured == ()  # nothing is known of the DoFs, which is no fault of the cells


def test_a_joint_that_is_not_measured_leaves_the_rest_of_the_structure() -> None:
    still, moved = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.1, 1.0])
    truth = np.array([[0, 0], [1, 0], [1, 1]], dtype=bool)
    before = np.broadcast_to(still, (2, 2, 3, 3)).copy()
    after = np.where(truth.T[None, :, :, None], moved, still)
    before[:, 1] = np.nan
    lost = np.array([[False, True], [False, True]])
    active, unknown = activity_matrix(before, after, lost=lost)
    found = find_structure(active, unknown)
    assert found.unmeasured == ()
    assert found.untold.tolist() == [False, True]
    assert found.parts == ((0,), (1, 2))
    # of one run that is measured the other needs nothing
    active, unknown = activity_matrix(after, before, lost=np.array([[True, True], [False, True]]))
    assert active[:, 0].tolist() == [False, True, True]
    assert not unknown.any()


@pytest.mark.parametrize(("change", "told"), [(0.0095, False), (0.0115, False), (0.014, True)])
def test_a_joint_whose_cells_noise_would_choose_is_left_untold(change: float, told: bool) -> None:
    beta = np.arcsin(change / (2.0 * np.sin(0.05)))
    # of an axis along gravity up to beta, seven joints; only the first keeps its angle to gravity
    arms = SkinnedArms(n_arms=1, cells_per_part=6, torso_cells=2, up=rotation(AXES[1], beta) @ AXES[0])
    program = StructuralExploration(QUICK, arms.n_dofs, arms.n_cells, 0)
    run(program, arms, noise_g=0.004, lsb_g=0.004)
    found = program.result
    assert found.untold.tolist() == [not told] + [False] * 6
    assert (found.activity[:, 1:] == arms.activity[:, 1:]).all()
    assert not told or (found.activity == arms.activity).all()


def test_a_joint_along_gravity_is_told_by_acceleration() -> None:
    arms = SkinnedArms(n_arms=1, cells_per_part=6, torso_cells=4, up=AXES[0])
    program = StructuralExploration(QUICK, arms.n_dofs, arms.n_cells, 0)
    run(program, arms, noise_g=0.004, lsb_g=0.004)
    knowledge = SelfModel(min_row_norm=0.05, min_lever_m=0.005)
    knowledge.structure = program.result
    assert knowledge.structure.untold.tolist() == [True] + [False] * 6
    assert "DoF 0 moves no cell" in knowledge.structure.problems[0]

    shaking = MapExploration(MapExplorationConfig(), arms.n_dofs, arms.n_cells, 0)
    run(shaking, arms, noise_g=0.004, lsb_g=0.004)
    knowledge.add_map(shaking.result)

    assert knowledge.structure.problems == ()
    assert (knowledge.structure.activity == arms.activity).all()
    J, W = arms.jacobian(arms.home_rad)[:, 0, 2], knowledge.sensory_motor_map.weights[0][:, 0]
    clear = np.abs(J) > 0.03
    assert clear.sum() > 10
    assert (np.sign(W[clear]) == -np.sign(J[clear])).all()


def test_a_joint_without_skin_is_told_from_one_along_gravity() -> None:
    known = find_structure(np.array([[0, 0, 0], [0, 1, 0], [0, 1, 0]], dtype=bool))
    accelerates = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0]], dtype=bool)
    found = complete_structure(known, accelerates, np.array([True, True, True]), dof_names="xyz")
    assert found.activity.tolist() == [[False] * 3, [True, True, False], [True, True, False]]
    assert found.problems == (
        "DoF z moves no cell: no skin distal to it, as neither gravity nor acceleration changes in any cell",
    )
    # what did not follow its sine stays open
    half = complete_structure(known, accelerates, np.array([True, True, False]), dof_names="xyz")
    assert half.problems == ("DoF z moves no cell: no skin distal to it, or its axis is parallel to gravity",)
    assert complete_structure(known, accelerates, np.array([False, True, False])) is known
