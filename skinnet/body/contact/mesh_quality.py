"""Quality of meshes that skin feels as their convex hulls: gap to the hull, open edges, orientation."""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from skinnet.body.contact.convex_hull import hull_vertices_m
from skinnet.compilation import compiled_without_nrt

__all__ = ["hull_gap_m", "is_inward", "open_edges"]

Floats = NDArray[np.float64]

_SAMPLES = 4000
"""Points on the hull, about, at which its distance from the mesh is taken."""
_MAX_STEPS_PER_EDGE = 64


def open_edges(mj: mujoco.MjModel, mesh: int) -> int:
    """Count the edges of a mesh that no other face has in the opposite direction: 0 if it is closed."""
    _, vertex = np.unique(_vertices_m(mj, mesh), axis=0, return_inverse=True)
    face = vertex.reshape(-1)[_faces(mj, mesh)]
    edges = np.concatenate([face[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
    edges = edges[edges[:, 0] != edges[:, 1]]
    n = len(_vertices_m(mj, mesh))
    there, back = edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0]
    return int((~np.isin(there, back)).sum())


def is_inward(mj: mujoco.MjModel, mesh: int) -> bool:
    """True if the faces of a mesh point inwards: the volume that they enclose is negative."""
    corner_m = _vertices_m(mj, mesh)[_faces(mj, mesh)]
    return bool(np.linalg.det(corner_m - corner_m.mean(axis=(0, 1))).sum() < 0.0)


def hull_gap_m(mj: mujoco.MjModel, mesh: int) -> float:
    """Largest distance [m] of the convex hull of a mesh, which is felt, from the mesh, which is seen.

    Taken at points all over the hull, so somewhat too small between them.
    """
    corner_m = np.ascontiguousarray(_vertices_m(mj, mesh)[_faces(mj, mesh)])
    centre_m = corner_m.mean(axis=1)
    radius_m = np.linalg.norm(corner_m - centre_m[:, None], axis=2).max(axis=1)
    points_m = _points_on_hull_m(hull_vertices_m(mj, mesh))
    first = np.asarray(cKDTree(centre_m).query(points_m)[1], dtype=np.int64)
    return _largest_distance_m(points_m, corner_m, centre_m, radius_m, first)


def _vertices_m(mj: mujoco.MjModel, mesh: int) -> Floats:
    vertices: Floats = mj.mesh_vert[mj.mesh_vertadr[mesh] :][: mj.mesh_vertnum[mesh]].astype(np.float64)
    return vertices


def _faces(mj: mujoco.MjModel, mesh: int) -> NDArray[np.int32]:
    faces: NDArray[np.int32] = mj.mesh_face[mj.mesh_faceadr[mesh] :][: mj.mesh_facenum[mesh]]
    return faces


def _points_on_hull_m(vertices_m: Floats) -> Floats:
    """Points (s, 3) [m] all over the hull of `vertices_m`, at most some millimetres apart on a link."""
    hull = ConvexHull(vertices_m)
    spacing_m, points_m = math.sqrt(hull.area / _SAMPLES), []
    for corner_m in hull.points[hull.simplices]:
        longest_m = np.linalg.norm(corner_m - np.roll(corner_m, 1, axis=0), axis=1).max()
        steps = min(math.ceil(longest_m / spacing_m), _MAX_STEPS_PER_EDGE)
        i, j = np.nonzero(np.add.outer(np.arange(steps + 1), np.arange(steps + 1)) <= steps)
        weight = np.column_stack([i, j, steps - i - j]) / steps
        points_m.append(weight @ corner_m)
    return np.concatenate(points_m)


@compiled_without_nrt
def _largest_distance_m(
    points_m: Floats, corner_m: Floats, centre_m: Floats, radius_m: Floats, first: NDArray[np.int64]
) -> float:
    """Largest distance [m] of points (s, 3) from triangles (t, 3, 3) with bounding spheres.

    `first` (s,) is a triangle near each point, whose distance rules most others out.
    """
    largest_m2 = 0.0
    for s in range(len(points_m)):
        x, y, z = points_m[s, 0], points_m[s, 1], points_m[s, 2]
        nearest_m2 = _squared_distance_m2(corner_m, first[s], x, y, z)
        for t in range(len(centre_m)):
            if nearest_m2 <= largest_m2:
                break
            dx, dy, dz = x - centre_m[t, 0], y - centre_m[t, 1], z - centre_m[t, 2]
            reach_m = math.sqrt(nearest_m2) + radius_m[t]
            if dx * dx + dy * dy + dz * dz < reach_m * reach_m:
                nearest_m2 = min(nearest_m2, _squared_distance_m2(corner_m, t, x, y, z))
        largest_m2 = max(largest_m2, nearest_m2)
    return math.sqrt(largest_m2)


@compiled_without_nrt
def _squared_distance_m2(corner_m: Floats, t: int, x: float, y: float, z: float) -> float:
    """Squared distance [m²] of a point from triangle `t`: from its plane over it, else from its edges."""
    ax, ay, az = x - corner_m[t, 0, 0], y - corner_m[t, 0, 1], z - corner_m[t, 0, 2]
    ux, uy, uz = (
        corner_m[t, 1, 0] - corner_m[t, 0, 0],
        corner_m[t, 1, 1] - corner_m[t, 0, 1],
        corner_m[t, 1, 2] - corner_m[t, 0, 2],
    )
    vx, vy, vz = (
        corner_m[t, 2, 0] - corner_m[t, 0, 0],
        corner_m[t, 2, 1] - corner_m[t, 0, 1],
        corner_m[t, 2, 2] - corner_m[t, 0, 2],
    )
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    au, av = ax * ux + ay * uy + az * uz, ax * vx + ay * vy + az * vz
    area = uu * vv - uv * uv
    if area > 0.0:
        b, c = (vv * au - uv * av) / area, (uu * av - uv * au) / area
        if b >= 0.0 and c >= 0.0 and b + c <= 1.0:
            dx, dy, dz = ax - b * ux - c * vx, ay - b * uy - c * vy, az - b * uz - c * vz
            return float(dx * dx + dy * dy + dz * dz)
    nearest_m2 = math.inf
    for k in range(3):
        m = (k + 1) % 3
        ex, ey, ez = (
            corner_m[t, m, 0] - corner_m[t, k, 0],
            corner_m[t, m, 1] - corner_m[t, k, 1],
            corner_m[t, m, 2] - corner_m[t, k, 2],
        )
        px, py, pz = x - corner_m[t, k, 0], y - corner_m[t, k, 1], z - corner_m[t, k, 2]
        length_m2 = ex * ex + ey * ey + ez * ez
        along = min(max((px * ex + py * ey + pz * ez) / max(length_m2, 1e-300), 0.0), 1.0)
        dx, dy, dz = px - along * ex, py - along * ey, pz - along * ez
        nearest_m2 = min(nearest_m2, dx * dx + dy * dy + dz * dz)
    return nearest_m2
