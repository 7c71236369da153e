"""Metrics of self-organisation against the model: perfect exploration, and faults that each must show."""

from typing import Any

import numpy as np
import pytest
from locations import DEPLOYMENTS

from controller.selforganisation.kinematic_structure import find_structure
from skinnet.analysis.metrics.model_reference import ModelReference
from skinnet.analysis.metrics.self_organisation import map_metrics, structure_metrics
from skinnet.deployment import load
from skinnet.runtime.process_result import ProcessResult

ARM = load(DEPLOYMENTS / "two_link_arm.toml")
S = 1_000_000_000


@pytest.fixture(scope="module")
def reference() -> ModelReference:
    return ModelReference(ARM, DEPLOYMENTS)


def structure_of(activity: np.ndarray, reference: ModelReference) -> dict[str, Any]:
    """Metrics of an exploration that found `activity` in five seconds."""
    found = find_structure(activity)
    facts = {
        "structure": {
            "parts": found.parts,
            "joints": found.joints,
            "parent_part": list(found.parent_part),
            "parent_joint": list(found.parent_joint),
            "problems": found.problems,
        },
        "stages": [["structure", 1 * S], ["map", 6 * S]],
        "end_ns": 9 * S,
    }
    result = ProcessResult("controller", "controller", facts, {"activity": activity})
    return structure_metrics(ARM, result, reference)


def test_a_right_structure(reference: ModelReference) -> None:
    metrics = structure_of(reference.activity, reference)
    assert metrics == {
        "structure.wrong_entries": 0,
        "structure.entries": 15 * 3,
        "structure.body_parts": 3,
        "structure.joints": 2,
        "structure.is_tree": True,
        "structure.problems": [],
        "structure.duration_s": 5.0,
    }


def test_a_joint_that_moves_nothing_leaves_a_tree_with_wrong_entries(reference: ModelReference) -> None:
    activity = reference.activity.copy()
    activity[:, 2] = False
    metrics = structure_of(activity, reference)
    assert metrics["structure.is_tree"]
    assert metrics["structure.wrong_entries"] == metrics["structure.untold_entries"] == 3
    assert metrics["structure.untold_joints"] == [ARM.body.joints[2]]
    assert metrics["structure.body_parts"] == 2
    assert "DoF 2 moves no cell" in metrics["structure.problems"][0]


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param([(0, 2)], id="a cell of the base moves with the elbow as well: one joint, two parts"),
        pytest.param([(14, 0), (14, 1)], id="the tip moves with the elbow alone"),
        pytest.param([(slice(0, 6), slice(None))], id="all cells of the base swing like the tip"),
    ],
)
def test_what_is_no_tree_is_none(wrong: list[tuple[Any, Any]], reference: ModelReference) -> None:
    activity = reference.activity.copy()
    for entry in wrong:
        activity[entry] = ~activity[entry]
    metrics = structure_of(activity, reference)
    assert metrics["structure.wrong_entries"] > 0
    assert not metrics["structure.is_tree"], metrics
    assert metrics["structure.problems"]


def map_of(matrix: np.ndarray, reference: ModelReference) -> dict[str, Any]:
    facts = {"map_problems": ["one"]}
    arrays = {"map": matrix[None], "map_pose_rad": np.array([list(ARM.body.home_rad.values())])}
    return map_metrics(ARM, ProcessResult("controller", "controller", facts, arrays), reference)


def true_map(reference: ModelReference) -> np.ndarray:
    """Inward velocity of each cell per joint velocity, rows of unit norm: the analytic normal Jacobian."""
    inwards: np.ndarray = -reference.cell_jacobian(np.array(list(ARM.body.home_rad.values())))[:, :, 2]
    norm = np.linalg.norm(inwards, axis=1, keepdims=True)
    unit: np.ndarray = np.divide(inwards, norm, out=np.zeros_like(inwards), where=norm > 1e-9)
    return unit


def test_the_normal_jacobian_has_the_right_signs(reference: ModelReference) -> None:
    metrics = map_of(true_map(reference), reference)
    assert metrics["smm.sign_agreement"] == 1.0
    assert metrics["smm.correlation_normal"] == pytest.approx(1.0)
    assert 0.9 < metrics["smm.correlation"] < 1.0
    assert metrics["smm.excluded_cells"] == 6
    assert metrics["smm.problems"] == ["one"]


def test_a_reversed_joint_shows_in_sign_and_correlation(reference: ModelReference) -> None:
    right, reversed_elbow = true_map(reference), true_map(reference)
    reversed_elbow[:, 2] *= -1.0
    before, after = map_of(right, reference), map_of(reversed_elbow, reference)
    compared = before["smm.entries_compared"]
    wrong = round((1.0 - after["smm.sign_agreement"]) * compared)
    assert 0 < wrong <= 3
    assert after["smm.correlation_normal"] < before["smm.correlation_normal"] - 0.1
    assert map_of(-right, reference)["smm.sign_agreement"] == 0.0


def test_a_cell_that_was_left_out_is_counted_and_not_compared(reference: ModelReference) -> None:
    partial = true_map(reference)
    partial[14] = 0.0
    whole, metrics = map_of(true_map(reference), reference), map_of(partial, reference)
    assert metrics["smm.excluded_cells"] == whole["smm.excluded_cells"] + 1
    assert metrics["smm.entries_compared"] < whole["smm.entries_compared"]
    assert metrics["smm.sign_agreement"] == 1.0
