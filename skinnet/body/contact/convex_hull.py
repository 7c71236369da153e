"""Convex hulls of meshes, which is what MuJoCo collides, and rays against them.

A ray enters a convex hull through one triangle. Seen along the ray, the triangles that face it tile the
outline of the hull without overlap, so a walk from triangle to triangle, each time across an edge that
separates it from the ray, ends in the one that the ray meets, or leaves the outline (visibility walk;
Devillers, Pion, Teillaud, Walking in a triangulation, 2002; projections of a convex hull have no cycles). It
starts near its end: in the triangle that the last ray met, or in that of a table of directions. So a ray
costs a few steps, whatever the number of triangles.

Functions work in the frame of the geom, with scalars as in `ray_casting`.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.pinned_linalg import matmul

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

__all__ = [
    "ConvexHulls",
    "build_convex_hulls",
    "hull_entry",
    "hull_of",
    "hull_vertices_m",
    "is_apart_from_hull",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_DIRECTIONS_PER_SIDE = 12
"""Directions along a side of the table's cube: 864 a hull, within a triangle or two of fine hulls."""
_DIRECTIONS = 6 * _DIRECTIONS_PER_SIDE**2
_GRAZING = 1e-9
"""Cosine to a ray below which a triangle lies along it and is not entered."""
_MAX_STEPS = 1000
"""Steps of a walk before it is given up for a test of all planes: rounding could lead it in a circle."""


class ConvexHulls(NamedTuple):
    """Convex hulls of all meshes of a scene (h), their triangles one after another (t).

    Attributes:
        first: (h + 1,) first triangle of each hull, then the number of triangles.
        centre_m: (h, 3) a point inside [m].
        plane: (t, 4) outward unit normal n of each triangle and its offset n · x [m].
        line: (t, 3, 6) edges, counter-clockwise seen from outside: their vectors [m], and their moments about
            the origin, start × end [m²] (Plücker coordinates).
        neighbour: (t, 3) triangle on the other side of each edge.
        start: (h, d) triangle that a ray from the centre leaves by, for d directions (`_direction_cell`).
    """

    first: Indices
    centre_m: Floats
    plane: Floats
    line: Floats
    neighbour: Indices
    start: Indices


def hull_vertices_m(mj: mujoco.MjModel, mesh: int) -> Floats:
    """Vertices (v, 3) [m] of which MuJoCo collides the hull: those of its own hull, if it has built one."""
    vertices_m = mj.mesh_vert[mj.mesh_vertadr[mesh] :][: mj.mesh_vertnum[mesh]].astype(np.float64)
    graph = int(mj.mesh_graphadr[mesh])
    if graph >= 0:  # number of vertices, of faces, then edge addresses and ids of the vertices
        count = int(mj.mesh_graph[graph])
        vertices_m = vertices_m[mj.mesh_graph[graph + 2 + count :][:count]]
    hull: Floats = vertices_m
    return hull


def build_convex_hulls(vertices_m: Sequence[Floats]) -> ConvexHulls:
    """Build the convex hulls of sets of points (v, 3) [m].

    Raises:
        ValueError: points lie in a plane; its argument is the place in `vertices_m`.
    """
    parts = []
    for index, points_m in enumerate(vertices_m):
        try:
            parts.append(_hull(points_m))
        except ValueError as error:
            raise ValueError(index) from error
    first = np.concatenate([[0], np.cumsum([len(part[1]) for part in parts])]).astype(np.int64)
    return ConvexHulls(
        first=first,
        centre_m=np.array([part[0] for part in parts]).reshape(-1, 3),
        plane=np.concatenate([np.zeros((0, 4)), *(part[1] for part in parts)]),
        line=np.concatenate([np.zeros((0, 3, 6)), *(part[2] for part in parts)]),
        neighbour=np.concatenate(
            [np.zeros((0, 3), dtype=np.int64), *(p[3] + k for p, k in zip(parts, first[:-1], strict=True))]
        ),
        start=np.array(
            [part[4] + k for part, k in zip(parts, first[:-1], strict=True)], dtype=np.int64
        ).reshape(-1, _DIRECTIONS),
    )


