"""Pairs of points that lie near each other.

As `scipy.spatial.cKDTree`, whose import takes longer than the search among the cells of a patch.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["near_pairs", "near_pairs_between"]


def near_pairs(points_m: NDArray[np.float64], reach_m: float) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of points (n, 3) [m] at most `reach_m` apart, ascending."""
    return [(i, j) for i, j in near_pairs_between(points_m, points_m, reach_m) if i < j]


def near_pairs_between(
    one_m: NDArray[np.float64], other_m: NDArray[np.float64], reach_m: float
) -> list[tuple[int, int]]:
    """Pairs (i, j) of points i of (n, 3) and j of (k, 3) [m] at most `reach_m` apart, ascending.

    Points are compared with those in a slab of twice the reach, across the axis along which they spread most.
    """
    if not (len(one_m) and len(other_m)):
        return []
    axis = int(np.argmax(np.ptp(np.concatenate([one_m, other_m]), axis=0)))
    order = np.argsort(other_m[:, axis], kind="stable")
    along_m = other_m[order, axis]
    margin_m = reach_m * (1.0 + 1e-9)  # rounding of the sum excludes nobody
    first = np.searchsorted(along_m, one_m[:, axis] - margin_m, side="left")
    n = np.searchsorted(along_m, one_m[:, axis] + margin_m, side="right") - first
    i = np.repeat(np.arange(len(one_m)), n)
    j = order[np.arange(len(i)) + np.repeat(first - (np.cumsum(n) - n), n)]
    x_m, y_m, z_m = (one_m[i] - other_m[j]).T
    near = np.flatnonzero(x_m * x_m + y_m * y_m + z_m * z_m <= reach_m * reach_m)
    return sorted(zip(i[near].tolist(), j[near].tolist(), strict=True))
