"""Sensory-motor map: weights of the DoFs that move a cell along its normal, like an inverted Jacobian.

Equations (2) and (3) of [M14, III.B]. Sign: with a positive weight, a positive velocity of the DoF moves the
cell inwards, along its negative normal, so that reaction (4) with a positive gain evades.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import dot, norm

__all__ = ["MapAgreement", "SensoryMotorMap", "compare_maps", "fuse_with_activity", "normal_weights"]


def normal_weights(deflection_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute weights along the surface normal: equation (2) of [M14].

    Args:
        deflection_m: (S, D, 3) signed deflections of the axes x, y, z (the outward normal) of every cell per
            acceleration of every DoF; all zero where not measured.

    Returns:
        (S, D) weights in −1…1, the fraction of the deflection along the normal; zero where not measured.
    """
    total = np.abs(deflection_m).sum(axis=2)
    weights: NDArray[np.float64] = np.divide(
        -deflection_m[:, :, 2], total, out=np.zeros(total.shape), where=total > 0
    )
    return weights


def fuse_with_activity(
    activity: NDArray[np.bool_], weights: NDArray[np.float64], min_row_norm: float = 0.1
) -> NDArray[np.float64]:
    """Mask weights by the activity matrix and normalise the rows: equation (3) of [M14] and its sequel.

    Args:
        activity: (S, D) from the structural exploration.
        weights: (S, D) from `normal_weights`.
        min_row_norm: row norm below which a cell cannot move along its normal without locomotion; such rows
            become zero. [M14] gives no number: an assumption.

    Returns:
        (S, D) map with rows of norm one or zero.
    """
    fused = np.where(activity, weights, 0.0)
    norm = np.linalg.norm(fused, axis=1, keepdims=True)
    result: NDArray[np.float64] = np.divide(fused, norm, out=np.zeros_like(fused), where=norm > min_row_norm)
    return result


class SensoryMotorMap:
    """Sensory-motor maps W (S, D), each valid around the pose (D,) in which it was explored."""

    def __init__(self) -> None:
        """Start without maps."""
        self._poses_rad: list[NDArray[np.float64]] = []
        self._weights: list[NDArray[np.float64]] = []

    def __len__(self) -> int:
        return len(self._poses_rad)

    @property
    def poses_rad(self) -> NDArray[np.float64]:
        """Explored poses (P, D), oldest first."""
        return np.array(self._poses_rad)

    @property
    def weights(self) -> NDArray[np.float64]:
        """Maps (P, S, D) of the explored poses."""
        return np.array(self._weights)

    def add(self, pose_rad: NDArray[np.float64], weights: NDArray[np.float64]) -> None:
        """Add the map (S, D) of a pose (D,).

        Raises:
            ValueError: the shapes differ from one another or from the maps before.
        """
        if pose_rad.shape != weights.shape[1:] or (self._weights and weights.shape != self._weights[0].shape):
            raise ValueError(
                f"pose {pose_rad.shape} and weights {weights.shape} do not match; expected (D,) and (S, "
                "D), as in earlier maps"
            )
        self._poses_rad.append(pose_rad.astype(np.float64))
        self._weights.append(weights.astype(np.float64))

    def remove(self, pose_rad: NDArray[np.float64]) -> None:
        """Remove the maps of exactly this pose (D,)."""
        kept = [i for i, pose in enumerate(self._poses_rad) if not np.array_equal(pose, pose_rad)]
        self._poses_rad = [self._poses_rad[i] for i in kept]
        self._weights = [self._weights[i] for i in kept]

    def closest(self, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the map (S, D) of the explored pose closest in joint space, the oldest of equals.

        Raises:
            LookupError: nothing was explored.
        """
        if not self._poses_rad:
            raise LookupError("the sensory-motor map is empty; explore a pose first")
        distance = np.linalg.norm(self.poses_rad - position_rad, axis=1)
        return self._weights[int(np.argmin(distance))]

    def explored_at(self, position_rad: NDArray[np.float64], within_rad: float) -> NDArray[np.float64] | None:
        """Return the map (S, D) explored within `within_rad` of a pose in every joint; None without one.

        Of several, that of the nearest pose, and the newest of equals.
        """
        found, least_rad = None, within_rad
        for pose_rad, weights in zip(self._poses_rad, self._weights, strict=True):
            distance_rad = float(np.abs(pose_rad - position_rad).max())
            if distance_rad <= least_rad:
                found, least_rad = weights, distance_rad
        return found


@dataclass(frozen=True)
class MapAgreement:
    """Agreement of a sensory-motor map with its ground truth."""

    sign_fraction: float
    """Fraction of equal signs among entries with a true magnitude above the cut; NaN without any."""
    correlation: float
    """Pearson correlation over all entries; NaN if one of the maps is constant."""
    n_entries: int
    """Number of entries above the cut."""


def compare_maps(
    weights: NDArray[np.float64], true_weights: NDArray[np.float64], min_abs_weight: float = 0.1
) -> MapAgreement:
    """Compare two maps (S, D): signs where the truth exceeds `min_abs_weight`, correlation over all."""
    large = np.abs(true_weights) > min_abs_weight
    entries = int(np.count_nonzero(large))
    same = np.sign(weights[large]) == np.sign(true_weights[large])
    a, b = weights.ravel() - weights.mean(), true_weights.ravel() - true_weights.mean()
    scale = norm(a) * norm(b)
    return MapAgreement(
        sign_fraction=float(same.mean()) if entries else math.nan,
        correlation=dot(a, b) / scale if scale > 0 else math.nan,
        n_entries=entries,
    )
