"""Meshes of many alike marks: instances of a shape, sticks along polylines, diamonds at points."""

import numpy as np
from numpy.typing import NDArray

from skinnet.view.page.triangle_meshes import TriangleMesh

__all__ = ["diamonds", "instances", "polylines"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_DIAMOND = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
_DIAMOND_FACES = np.array(
    [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]]
)
_STICK_FACES = np.array(
    [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4], [2, 0, 5], [0, 3, 5], [0, 2, 1], [3, 4, 5]]
)
"""Triangular prism: corners 0 to 2 at the start, 3 to 5 at the end."""


def instances(shape: TriangleMesh, position_m: Floats, rotation: Floats) -> TriangleMesh:
    """One mesh of a shape at n positions (n, 3) [m] with rotations (n, 3, 3)."""
    vertices = np.einsum("nij,vj->nvi", rotation, shape.vertices_m) + position_m[:, None]
    return _merged(vertices, shape.faces)


def diamonds(position_m: Floats, radius_m: float) -> TriangleMesh:
    """Octahedra of `radius_m` [m] at n positions (n, 3) [m]."""
    return _merged(position_m[:, None] + radius_m * _DIAMOND, _DIAMOND_FACES)


def polylines(points_m: Floats, radius_m: float) -> TriangleMesh:
    """Sticks of `radius_m` [m] along n polylines (n, p, 3) [m]; sticks of no length are left out."""
    start_m, end_m = points_m[:, :-1].reshape(-1, 3), points_m[:, 1:].reshape(-1, 3)
    along = end_m - start_m
    length = np.sqrt((along**2).sum(axis=1))
    real = length > 1e-9
    start_m, end_m, along = start_m[real], end_m[real], along[real] / length[real, None]
    least = np.eye(3)[np.abs(along).argmin(axis=1)]  # the axis that is farthest from the stick
    u = np.cross(along, least)
    u /= np.sqrt((u**2).sum(axis=1, keepdims=True))
    v = np.cross(along, u)
    angles = 2.0 * np.pi / 3.0 * np.arange(3)
    rim_m = radius_m * (np.cos(angles)[:, None] * u[:, None] + np.sin(angles)[:, None] * v[:, None])
    return _merged(np.concatenate([start_m[:, None] + rim_m, end_m[:, None] + rim_m], axis=1), _STICK_FACES)


def _merged(vertices_m: Floats, faces: Indices) -> TriangleMesh:
    """Merge n copies of a shape with vertices (n, v, 3) [m] and equal `faces` (f, 3)."""
    n, v = vertices_m.shape[:2]
    shifted = faces[None] + v * np.arange(n)[:, None, None]
    return TriangleMesh(vertices_m.reshape(-1, 3), shifted.reshape(-1, 3))
