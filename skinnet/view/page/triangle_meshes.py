"""Triangle meshes of shapes, cells and sheet elements, for the browser."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from skinnet.body.contact.skin_surface import hexagon_m
from skinnet.body.visual_shapes import VisualShape

__all__ = ["TriangleMesh", "concatenate", "hexagonal_prism", "hull_mesh", "shape_mesh", "square_plate"]

_N_SECTORS = 28
_SUBDIVISIONS = 2
_EDGE_ANGLE_RAD = 0.7
"""Angle [rad] between faces above which their edge stays sharp in shading."""


class TriangleMesh(NamedTuple):
    """Triangle mesh: vertices (v, 3) [m] and faces (f, 3), counterclockwise from outside."""

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]


def shape_mesh(shape: VisualShape) -> TriangleMesh:
    """Triangle mesh of a shape in the frame of its link; empty for a plane."""
    size = shape.size_m
    match shape.geom_type:
        case "box":
            mesh = trimesh.creation.box(2.0 * size)
        case "sphere":
            mesh = trimesh.creation.icosphere(_SUBDIVISIONS, size[0])
        case "ellipsoid":
            mesh = trimesh.creation.icosphere(_SUBDIVISIONS, 1.0)
            mesh.apply_scale(size)
        case "capsule":
            mesh = trimesh.creation.capsule(
                height=2.0 * size[1], radius=size[0], count=[_N_SECTORS, _N_SECTORS // 2]
            )
        case "cylinder":
            mesh = trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1], sections=_N_SECTORS)
        case "mesh":
            mesh = trimesh.Trimesh(shape.vertices_m, shape.faces)
        case _:
            return TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    drawn = _with_sharp_edges(mesh)
    turn = Rotation.from_quat(shape.wxyz, scalar_first=True)
    return TriangleMesh(turn.apply(drawn.vertices_m) + shape.position_m, drawn.faces)


def hull_mesh(shape: VisualShape) -> TriangleMesh:
    """Triangle mesh of a shape as it is felt: a mesh as its convex hull, others as they are."""
    if shape.geom_type != "mesh":
        return shape_mesh(shape)
    hull = trimesh.Trimesh(shape.vertices_m, shape.faces).convex_hull
    return shape_mesh(replace(shape, vertices_m=np.array(hull.vertices), faces=np.array(hull.faces)))


def hexagonal_prism(side_m: float, height_m: float) -> TriangleMesh:
    """Hexagonal prism of a cell, from z = 0 to `height_m`."""
    rim = hexagon_m(side_m)
    return _extrude(rim, height_m)


def square_plate(side_m: float, height_m: float) -> TriangleMesh:
    """Square plate of a sheet element, from z = 0 to `height_m`."""
    half_m = 0.5 * side_m
    return _extrude(half_m * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]), height_m)


def concatenate(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Concatenate meshes to one."""
    shifts = np.cumsum([0, *(len(part.vertices_m) for part in meshes)])
    return TriangleMesh(
        np.vstack([part.vertices_m for part in meshes]),
        np.vstack([part.faces + shift for part, shift in zip(meshes, shifts, strict=False)]),
    )


def _extrude(rim_m: NDArray[np.float64], height_m: float) -> TriangleMesh:
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
    return TriangleMesh(np.vstack([lid, walls]), np.array(faces))


def _with_sharp_edges(mesh: trimesh.Trimesh) -> TriangleMesh:
    smooth = trimesh.graph.smooth_shade(mesh, angle=_EDGE_ANGLE_RAD)
    return TriangleMesh(np.array(smooth.vertices), np.array(smooth.faces))
