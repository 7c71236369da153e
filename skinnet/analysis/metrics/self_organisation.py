"""Self-organisation metrics: explored structure and sensory-motor map against the model."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.analysis.metrics.model_reference import ModelReference
from skinnet.analysis.metrics.stages import stage_intervals
from skinnet.deployment import Deployment
from skinnet.pinned_linalg import dot, norm
from skinnet.runtime.process_result import ProcessResult

__all__ = ["map_metrics", "structure_metrics"]

_MIN_COMPARED_WEIGHT = 0.1
"""Smallest true weight of a unit row whose sign is compared."""


def structure_metrics(
    deployment: Deployment, controller: ProcessResult, reference: ModelReference
) -> dict[str, Any]:
    """Metrics of structural exploration: wrong entries of the activity matrix, size of the tree, duration.

    A tree that lacks a joint is a tree: `structure.is_tree` tells that the parts fit together,
    `structure.wrong_entries` that they are those of the model. Joints that move no cell, as far as was found,
    are named, with the wrong entries in their columns: the rest is right if those are all.
    """
    if "structure" not in controller.facts:
        return {}
    found = controller.facts["structure"]
    activity = controller.arrays["activity"]
    spans = stage_intervals(deployment, controller, "structure")
    wrong = activity != reference.activity
    untold = ~np.logical_or.reduce(activity, axis=0)
    named: dict[str, Any] = {}
    if untold.any():
        named = {
            "structure.untold_joints": [deployment.body.joints[dof] for dof in np.flatnonzero(untold)],
            "structure.untold_entries": int(np.count_nonzero(wrong[:, untold])),
        }
    return named | {
        "structure.wrong_entries": int(np.count_nonzero(wrong)),
        "structure.entries": int(activity.size),
        "structure.body_parts": len(found["parts"]),
        "structure.joints": len(found["joints"]),
        "structure.is_tree": _is_tree(found, activity),
        "structure.problems": list(found["problems"]),
        "structure.duration_s": sum(span.end_ns - span.start_ns for span in spans) * 1e-9,
    }


def map_metrics(
    deployment: Deployment, controller: ProcessResult, reference: ModelReference
) -> dict[str, Any]:
    """Agreement of the explored map with the analytic normal Jacobian, in the poses where it was explored.

    The reference goes through the same equations of [M14]: (2) takes the fraction of the normal among the
    three axes, (3) the entries of DoFs that move the cell, and every row has unit norm. `correlation_normal`
    compares with the plain normal Jacobian instead, also with rows of unit norm.
    """
    if "map" not in controller.arrays:
        return {}
    maps, poses = controller.arrays["map"], controller.arrays["map_pose_rad"]
    jacobians = [reference.cell_jacobian(pose) for pose in poses]
    kept = np.abs(maps).sum(axis=2, keepdims=True) > 0.0
    shares = np.array([_unit_rows(_normal_fraction(jacobian)) for jacobian in jacobians]) * kept
    plain = np.array([_unit_rows(-jacobian[:, :, 2]) for jacobian in jacobians]) * kept
    large = np.abs(shares) > _MIN_COMPARED_WEIGHT
    return {
        "smm.sign_agreement": float(np.mean(np.sign(maps[large]) == np.sign(shares[large]))),
        "smm.correlation": _correlation(maps, shares),
        "smm.correlation_normal": _correlation(maps, plain),
        "smm.entries_compared": int(np.count_nonzero(large)),
        "smm.excluded_cells": int(np.count_nonzero(~kept)),
        "smm.problems": list(controller.facts["map_problems"]),
    }


def _is_tree(found: dict[str, Any], activity: NDArray[np.bool_]) -> bool:
    """True if one part rests, all others have one parent, and no joint leads to two of them."""
    roots = [part for part, parent in enumerate(found["parent_part"]) if parent < 0]
    joints = [joint for joint in found["parent_joint"] if joint >= 0]
    if len(roots) != 1 or len(set(joints)) < len(joints):
        return False
    return not activity[list(found["parts"][roots[0]])].any()


def _normal_fraction(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normal fraction of the true motion by equation (2) of [M14]; positive is inwards, as in the map."""
    total = np.abs(jacobian).sum(axis=2)
    share: NDArray[np.float64] = np.divide(
        -jacobian[:, :, 2], total, out=np.zeros(total.shape), where=total > 1e-9
    )
    return share


def _correlation(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Pearson correlation of two arrays; NaN if one is constant."""
    a, b = (one - one.mean()).ravel(), (other - other.mean()).ravel()
    scale = norm(a) * norm(b)
    return dot(a, b) / scale if scale > 0.0 else math.nan


def _unit_rows(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    norm = np.linalg.norm(matrix, axis=1, keepdims=True)
    unit: NDArray[np.float64] = np.divide(matrix, norm, out=np.zeros_like(matrix), where=norm > 1e-9)
    return unit
