"""Nearest point of the convex hull of a mesh within a cone, in compiled code; frames as in `cone_solids`."""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.convex_hull import hull_of, hull_vertices_m
from skinnet.body.proximity.cone_pieces import ball_rank, facet_rank
from skinnet.compilation import compiled_without_nrt

__all__ = ["N_FACET_COLUMNS", "hull_distance_m", "hull_facets_m"]

N_FACET_COLUMNS = 13
"""Columns of a facet: corner, two edges, centre and radius of the bounding ball [m]."""


def hull_facets_m(mj: mujoco.MjModel, mesh: int) -> NDArray[np.float64]:
    """Triangles (t, 13) [m] of the convex hull of a mesh, which is the one that skin feels.

    Raises:
        ValueError: the mesh is flat.
    """
    hull, triangle, _ = hull_of(hull_vertices_m(mj, mesh))
    corner_m = hull.points[triangle]
    centre_m = corner_m.mean(axis=1)
    radius_m = np.linalg.norm(corner_m - centre_m[:, None], axis=2).max(axis=1)
    edge_m = corner_m[:, 1:] - corner_m[:, :1]
    columns = [corner_m[:, 0], edge_m[:, 0], edge_m[:, 1], centre_m, radius_m]
    facets: NDArray[np.float64] = np.column_stack(columns)
    return facets


@compiled_without_nrt
def hull_distance_m(
    cx: float,
    cy: float,
    cz: float,
    ux: float,
    uy: float,
    uz: float,
    vx: float,
    vy: float,
    vz: float,
    wx: float,
    wy: float,
    wz: float,
    facets_m: NDArray[np.float64],
    first: int,
    end: int,
    nearest_m: float,
    cosine: float,
    sine: float,
) -> float:
    """Distance [m] of a convex hull, if it is less than `nearest_m`.

    Only triangles that face the sensor count, and of those the ones whose bounding ball is nearer than what
    was found; the search begins with the ball that is nearest in view.

    Args:
        cx: Origin of the hull's frame [m], with cy and cz; u, v and w are its axes.
        cy: See cx.
        cz: See cx.
        ux: See cx, as all axes.
        uy: See cx.
        uz: See cx.
        vx: See cx.
        vy: See cx.
        vz: See cx.
        wx: See cx.
        wy: See cx.
        wz: See cx.
        facets_m: (t, 13) triangles in the frame of the hull: corner, two edges, centre and radius of the
            bounding ball [m]; counter-clockwise from outside.
        first: First triangle of the hull.
        end: One past its last.
        nearest_m: Distance beyond which nothing is of interest [m].
        cosine: Of the half angle of the cone.
        sine: See cosine.
    """
    # the sensor in the frame of the hull, and its axis
    px, py, pz = (
        -(cx * ux + cy * uy + cz * uz),
        -(cx * vx + cy * vy + cz * vz),
        -(cx * wx + cy * wy + cz * wz),
    )
    begin, nearest_ball, inside = -1, math.inf, True
    for i in range(first, end):
        ax, ay, az = facets_m[i, 3], facets_m[i, 4], facets_m[i, 5]
        bx, by, bz = facets_m[i, 6], facets_m[i, 7], facets_m[i, 8]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        x, y, z = facets_m[i, 0] - px, facets_m[i, 1] - py, facets_m[i, 2] - pz
        if x * nx + y * ny + z * nz >= 0.0:
            continue
        inside = False
        x, y, z = facets_m[i, 9] - px, facets_m[i, 10] - py, facets_m[i, 11] - pz
        distance2 = x * x + y * y + z * z
        if distance2 < nearest_ball:
            nearest_ball, begin = distance2, i
    if inside:
        return 0.0
    found = math.inf
    for step in range(first - 1, end):
        i = begin if step < first else step
        bx, by, bz, radius = facets_m[i, 9], facets_m[i, 10], facets_m[i, 11], facets_m[i, 12]
        x, y, z = bx - px, by - py, bz - pz
        reach = nearest_m + radius
        if x * x + y * y + z * z > reach * reach:
            continue
        x, y, z = x * ux + y * vx + z * wx, x * uy + y * vy + z * wy, x * uz + y * vz + z * wz
        if ball_rank(x, y, z, radius, cosine, sine) > nearest_m:
            continue
        x, y, z = facets_m[i, 0] - px, facets_m[i, 1] - py, facets_m[i, 2] - pz
        ox, oy, oz = x * ux + y * vx + z * wx, x * uy + y * vy + z * wy, x * uz + y * vz + z * wz
        x, y, z = facets_m[i, 3], facets_m[i, 4], facets_m[i, 5]
        ax, ay, az = x * ux + y * vx + z * wx, x * uy + y * vy + z * wy, x * uz + y * vz + z * wz
        x, y, z = facets_m[i, 6], facets_m[i, 7], facets_m[i, 8]
        bx, by, bz = x * ux + y * vx + z * wx, x * uy + y * vy + z * wy, x * uz + y * vz + z * wz
        rank = facet_rank(ox, oy, oz, ax, ay, az, bx, by, bz, True, cosine, sine)
        if rank < nearest_m:
            nearest_m = found = rank
    return found
