"""How well the contacts together can carry the object in every direction: what a singular posture lacks."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["mobility"]

Floats = NDArray[np.float64]


def mobility(J_x: Floats, weights: Floats, lever_m: float) -> float:
    """Share of a small shift of the object that the contacts can follow in the worst direction, 0 to 1.

    All contacts are asked to move by the same unit vector, by damped least squares (Nakamura and Hanafusa,
    1986); the share is what they move along it in the weighted mean, and the worst direction is the smallest
    eigenvalue. One contact whose worst lever is `lever_m` has one half. More contacts than joints can move
    are no singularity, as long as together they carry the object.

    Args:
        J_x: (C, 3, N) Jacobians of the contacts [m/rad].
        weights: (C,) position weights.
        lever_m: Joint levers below this count as lost.
    """
    share = weights / weights.sum()
    stacked = J_x.reshape(-1, J_x.shape[2])
    weighted = stacked * np.repeat(share, 3)[:, None]
    asked = weighted.T @ np.tile(np.eye(3), (len(weights), 1))
    hessian = weighted.T @ stacked + lever_m**2 * np.eye(J_x.shape[2])
    follows = asked.T @ np.linalg.solve(hessian, asked)
    return float(np.linalg.eigvalsh(0.5 * (follows + follows.T))[0])
