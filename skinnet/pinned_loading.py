"""Loading of the pinned functions that Python calls: compiled when a process starts, not when first needed.

A process that compiles in the middle of a run sends no period end meanwhile, and may miss the run's deadline.
"""

import numpy as np

from skinnet import pinned_arcs, pinned_least_squares, pinned_linalg, pinned_math, pinned_rotations

__all__ = ["load_pinned_functions"]


def load_pinned_functions() -> None:
    """Evaluate each of the pinned functions once."""
    square, vector = np.eye(3), np.full(3, 0.5)
    for scalar in (pinned_math.sin, pinned_math.cos, pinned_math.log, pinned_math.expm1):
        scalar(0.5)
    pinned_math.hypot(0.3, 0.4)
    for vectorised in (pinned_math.sin_of, pinned_math.cos_of, pinned_arcs.asin_of):
        vectorised(vector)
    for binary in (pinned_math.hypot_of, pinned_arcs.atan2_of):
        binary(vector, vector)
    for left, right in ((square, square), (square, vector), (square[None], square)):
        pinned_linalg.matmul(left, right)
    pinned_linalg.norm(vector)
    pinned_linalg.solve(square, vector)
    pinned_least_squares.non_negative_least_squares(square, vector)
    matrices = pinned_rotations.rotation_matrices(np.zeros((1, 3)))
    pinned_rotations.rotation_vectors(matrices)
    pinned_rotations.mean_rotation(matrices, np.ones(1))
