"""Parallel rays from the points of one cell against one solid: heights at which they enter it.

All rays of a cell have the direction of its normal. What depends on it alone is computed once, and the rest
are short loops without calls, which the compiler turns into vector instructions. The formulas are those of
`ray_casting`; meshes are walked ray by ray (`convex_hull`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_scene import ContactScene, world_to_solid
from skinnet.body.contact.convex_hull import ConvexHulls, hull_entry
from skinnet.body.contact.point_kinematics import Motion, cell_axis, point_above_cell, rotate_inverse
from skinnet.body.contact.ray_casting import BOX, CAPSULE, CYLINDER, ELLIPSOID, MESH, SPHERE
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_inline, compiled_without_nrt

__all__ = ["CellInSolid", "cast_rays", "cell_in_solid", "lowest_height_m"]

Floats = NDArray[np.float64]
_PARALLEL = 1e-300
"""Direction component that stands for zero: a ray along a face meets its plane far away."""
_ALONG_AXIS = 1e-18
"""Squared sine of the angle to an axis below which a ray runs along it."""


class CellInSolid(NamedTuple):
    """Frame of a cell in that of a solid: where its rays start, and its axes; z is their direction.

    Attributes:
        x: Start of the ray at the centre of the cell [m], with y and z.
        y: See x.
        z: See x.
        xx: x axis of the cell, with xy and xz.
        xy: See xx.
        xz: See xx.
        yx: y axis of the cell, with yy and yz.
        yy: See yx.
        yz: See yx.
        zx: Normal of the cell, with zy and zz.
        zy: See zx.
        zz: See zx.
        stretch: Factor of x by which rays of a curved piece of skin are farther apart at its face.
    """

    x: float
    y: float
    z: float
    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float
    stretch: float


@compiled_inline
def cell_in_solid(
    surface: SkinSurface, scene: ContactScene, motion: Motion, i: int, k: int, start_m: float, stretch: float
) -> CellInSolid:
    """Frame of cell `i` in that of solid `k`, with rays that start `start_m` [m] below the rigid surface."""
    g, axes = scene.geom_id[k], motion.geom_xmat
    x, y, z = point_above_cell(surface, motion, i, -start_m)
    x, y, z = world_to_solid(scene, motion, k, x, y, z)
    u, v, w = cell_axis(surface, motion, i, 0)
    xx, xy, xz = rotate_inverse(axes, g, u, v, w)
    u, v, w = cell_axis(surface, motion, i, 1)
    yx, yy, yz = rotate_inverse(axes, g, u, v, w)
    u, v, w = cell_axis(surface, motion, i, 2)
    zx, zy, zz = rotate_inverse(axes, g, u, v, w)
    return CellInSolid(x, y, z, xx, xy, xz, yx, yy, yz, zx, zy, zz, stretch)


@compiled_inline
def lowest_height_m(scene: ContactScene, k: int, f: CellInSolid) -> float:
    """Lowest height [m] of solid `k` above the start of the rays; of a bounding volume for meshes."""
    kind, a, b, c = scene.geom_type[k], scene.size_m[k, 0], scene.size_m[k, 1], scene.size_m[k, 2]
    centre_m = -(f.x * f.zx + f.y * f.zy + f.z * f.zz)
    if kind == SPHERE:
        return float(centre_m - a)
    if kind == CAPSULE:
        return float(centre_m - a - b * abs(f.zz))
    if kind == BOX:
        return float(centre_m - a * abs(f.zx) - b * abs(f.zy) - c * abs(f.zz))
    if kind == CYLINDER:
        return float(centre_m - a * math.sqrt(f.zx * f.zx + f.zy * f.zy) - b * abs(f.zz))
    if kind == ELLIPSOID:
        u, v, w = a * f.zx, b * f.zy, c * f.zz
        return centre_m - math.sqrt(u * u + v * v + w * w)
    if kind == MESH:
        box_m = scene.bounding_box_m
        centre_m += box_m[k, 0] * f.zx + box_m[k, 1] * f.zy + box_m[k, 2] * f.zz
        return float(centre_m - box_m[k, 3] * abs(f.zx) - box_m[k, 4] * abs(f.zy) - box_m[k, 5] * abs(f.zz))
    return -math.inf


@compiled_inline
def cast_rays(
    scene: ContactScene,
    k: int,
    f: CellInSolid,
    point_x_m: Floats,
    point_y_m: Floats,
    first: int,
    last: int,
    height_m: Floats,
) -> None:
    """Cast rays from points `first` to `last` of a cell at solid `k`; fill their heights [m].

    Heights count from the start of the rays: zero inside the solid, infinity where it is missed.
    """
    if scene.geom_type[k] == MESH:
        _mesh(scene.hulls, scene.hull[k], f, point_x_m, point_y_m, first, last, height_m)
    else:
        _primitive(
            scene.geom_type[k],
            scene.size_m[k, 0],
            scene.size_m[k, 1],
            scene.size_m[k, 2],
            f,
            point_x_m,
            point_y_m,
            first,
            last,
            height_m,
        )


@compiled_without_nrt
def _mesh(
    hulls: ConvexHulls,
    h: int,
    f: CellInSolid,
    point_x_m: Floats,
    point_y_m: Floats,
    first: int,
    last: int,
    height_m: Floats,
) -> None:
    triangle = -1  # where the last ray ended
    for i in range(first, last):
        p, q = f.stretch * point_x_m[i], point_y_m[i]
        x, y, z = f.x + p * f.xx + q * f.yx, f.y + p * f.xy + q * f.yy, f.z + p * f.xz + q * f.yz
        height_m[i], triangle = hull_entry(hulls, h, x, y, z, f.zx, f.zy, f.zz, triangle)


@compiled_without_nrt
def _primitive(
    kind: int,
    a: float,
    b: float,
    c: float,
    f: CellInSolid,
    point_x_m: Floats,
    point_y_m: Floats,
    first: int,
    last: int,
    height_m: Floats,
) -> None:
    x_m, y_m, enter_m = point_x_m[first:last], point_y_m[first:last], height_m[first:last]
    if kind == SPHERE:
        _sphere(f, a, 0.0, x_m, y_m, enter_m, False)
    elif kind == BOX:
        _box(f, a, b, c, x_m, y_m, enter_m)
    elif kind == CYLINDER:
        _cylinder(f, a, b, x_m, y_m, enter_m)
    elif kind == CAPSULE:
        _cylinder(f, a, b, x_m, y_m, enter_m)
        _sphere(f, a, b, x_m, y_m, enter_m, True)
        _sphere(f, a, -b, x_m, y_m, enter_m, True)
    elif kind == ELLIPSOID:
        _ellipsoid(f, a, b, c, x_m, y_m, enter_m)
    else:
        _plane(f, x_m, y_m, enter_m)


@compiled_without_nrt
def _sphere(
    f: CellInSolid,
    radius_m: float,
    at_z_m: float,
    point_x_m: Floats,
    point_y_m: Floats,
    height_m: Floats,
    in_union: bool,
) -> None:
    """Sphere at (0, 0, `at_z_m`); in a union with what `height_m` already holds."""
    x, y, z = f.x, f.y, f.z - at_z_m
    cx, cy = -(x * f.xx + y * f.xy + z * f.xz), -(x * f.yx + y * f.yy + z * f.yz)
    cz = -(x * f.zx + y * f.zy + z * f.zz)
    for i in range(len(height_m)):
        u, v = f.stretch * point_x_m[i] - cx, point_y_m[i] - cy
        rest_m2 = radius_m * radius_m - u * u - v * v
        root_m = math.sqrt(rest_m2 if rest_m2 > 0.0 else 0.0)
        enter_m = cz - root_m
        enter_m = enter_m if enter_m > 0.0 else 0.0
        enter_m = enter_m if rest_m2 >= 0.0 and cz + root_m >= 0.0 else math.inf
        known_m = height_m[i] if in_union else math.inf
        height_m[i] = enter_m if enter_m < known_m else known_m


@compiled_without_nrt
def _ellipsoid(
    f: CellInSolid,
    a: float,
    b: float,
    c: float,
    point_x_m: Floats,
    point_y_m: Floats,
    height_m: Floats,
) -> None:
    """Ellipsoid, scaled to the unit sphere: the ray parameter, a distance, is invariant."""
    u, v, w = f.zx / a, f.zy / b, f.zz / c
    x0, xx, yx = f.x / a, f.xx / a, f.yx / a
    y0, xy, yy = f.y / b, f.xy / b, f.yy / b
    z0, xz, yz = f.z / c, f.xz / c, f.yz / c
    square = u * u + v * v + w * w
    inverse = 1.0 / square
    for i in range(len(height_m)):
        p, q = f.stretch * point_x_m[i], point_y_m[i]
        x, y, z = x0 + p * xx + q * yx, y0 + p * xy + q * yy, z0 + p * xz + q * yz
        along, rest = x * u + y * v + z * w, x * x + y * y + z * z - 1.0
        discriminant = along * along - square * rest
        root = math.sqrt(discriminant if discriminant > 0.0 else 0.0)
        enter_m, leave_m = (-along - root) * inverse, (-along + root) * inverse
        enter_m = enter_m if enter_m > 0.0 else 0.0
        height_m[i] = enter_m if discriminant >= 0.0 and leave_m >= 0.0 else math.inf


@compiled_without_nrt
def _cylinder(
    f: CellInSolid,
    radius_m: float,
    half_m: float,
    point_x_m: Floats,
    point_y_m: Floats,
    height_m: Floats,
) -> None:
    square = f.zx * f.zx + f.zy * f.zy
    is_along = square < _ALONG_AXIS
    inverse = 0.0 if is_along else 1.0 / square
    w = f.zz if abs(f.zz) > _PARALLEL else _PARALLEL
    slab = 1.0 / w
    for i in range(len(height_m)):
        p, q = f.stretch * point_x_m[i], point_y_m[i]
        x, y, z = f.x + p * f.xx + q * f.yx, f.y + p * f.xy + q * f.yy, f.z + p * f.xz + q * f.yz
        along, rest = x * f.zx + y * f.zy, x * x + y * y - radius_m * radius_m
        discriminant = -rest if is_along else along * along - square * rest
        root = math.sqrt(discriminant if discriminant > 0.0 else 0.0)
        one, other = (-half_m - z) * slab, (half_m - z) * slab
        enter_m, leave_m = (one, other) if one < other else (other, one)
        side_m, opposite_m = (-along - root) * inverse, (-along + root) * inverse
        enter_m = enter_m if is_along or enter_m > side_m else side_m
        leave_m = leave_m if is_along or leave_m < opposite_m else opposite_m
        meets = discriminant >= 0.0 and enter_m <= leave_m and leave_m >= 0.0
        enter_m = enter_m if enter_m > 0.0 else 0.0
        height_m[i] = enter_m if meets else math.inf


@compiled_without_nrt
def _box(
    f: CellInSolid,
    a: float,
    b: float,
    c: float,
    point_x_m: Floats,
    point_y_m: Floats,
    height_m: Floats,
) -> None:
    u = 1.0 / (f.zx if abs(f.zx) > _PARALLEL else _PARALLEL)
    v = 1.0 / (f.zy if abs(f.zy) > _PARALLEL else _PARALLEL)
    w = 1.0 / (f.zz if abs(f.zz) > _PARALLEL else _PARALLEL)
    a, b, c = a if u > 0.0 else -a, b if v > 0.0 else -b, c if w > 0.0 else -c
    for i in range(len(height_m)):
        p, q = f.stretch * point_x_m[i], point_y_m[i]
        x, y, z = f.x + p * f.xx + q * f.yx, f.y + p * f.xy + q * f.yy, f.z + p * f.xz + q * f.yz
        enter_m, enter_y_m, enter_z_m = (-a - x) * u, (-b - y) * v, (-c - z) * w
        leave_m, leave_y_m, leave_z_m = (a - x) * u, (b - y) * v, (c - z) * w
        enter_m = enter_m if enter_m > enter_y_m else enter_y_m
        enter_m = enter_m if enter_m > enter_z_m else enter_z_m
        leave_m = leave_m if leave_m < leave_y_m else leave_y_m
        leave_m = leave_m if leave_m < leave_z_m else leave_z_m
        meets = enter_m <= leave_m and leave_m >= 0.0
        enter_m = enter_m if enter_m > 0.0 else 0.0
        height_m[i] = enter_m if meets else math.inf


@compiled_without_nrt
def _plane(f: CellInSolid, point_x_m: Floats, point_y_m: Floats, height_m: Floats) -> None:
    """Half-space z ≤ 0: planes are infinite here, as in MuJoCo's contacts."""
    for i in range(len(height_m)):
        z = f.z + f.stretch * point_x_m[i] * f.xz + point_y_m[i] * f.yz
        enter_m = -z / f.zz if f.zz < 0.0 else math.inf
        height_m[i] = 0.0 if z <= 0.0 else enter_m
