"""Triangle meshes of shapes, cells and sheet elements, for the browser."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from skinnet.body.shapes import Shape
from skinnet.body.surface import hexagon_m

__all__ = ["Triangles", "join", "plate", "prism", "solid"]

_AROUND = 28
_SUBDIVISIONS = 2
_SHARP_RAD = 0.7
"""Angle [rad] between faces above which their edge stays sharp in shading."""


class Triangles(NamedTuple):
    """Triangle mesh: vertices (v, 3) [m] and faces (f, 3), counterclockwise from outside."""

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]


def solid(shape: Shape) -> Triangles:
    """Triangle mesh of a shape in the frame of its link; empty for a plane."""
    size = shape.size_m
    match shape.kind:
        case "box":
            mesh = trimesh.creation.box(2.0 * size)
        case "sphere":
            mesh = trimesh.creation.icosphere(_SUBDIVISIONS, size[0])
        case "ellipsoid":
            mesh = trimesh.creation.icosphere(_SUBDIVISIONS, 1.0)
            mesh.apply_scale(size)
        case "capsule":
            mesh = trimesh.creation.capsule(
                height=2.0 * size[1], radius=size[0], count=[_AROUND, _AROUND // 2]
            )
        case "cylinder":
            mesh = trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1], sections=_AROUND)
        case "mesh":
            mesh = trimesh.Trimesh(shape.vertices_m, shape.faces)
        case _:
            return Triangles(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    drawn = _with_edges(mesh)
    turn = Rotation.from_quat(shape.wxyz, scalar_first=True)
    return Triangles(turn.apply(drawn.vertices_m) + shape.position_m, drawn.faces)


def prism(side_m: float, height_m: float) -> Triangles:
    """Hexagonal prism of a cell, from z = 0 to `height_m`."""
    rim = hexagon_m(side_m)
    return _upright(rim, height_m)


def plate(side_m: float, height_m: float) -> Triangles:
    """Square plate of a sheet element, from z = 0 to `height_m`."""
    half_m = 0.5 * side_m
    return _upright(half_m * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]), height_m)


def join(parts: Sequence[Triangles]) -> Triangles:
    """Concatenate meshes to one."""
    shifts = np.cumsum([0, *(len(part.vertices_m) for part in parts)])
    return Triangles(
        np.vstack([part.vertices_m for part in parts]),
        np.vstack([part.faces + shift for part, shift in zip(parts, shifts, strict=False)]),
    )


def _upright(rim_m: NDArray[np.float64], height_m: float) -> Triangles:
    """Lid over a convex rim (n, 2) at `height_m` and walls down to z = 0, without a bottom."""
    n = len(rim_m)
    lid = np.column_stack([rim_m, np.full(n, height_m)])
    foot = np.column_stack([rim_m, np.zeros(n)])
    ahead = (np.arange(n) + 1) % n
    walls = np.stack([lid, foot, lid[ahead], foot[ahead]], axis=1).reshape(-1, 3)
    faces = [[0, i, i + 1] for i in range(1, n - 1)]
    for wall in range(n):
        first = n + 4 * wall
        faces += [[first, first + 1, first + 2], [first + 2, first + 1, first + 3]]
    return Triangles(np.vstack([lid, walls]), np.array(faces))


def _with_edges(mesh: trimesh.Trimesh) -> Triangles:
    smooth = trimesh.graph.smooth_shade(mesh, angle=_SHARP_RAD)
    return Triangles(np.array(smooth.vertices), np.array(smooth.faces))
