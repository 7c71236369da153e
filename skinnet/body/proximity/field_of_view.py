"""Field of view of the proximity sensors: a cone about the normal of each cell, and the solids in it."""

import math
from typing import NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact import ray_casting as geometry
from skinnet.body.contact.contact_scene import ContactScene, flat_mesh_error, may_intersect_sphere
from skinnet.body.contact.point_kinematics import Motion, cell_axis, point_above_cell
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.body.proximity.cone_hulls import N_FACET_COLUMNS, hull_distance_m, hull_facets_m
from skinnet.body.proximity.cone_pieces import OUT_OF_VIEW, ball_rank, half_space_distance_m
from skinnet.body.proximity.cone_solids import (
    box_distance_m,
    capsule_distance_m,
    cylinder_distance_m,
    ellipsoid_distance_m,
)
from skinnet.compilation import compiled_without_nrt

__all__ = ["FieldOfView", "distance_in_view_m"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class FieldOfView(NamedTuple):
    """Field of view of the proximity sensors of all cells, and the hulls of the meshes of a scene.

    Attributes:
        range_m: Range above the face of the foam [m].
        cosine: Cosine of the half angle of the cone about the outward normal.
        sine: Its sine.
        ball_m: Distance from the apex to the centre of a ball that holds the cone up to its range [m].
        ball_radius_m: Radius of that ball [m].
        first_facet: (k + 1,) first triangle of each solid of the scene, then their number; primitives: none.
        facets_m: (t, 13) triangles of all hulls, as in `hull_distance_m`, frames of the geoms [m].
    """

    range_m: float
    cosine: float
    sine: float
    ball_m: float
    ball_radius_m: float
    first_facet: Indices
    facets_m: Floats

    @classmethod
    def build(cls, mj: mujoco.MjModel, scene: ContactScene, range_m: float, half_angle_rad: float) -> Self:
        """Build the field of view of cells in `scene`, a cone of `half_angle_rad` [rad], below 90°.

        Raises:
            ModelError: a mesh of the scene is flat.
        """
        cosine = pinned_math.cos(half_angle_rad)
        is_narrow = cosine > 0.5  # the ball through the apex and the rim is smaller than that about the apex
        none = np.zeros((0, N_FACET_COLUMNS))
        facets = [
            _facets_m(mj, int(geom)) if kind == geometry.MESH else none
            for geom, kind in zip(scene.geom_id, scene.geom_type, strict=True)
        ]
        return cls(
            range_m=range_m,
            cosine=cosine,
            sine=pinned_math.sin(half_angle_rad),
            ball_m=0.5 * range_m / cosine if is_narrow else 0.0,
            ball_radius_m=0.5 * range_m / cosine if is_narrow else range_m,
            first_facet=np.cumsum([0, *map(len, facets)]).astype(np.int64),
            facets_m=np.concatenate([none, *facets]),
        )


def _facets_m(mj: mujoco.MjModel, geom: int) -> Floats:
    """Triangles (t, 13) [m] of the hull of a mesh geom."""
    try:
        return hull_facets_m(mj, int(mj.geom_dataid[geom]))
    except ValueError as error:
        raise flat_mesh_error(mj, geom) from error


@compiled_without_nrt
def distance_in_view_m(
    view: FieldOfView,
    surface: SkinSurface,
    scene: ContactScene,
    motion: Motion,
    i: int,
    thickness_m: float,
    near: Indices,
    n_near: int,
) -> float:
    """Distance [m] from the face of cell `i` to the nearest point in view of the solids `near[:n_near]`.

    Infinity if there is none within range, zero if the face is inside a solid.
    """
    px, py, pz = point_above_cell(surface, motion, i, thickness_m)
    zx, zy, zz = cell_axis(surface, motion, i, 2)
    mx, my, mz = px + view.ball_m * zx, py + view.ball_m * zy, pz + view.ball_m * zz
    nearest_m = math.inf
    for j in range(n_near):
        if may_intersect_sphere(scene, motion, near[j], mx, my, mz, view.ball_radius_m):
            limit_m = min(nearest_m, view.range_m)
            distance_m = _solid_distance_m(view, surface, scene, motion, i, near[j], px, py, pz, limit_m)
            if distance_m <= limit_m:
                nearest_m = distance_m
    return nearest_m


@compiled_without_nrt
def _solid_distance_m(
    view: FieldOfView,
    surface: SkinSurface,
    scene: ContactScene,
    motion: Motion,
    i: int,
    k: int,
    px: float,
    py: float,
    pz: float,
    limit_m: float,
) -> float:
    """Distance [m] from the face of cell `i`, (px, py, pz), to solid `k` in view; inf beyond `limit_m`."""
    g, cosine, sine = scene.geom_id[k], view.cosine, view.sine
    dx, dy, dz = motion.geom_xpos[g, 0] - px, motion.geom_xpos[g, 1] - py, motion.geom_xpos[g, 2] - pz
    xx, xy, xz = cell_axis(surface, motion, i, 0)
    yx, yy, yz = cell_axis(surface, motion, i, 1)
    zx, zy, zz = cell_axis(surface, motion, i, 2)
    cx, cy, cz = dx * xx + dy * xy + dz * xz, dx * yx + dy * yy + dz * yz, dx * zx + dy * zy + dz * zz
    kind, a, b, c = scene.geom_type[k], scene.size_m[k, 0], scene.size_m[k, 1], scene.size_m[k, 2]
    if kind != geometry.PLANE:
        bound = ball_rank(cx, cy, cz, scene.bounding_radius_m[k], cosine, sine)
        if bound > limit_m:
            return math.inf
        if kind == geometry.SPHERE:
            return bound if bound < OUT_OF_VIEW else math.inf
    axes = motion.geom_xmat
    wx = axes[g, 2] * xx + axes[g, 5] * xy + axes[g, 8] * xz
    wy = axes[g, 2] * yx + axes[g, 5] * yy + axes[g, 8] * yz
    wz = axes[g, 2] * zx + axes[g, 5] * zy + axes[g, 8] * zz
    if kind == geometry.PLANE:
        return half_space_distance_m(-wx, -wy, -wz, -(cx * wx + cy * wy + cz * wz), cosine, sine)
    if kind == geometry.CAPSULE:
        return capsule_distance_m(cx, cy, cz, wx, wy, wz, a, b, cosine, sine)
    ux = axes[g, 0] * xx + axes[g, 3] * xy + axes[g, 6] * xz
    uy = axes[g, 0] * yx + axes[g, 3] * yy + axes[g, 6] * yz
    uz = axes[g, 0] * zx + axes[g, 3] * zy + axes[g, 6] * zz
    vx = axes[g, 1] * xx + axes[g, 4] * xy + axes[g, 7] * xz
    vy = axes[g, 1] * yx + axes[g, 4] * yy + axes[g, 7] * yz
    vz = axes[g, 1] * zx + axes[g, 4] * zy + axes[g, 7] * zz
    if kind == geometry.BOX:
        return box_distance_m(cx, cy, cz, ux, uy, uz, vx, vy, vz, wx, wy, wz, a, b, c, cosine, sine)
    if kind == geometry.CYLINDER:
        return cylinder_distance_m(cx, cy, cz, ux, uy, uz, vx, vy, vz, wx, wy, wz, a, b, cosine, sine)
    if kind == geometry.ELLIPSOID:
        return ellipsoid_distance_m(cx, cy, cz, ux, uy, uz, vx, vy, vz, wx, wy, wz, a, b, c, cosine)
    if kind == geometry.MESH:
        return hull_distance_m(
            cx,
            cy,
            cz,
            ux,
            uy,
            uz,
            vx,
            vy,
            vz,
            wx,
            wy,
            wz,
            view.facets_m,
            view.first_facet[k],
            view.first_facet[k + 1],
            limit_m,
            cosine,
            sine,
        )
    return math.inf
