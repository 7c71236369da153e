"""Links that move against the one that is covered: what of its surface, and which cells, they reach."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_problem import RAY_START_DEPTH_M
from skinnet.body.contact.convex_hull import ConvexHulls, is_apart_from_hull
from skinnet.compilation import compiled_without_nrt
from skinnet.covering.felt_solids import FeltSolids, solid_entry_m
from skinnet.covering.hexagons import hexagon_grid, hexagon_rim

__all__ = ["LinkNeighbours", "Neighbour", "is_reached", "join_neighbours", "mark_reached"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_GRID, _WEIGHTS = hexagon_grid(3)
_CELL_POINTS = np.concatenate([hexagon_rim(6), _GRID[0.75 * _WEIGHTS.max() < _WEIGHTS]])
"""Points of a cell above which nothing may come, closer together on its rim: corners come in from there."""


class LinkNeighbours(NamedTuple):
    """Links that move against one link, in all their poses (s).

    Attributes:
        solids: Solids of all of them, each in the frame of its own body.
        pose: (s, 3, 4) R and t of that frame in the frame of the link.
        first: (s,) first solid of the neighbour that takes a pose.
        last: (s,) past last solid of it.
        below_m: (s,) depth under the cell [m] down to which it is kept away.
    """

    solids: FeltSolids
    pose: Floats
    first: Indices
    last: Indices
    below_m: Floats


class Neighbour(NamedTuple):
    """Link that moves against another one.

    Attributes:
        solids: Its solids, frame of its body.
        pose: (s, 3, 4) R and t of that frame in the frame of the other link.
        is_felt: True if skin on the other link feels it.
    """

    solids: FeltSolids
    pose: Floats
    is_felt: bool


def join_neighbours(neighbours: Sequence[Neighbour], none: FeltSolids) -> LinkNeighbours:
    """Join neighbours; without any, the solids `none` stand for theirs.

    A solid that is felt presses the foam from where the rays of contact start, under the rigid surface; one
    that is not is only kept out of the foam.
    """
    ends = np.cumsum([0, *(len(solids.kind) for solids, _, _ in neighbours)])
    of_pose = np.repeat(np.arange(len(neighbours)), [len(poses) for _, poses, _ in neighbours])
    below_m = np.array([RAY_START_DEPTH_M if is_felt else 0.0 for _, _, is_felt in neighbours])
    return LinkNeighbours(
        solids=_join_solids([solids for solids, _, _ in neighbours]) if neighbours else none,
        pose=np.concatenate([np.zeros((0, 3, 4)), *(poses for _, poses, _ in neighbours)]),
        first=ends[of_pose],
        last=ends[of_pose + 1],
        below_m=below_m[of_pose],
    )


def _join_solids(parts: Sequence[FeltSolids]) -> FeltSolids:
    """All solids of `parts`, at least one, as one, each still in its own frame."""
    hulls = [part.hulls for part in parts]
    n_hulls, n_triangles = (
        np.cumsum([0, *counts])
        for counts in ([len(own.centre_m) for own in hulls], [len(own.plane) for own in hulls])
    )
    later = list(zip(hulls, n_triangles, strict=False))
    return FeltSolids(
        geom_id=np.concatenate([part.geom_id for part in parts]),
        kind=np.concatenate([part.kind for part in parts]),
        size_m=np.concatenate([part.size_m for part in parts]),
        position_m=np.concatenate([part.position_m for part in parts]),
        R_body_solid=np.concatenate([part.R_body_solid for part in parts]),
        hull=np.concatenate(
            [np.where(part.hull >= 0, part.hull + k, -1) for part, k in zip(parts, n_hulls, strict=False)]
        ),
        hulls=ConvexHulls(
            first=np.concatenate([*(own.first[:-1] + k for own, k in later), n_triangles[-1:]]),
            centre_m=np.concatenate([own.centre_m for own in hulls]),
            plane=np.concatenate([own.plane for own in hulls]),
            line=np.concatenate([own.line for own in hulls]),
            neighbour=np.concatenate([own.neighbour + k for own, k in later]),
            start=np.concatenate([own.start + k for own, k in later]),
        ),
        corner_m=np.concatenate([part.corner_m for part in parts]),
        sphere_m=np.concatenate([part.sphere_m for part in parts]),
    )


@compiled_without_nrt
def mark_reached(
    point_m: Floats, normal: Floats, neighbours: LinkNeighbours, height_m: float, reached: Bools
) -> None:
    """Mark points (n,) above which a neighbour comes within `height_m` in one of its poses.

    Args:
        point_m: (n, 3) points on the link, frame of its body [m].
        normal: (n, 3) normals there, outwards.
        neighbours: Neighbours of the link.
        height_m: Height of the skin [m].
        reached: (n,) marks, set in place.
    """
    for i in range(len(point_m)):
        x, y, z = point_m[i]
        u, v, w = normal[i]
        for s in range(len(neighbours.pose)):
            if _is_point_reached(neighbours, s, x, y, z, u, v, w, height_m):
                reached[i] = True
                break


@compiled_without_nrt
def is_reached(
    neighbours: LinkNeighbours, position_m: Floats, R: Floats, side_m: float, height_m: float
) -> bool:
    """True if a neighbour comes within `height_m` [m] above a cell at `position_m` (3,) with axes `R`."""
    u, v, w = R[0, 2], R[1, 2], R[2, 2]
    for s in range(len(neighbours.pose)):
        below_m = neighbours.below_m[s]
        half_m, up_m = 0.5 * (height_m + below_m), 0.5 * (height_m - below_m)
        radius_m = math.sqrt(side_m * side_m + half_m * half_m)
        x, y, z = position_m[0] + up_m * u, position_m[1] + up_m * v, position_m[2] + up_m * w
        if _is_far(neighbours, s, x, y, z, radius_m):
            continue
        for i in range(len(_CELL_POINTS)):
            a, b = side_m * _CELL_POINTS[i, 0], side_m * _CELL_POINTS[i, 1]
            if _is_point_reached(
                neighbours,
                s,
                position_m[0] + a * R[0, 0] + b * R[0, 1] - below_m * u,
                position_m[1] + a * R[1, 0] + b * R[1, 1] - below_m * v,
                position_m[2] + a * R[2, 0] + b * R[2, 1] - below_m * w,
                u,
                v,
                w,
                height_m + below_m,
            ):
                return True
    return False


@compiled_without_nrt
def _is_far(neighbours: LinkNeighbours, s: int, x: float, y: float, z: float, radius_m: float) -> bool:
    """True if a sphere about (x, y, z) [m] is apart from the neighbour in pose `s`; False says nothing."""
    T, solids = neighbours.pose[s], neighbours.solids
    x, y, z = _turn_back(T, x - T[0, 3], y - T[1, 3], z - T[2, 3])
    for k in range(neighbours.first[s], neighbours.last[s]):
        dx, dy, dz = x - solids.sphere_m[k, 0], y - solids.sphere_m[k, 1], z - solids.sphere_m[k, 2]
        reach_m = solids.sphere_m[k, 3] + radius_m
        if dx * dx + dy * dy + dz * dz > reach_m * reach_m:
            continue
        if solids.hull[k] < 0 or not is_apart_from_hull(solids.hulls, solids.hull[k], x, y, z, radius_m):
            return False
    return True


@compiled_without_nrt
def _is_point_reached(
    neighbours: LinkNeighbours,
    s: int,
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    w: float,
    height_m: float,
) -> bool:
    """True if pose `s` brings a neighbour within `height_m` above a point (x, y, z), along (u, v, w)."""
    T = neighbours.pose[s]
    x, y, z = _turn_back(
        T, x + height_m * u - T[0, 3], y + height_m * v - T[1, 3], z + height_m * w - T[2, 3]
    )
    u, v, w = _turn_back(T, -u, -v, -w)
    sphere = neighbours.solids.sphere_m
    for k in range(neighbours.first[s], neighbours.last[s]):
        px, py, pz = sphere[k, 0] - x, sphere[k, 1] - y, sphere[k, 2] - z
        radius_m = sphere[k, 3] + 1e-9
        along_m = px * u + py * v + pz * w
        if along_m < -radius_m or along_m > height_m + radius_m:
            continue
        if px * px + py * py + pz * pz - along_m * along_m > radius_m * radius_m:
            continue
        if solid_entry_m(neighbours.solids, k, x, y, z, u, v, w) <= height_m:
            return True
    return False


@compiled_without_nrt
def _turn_back(T: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Vector (x, y, z) of the frame of the link in that of a neighbour at the pose `T` (3, 4)."""
    return (
        T[0, 0] * x + T[1, 0] * y + T[2, 0] * z,
        T[0, 1] * x + T[1, 1] * y + T[2, 1] * z,
        T[0, 2] * x + T[1, 2] * y + T[2, 2] * z,
    )
