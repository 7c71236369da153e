"""Mobility measure of the contacts: detection of singular postures by damped least squares."""

import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import matmul, smallest_eigenvalue, solve

__all__ = ["mobility"]

Floats = NDArray[np.float64]


def mobility(J_x: Floats, weights: Floats, damping_m: float) -> float:
    """Return the fraction of a small object shift that the contacts follow in the worst direction, 0 to 1.

    All contacts are commanded by the same unit vector, solved by damped least squares (Nakamura and Hanafusa,
    1986). The fraction is the weighted mean of their motion along that vector; its minimum over all
    directions is the smallest eigenvalue. One contact whose smallest singular value is `damping_m` has one
    half. More contacts than the joints can move independently are no singularity.

    Args:
        J_x: (C, 3, N) Jacobians of the contacts [m/rad].
        weights: (C,) position weights [1/m²].
        damping_m: Damping, the singular value of the Jacobian at which the fraction is one half [m/rad].
    """
    share = weights / weights.sum()
    stacked = J_x.reshape(-1, J_x.shape[2])
    weighted = stacked * np.repeat(share, 3)[:, None]
    asked = matmul(weighted.T, np.tile(np.eye(3), (len(weights), 1)))
    hessian = matmul(weighted.T, stacked) + damping_m * damping_m * np.eye(J_x.shape[2])
    follows = matmul(asked.T, solve(hessian, asked))
    return smallest_eigenvalue(0.5 * (follows + follows.T))
