"""Rotations whose matrices and vectors do not depend on the CPU; SciPy's call the C library and BLAS."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.compilation import compiled
from skinnet.pinned_arcs import atan2
from skinnet.pinned_linalg import matmul, symmetric_eigen
from skinnet.pinned_math import cos, sin

__all__ = ["mean_rotation", "rotation_matrices", "rotation_vectors"]

Floats = NDArray[np.float64]
_SMALL_RAD = 1e-3
"""Angle below which sin(θ/2)/θ is its series, to 1e-19."""


@compiled
def _quaternion_into(matrix: Floats, q: Floats) -> None:
    """Fill `q` with the unit quaternion (x, y, z, w), w ≥ 0, of a rotation matrix (Shepperd, 1978)."""
    trace = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
    i = 3
    largest = trace
    for k in range(3):
        if matrix[k, k] > largest:
            i, largest = k, matrix[k, k]
    if i == 3:
        q[0], q[1], q[2] = (
            matrix[2, 1] - matrix[1, 2],
            matrix[0, 2] - matrix[2, 0],
            matrix[1, 0] - matrix[0, 1],
        )
        q[3] = 1.0 + trace
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = 1.0 - trace + 2.0 * matrix[i, i]
        q[j], q[k] = matrix[j, i] + matrix[i, j], matrix[k, i] + matrix[i, k]
        q[3] = matrix[k, j] - matrix[j, k]
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    sign = -1.0 if q[3] < 0.0 else 1.0
    for m in range(4):
        q[m] = sign * q[m] / length


@compiled
def _quaternions(matrices: Floats) -> Floats:
    found = np.empty((len(matrices), 4))
    for n in range(len(matrices)):
        _quaternion_into(matrices[n], found[n])
    return found


@compiled
def _vectors(quaternions: Floats) -> Floats:
    found = np.empty((len(quaternions), 3))
    for n in range(len(quaternions)):
        x, y, z, w = quaternions[n, 0], quaternions[n, 1], quaternions[n, 2], quaternions[n, 3]
        half_sine = math.sqrt(x * x + y * y + z * z)
        scale = 2.0 if half_sine == 0.0 else 2.0 * atan2(half_sine, w) / half_sine
        found[n, 0], found[n, 1], found[n, 2] = scale * x, scale * y, scale * z
    return found


@compiled
def _matrix_into(x: float, y: float, z: float, w: float, out: Floats) -> None:
    """Fill `out` (3, 3) with the rotation of the unit quaternion (x, y, z, w)."""
    out[0, 0], out[0, 1], out[0, 2] = (
        x * x - y * y - z * z + w * w,
        2.0 * (x * y - z * w),
        2.0 * (x * z + y * w),
    )
    out[1, 0], out[1, 1], out[1, 2] = (
        2.0 * (x * y + z * w),
        w * w - x * x + y * y - z * z,
        2.0 * (y * z - x * w),
    )
    out[2, 0], out[2, 1], out[2, 2] = (
        2.0 * (x * z - y * w),
        2.0 * (y * z + x * w),
        w * w - x * x - y * y + z * z,
    )


@compiled
def _matrices(vectors: Floats) -> Floats:
    found = np.empty((len(vectors), 3, 3))
    for n in range(len(vectors)):
        x, y, z = vectors[n, 0], vectors[n, 1], vectors[n, 2]
        angle2 = x * x + y * y + z * z
        angle = math.sqrt(angle2)
        if angle < _SMALL_RAD:
            scale = 0.5 - angle2 / 48.0 + angle2 * angle2 / 3840.0
        else:
            scale = sin(0.5 * angle) / angle
        _matrix_into(scale * x, scale * y, scale * z, cos(0.5 * angle), found[n])
    return found


def rotation_vectors(matrices: ArrayLike) -> Floats:
    """Return rotation vectors (n, 3) [rad], of lengths 0 to π, of rotation matrices (n, 3, 3)."""
    vectors: Floats = _vectors(_quaternions(np.ascontiguousarray(matrices, dtype=np.float64)))
    return vectors


def rotation_matrices(vectors_rad: ArrayLike) -> Floats:
    """Return rotation matrices (n, 3, 3) of rotation vectors (n, 3) [rad]."""
    matrices: Floats = _matrices(np.ascontiguousarray(vectors_rad, dtype=np.float64))
    return matrices


def mean_rotation(matrices: Floats, weights: Floats) -> Floats:
    """Return the weighted mean (3, 3) of rotations (n, 3, 3): that of the least chordal distances.

    It is the eigenvector of the largest eigenvalue of Σ w q qᵀ (Markley et al., 2007).
    """
    q = _quaternions(np.ascontiguousarray(matrices, dtype=np.float64))
    x, y, z, w = symmetric_eigen(matmul((weights[:, None] * q).T, q))[1][:, -1].tolist()
    mean = np.empty((3, 3))
    _matrix_into(x, y, z, w, mean)
    return mean
