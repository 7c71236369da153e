"""Heights of a link under one flat cell: at points of its hexagon, and the greatest of all."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact.convex_hull import hull_entry
from skinnet.compilation import compiled_without_nrt
from skinnet.covering.felt_solids import FeltSolids, first_entry_m, solid_entry_m
from skinnet.covering.hexagons import in_hexagon

__all__ = ["heights_under_cell", "peak_m"]

Floats = NDArray[np.float64]

_FIRST_STEP, _LAST_STEP = 0.15, 0.005
"""First and last step of the search for the peak under a cell, as fractions of its side."""
_DIRECTIONS = np.array(
    [(pinned_math.cos(math.radians(a)), pinned_math.sin(math.radians(a))) for a in range(0, 360, 30)]
)


@compiled_without_nrt
def heights_under_cell(
    solids: FeltSolids,
    position_m: Floats,
    R: Floats,
    points: Floats,
    side_m: float,
    start_m: float,
    depth_m: float,
    heights_m: Floats,
) -> None:
    """Heights (p,) [m] of the solids above the plane of a cell at `points` (p, 2) of its hexagon, in place.

    Rays start `start_m` above the plane; where they start inside a solid, that is the height. Heights below
    −`depth_m` are −inf.
    """
    nx, ny, nz = R[0, 2], R[1, 2], R[2, 2]
    x0, y0, z0 = position_m[0] + start_m * nx, position_m[1] + start_m * ny, position_m[2] + start_m * nz
    reach_m = start_m + depth_m
    for i in range(len(points)):
        heights_m[i] = -math.inf
    for k in range(len(solids.kind)):
        px, py, pz = solids.sphere_m[k, 0] - x0, solids.sphere_m[k, 1] - y0, solids.sphere_m[k, 2] - z0
        radius_m = solids.sphere_m[k, 3] + 1e-9
        along_m = -(px * nx + py * ny + pz * nz)
        if along_m < -radius_m or along_m > reach_m + radius_m:
            continue
        beside_m = radius_m + side_m
        if px * px + py * py + pz * pz - along_m * along_m > beside_m * beside_m:
            continue
        near = -1  # rays of one cell meet neighbouring triangles
        for i in range(len(points)):
            a, b = side_m * points[i, 0], side_m * points[i, 1]
            x, y, z = (
                x0 + a * R[0, 0] + b * R[0, 1],
                y0 + a * R[1, 0] + b * R[1, 1],
                z0 + a * R[2, 0] + b * R[2, 1],
            )
            if solids.hull[k] >= 0:
                entry_m, near = hull_entry(solids.hulls, solids.hull[k], x, y, z, -nx, -ny, -nz, near)
            else:
                entry_m = solid_entry_m(solids, k, x, y, z, -nx, -ny, -nz)
            if entry_m <= reach_m:
                heights_m[i] = max(heights_m[i], start_m - entry_m)


@compiled_without_nrt
def peak_m(
    solids: FeltSolids,
    position_m: Floats,
    R: Floats,
    points: Floats,
    heights_m: Floats,
    side_m: float,
    start_m: float,
) -> float:
    """Greatest height [m] of the solids under a cell: the highest point known, and uphill from there.

    The height of a convex solid is concave over the cell, so that a search with shrinking steps finds its
    peak, also a corner or an edge between the points. Arguments as those of `heights_under_cell`, of which
    `heights_m` are the results.
    """
    best = 0
    for i in range(1, len(points)):
        if heights_m[i] > heights_m[best]:
            best = i
    top_m: float = heights_m[best]
    x, y, step = points[best, 0], points[best, 1], _FIRST_STEP
    while step > _LAST_STEP:
        risen = False
        for k in range(12):
            a, b = x + step * _DIRECTIONS[k, 0], y + step * _DIRECTIONS[k, 1]
            if not in_hexagon(a, b, 1.0):
                continue
            entry_m = first_entry_m(
                solids,
                position_m[0] + side_m * (a * R[0, 0] + b * R[0, 1]) + start_m * R[0, 2],
                position_m[1] + side_m * (a * R[1, 0] + b * R[1, 1]) + start_m * R[1, 2],
                position_m[2] + side_m * (a * R[2, 0] + b * R[2, 1]) + start_m * R[2, 2],
                -R[0, 2],
                -R[1, 2],
                -R[2, 2],
                2.0 * start_m,
            )
            if start_m - entry_m > top_m + 1e-7:
                top_m, x, y, risen = start_m - entry_m, a, b, True
                break
        if not risen:
            step *= 0.5
    return top_m