def hull_of(points_m: Floats) -> "tuple[ConvexHull, Indices, Indices]":
    """Convex hull of points (v, 3) [m], its triangles (t, 3), and the triangles beside these (t, 3).

    Triangles are rows of the points, counter-clockwise from outside; neighbour k lies opposite to corner k.

    Raises:
        ValueError: the points lie in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # their import takes longer than most commands

    try:
        hull = ConvexHull(points_m)
    except QhullError as error:
        raise ValueError("the points lie in a plane") from error
    triangle, neighbour = hull.simplices.astype(np.int64), hull.neighbors.astype(np.int64)
    corner_m = hull.points[triangle]
    normal = np.cross(corner_m[:, 1] - corner_m[:, 0], corner_m[:, 2] - corner_m[:, 0])
    inwards = np.einsum("ti,ti->t", normal, hull.equations[:, :3]) < 0.0
    triangle[inwards, 1:], neighbour[inwards, 1:] = triangle[inwards, :0:-1], neighbour[inwards, :0:-1]
    return hull, triangle, neighbour


def _hull(points_m: Floats) -> tuple[Floats, Floats, Floats, Indices, Indices]:
    """Centre, planes, lines, neighbours and start triangles of one hull, as in `ConvexHulls`."""
    hull, triangle, neighbour = hull_of(points_m)
    corner_m = hull.points[triangle]
    end_m = np.roll(corner_m, -1, axis=1)
    centre_m = hull.points[hull.vertices].mean(axis=0)
    plane = hull.equations * np.array([1.0, 1.0, 1.0, -1.0])
    # qhull's neighbour k lies opposite to corner k; the edge from corner k lies opposite to corner k + 2
    return (
        centre_m,
        plane,
        np.concatenate([end_m - corner_m, np.cross(corner_m, end_m)], axis=2),
        np.roll(neighbour, 1, axis=1),
        _start_triangles(plane, centre_m),
    )


def _start_triangles(plane: Floats, centre_m: Floats) -> Indices:
    """Triangle (d,) by which a ray from the centre leaves a hull, for each direction of the table."""
    height_m = plane[:, 3] - matmul(plane[:, :3], centre_m)
    axis, sign, row, column = np.unravel_index(
        np.arange(_DIRECTIONS), (3, 2, _DIRECTIONS_PER_SIDE, _DIRECTIONS_PER_SIDE)
    )
    direction = np.empty((_DIRECTIONS, 3))
    each = np.arange(_DIRECTIONS)
    direction[each, axis] = 1.0 - 2.0 * sign
    direction[each, (axis + 1) % 3] = (2.0 * row + 1.0) / _DIRECTIONS_PER_SIDE - 1.0
    direction[each, (axis + 2) % 3] = (2.0 * column + 1.0) / _DIRECTIONS_PER_SIDE - 1.0
    start: Indices = np.argmax(matmul(direction, plane[:, :3].T) / height_m, axis=1).astype(np.int64)
    return start


@compiled_without_nrt
def _direction_cell(u: float, v: float, w: float) -> int:
    """Row of the direction (u, v, w), not zero, in a table of directions: cells on the faces of a cube."""
    a, b, c = abs(u), abs(v), abs(w)
    if a >= b and a >= c:
        axis, major, first, second = 0, u, v, w
    elif b >= c:
        axis, major, first, second = 1, v, w, u
    else:
        axis, major, first, second = 2, w, u, v
    scale = 0.5 * _DIRECTIONS_PER_SIDE / max(abs(major), 1e-300)
    row = min(int(first * scale + 0.5 * _DIRECTIONS_PER_SIDE), _DIRECTIONS_PER_SIDE - 1)
    column = min(int(second * scale + 0.5 * _DIRECTIONS_PER_SIDE), _DIRECTIONS_PER_SIDE - 1)
    side = 2 * axis + (1 if major < 0.0 else 0)
    return (side * _DIRECTIONS_PER_SIDE + row) * _DIRECTIONS_PER_SIDE + column


@compiled_without_nrt
def is_apart_from_hull(hulls: ConvexHulls, h: int, x: float, y: float, z: float, radius_m: float) -> bool:
    """True if a plane of hull `h` separates it from the sphere of `radius_m` around (x, y, z) [m].

    One triangle is tried, that in the direction of the sphere; False says nothing.
    """
    u, v, w = x - hulls.centre_m[h, 0], y - hulls.centre_m[h, 1], z - hulls.centre_m[h, 2]
    plane, i = hulls.plane, hulls.start[h, _direction_cell(u, v, w)]
    return bool(plane[i, 0] * x + plane[i, 1] * y + plane[i, 2] * z - plane[i, 3] > radius_m)


@compiled_without_nrt
def hull_entry(
    hulls: ConvexHulls, h: int, x: float, y: float, z: float, u: float, v: float, w: float, near: int
) -> tuple[float, int]:
    """Ray distance [m] from (x, y, z) along unit (u, v, w) to hull `h`, and the triangle where it ended.

    Zero if the origin is inside, infinity if the ray misses. `near` is a triangle to start from, such as that
    of the last ray, or -1.
    """
    first_m, found = _line_entry(hulls, h, x, y, z, u, v, w, near)
    if first_m >= 0.0:
        return first_m, found
    last_m, _ = _line_entry(hulls, h, x, y, z, -u, -v, -w, -1)
    return (0.0 if last_m <= 0.0 else math.inf), found


@compiled_without_nrt
def _line_entry(
    hulls: ConvexHulls, h: int, x: float, y: float, z: float, u: float, v: float, w: float, near: int
) -> tuple[float, int]:
    """Distance [m] along a line to where it enters hull `h`, negative behind its origin, infinity if never.

    An edge from a to b passes the line on the side of d · ((a − o) × (b − o)), which is negative for all
    edges of the triangle that is met; with the moment of the edge, a × b, that is
    d · (a × b) − (b − a) · (d × o).
    """
    plane, line = hulls.plane, hulls.line
    i = near if near >= 0 else _facing_triangle(hulls, h, x, y, z, u, v, w)
    if plane[i, 0] * u + plane[i, 1] * v + plane[i, 2] * w > -_GRAZING:
        i = _facing_triangle(hulls, h, x, y, z, u, v, w)
    mx, my, mz = v * z - w * y, w * x - u * z, u * y - v * x
    for _ in range(_MAX_STEPS):
        beyond = -1
        for k in range(3):
            side = (
                u * line[i, k, 3]
                + v * line[i, k, 4]
                + w * line[i, k, 5]
                - (line[i, k, 0] * mx + line[i, k, 1] * my + line[i, k, 2] * mz)
            )
            if side > 0.0:
                beyond = k
                break
        facing = plane[i, 0] * u + plane[i, 1] * v + plane[i, 2] * w
        if beyond < 0:
            height_m = plane[i, 0] * x + plane[i, 1] * y + plane[i, 2] * z - plane[i, 3]
            return -height_m / facing, i
        after = hulls.neighbour[i, beyond]
        if plane[after, 0] * u + plane[after, 1] * v + plane[after, 2] * w > -_GRAZING:
            return math.inf, i  # the edge belongs to the outline
        i = after
    return _clipped_entry(hulls, h, x, y, z, u, v, w)


@compiled_without_nrt
def _facing_triangle(
    hulls: ConvexHulls, h: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> int:
    """Triangle of hull `h` that faces a line, near to where the line enters the hull.

    That towards the point where the line would enter a sphere around the hull's centre; if it does
    not face the line, that opposite to the line's direction, else the one that faces the line most.
    """
    plane = hulls.plane
    cx, cy, cz = x - hulls.centre_m[h, 0], y - hulls.centre_m[h, 1], z - hulls.centre_m[h, 2]
    along = cx * u + cy * v + cz * w
    cx, cy, cz = cx - along * u, cy - along * v, cz - along * w
    # where the line would enter a sphere as large as the hull is in the direction of the line
    i: int = hulls.start[h, _direction_cell(-u, -v, -w)]
    radius_m = plane[i, 3] - (
        plane[i, 0] * hulls.centre_m[h, 0]
        + plane[i, 1] * hulls.centre_m[h, 1]
        + plane[i, 2] * hulls.centre_m[h, 2]
    )
    off_m2 = cx * cx + cy * cy + cz * cz
    back_m = math.sqrt(max(radius_m * radius_m - off_m2, 0.0))
    first: int = hulls.start[h, _direction_cell(cx - back_m * u, cy - back_m * v, cz - back_m * w)]
    if plane[first, 0] * u + plane[first, 1] * v + plane[first, 2] * w <= -_GRAZING:
        return first
    best, most = i, plane[i, 0] * u + plane[i, 1] * v + plane[i, 2] * w
    if most <= -_GRAZING:
        return i
    for j in range(hulls.first[h], hulls.first[h + 1]):
        facing = plane[j, 0] * u + plane[j, 1] * v + plane[j, 2] * w
        if facing < most:
            best, most = j, facing
    return best


@compiled_without_nrt
def _clipped_entry(
    hulls: ConvexHulls, h: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> tuple[float, int]:
    """Clip a line by all planes of hull `h`: as `_line_entry`, without a walk."""
    plane, first_m, last_m, met = hulls.plane, -math.inf, math.inf, hulls.first[h]
    for i in range(hulls.first[h], hulls.first[h + 1]):
        facing = plane[i, 0] * u + plane[i, 1] * v + plane[i, 2] * w
        height_m = plane[i, 0] * x + plane[i, 1] * y + plane[i, 2] * z - plane[i, 3]
        if abs(facing) <= _GRAZING:
            if height_m > 0.0:
                return math.inf, met
        elif facing < 0.0 and -height_m / facing > first_m:
            first_m, met = -height_m / facing, i
        elif facing > 0.0:
            last_m = min(last_m, -height_m / facing)
    return (first_m if first_m <= last_m else math.inf), met
