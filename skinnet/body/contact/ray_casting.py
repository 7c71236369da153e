"""Ray casting against solids: MuJoCo's primitives, in compiled code.

All functions work in the frame of the solid, with the origin (x, y, z) [m] and the unit direction
(u, v, w) of the ray as scalars. They return the distance [m] to the first point of the solid:
zero when the origin is inside, infinity when the ray misses. Sizes follow MuJoCo's `geom_size`.
"""

import math

from skinnet.compilation import compiled_without_nrt

__all__ = [
    "BOX",
    "CAPSULE",
    "CYLINDER",
    "ELLIPSOID",
    "MESH",
    "PLANE",
    "SPHERE",
    "entry_distance_m",
]

# mjtGeom, fixed here so that compiled code need not import MuJoCo; a test compares them.
PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = 0, 2, 3, 4, 5, 6, 7

_PARALLEL = 1e-300
"""Direction component below which a ray is parallel to a pair of faces."""


@compiled_without_nrt
def _quadratic_interval(a: float, b: float, c: float) -> tuple[float, float]:
    """Solve a t² + 2 b t + c ≤ 0 for the interval of t; empty is (inf, -inf)."""
    if a < 1e-18:  # the ray runs along the axis: inside everywhere or nowhere
        return (-math.inf, math.inf) if c <= 0.0 else (math.inf, -math.inf)
    discriminant = b * b - a * c
    if discriminant < 0.0:
        return math.inf, -math.inf
    root = math.sqrt(discriminant)
    return (-b - root) / a, (-b + root) / a


@compiled_without_nrt
def _slab(x: float, u: float, half: float) -> tuple[float, float]:
    """Clip a ray to the slab |x + t u| ≤ half: interval of t; empty is (inf, -inf)."""
    if abs(u) < _PARALLEL:
        return (-math.inf, math.inf) if abs(x) <= half else (math.inf, -math.inf)
    first, second = (-half - x) / u, (half - x) / u
    return min(first, second), max(first, second)


@compiled_without_nrt
def _entry_distance_m(first: float, last: float) -> float:
    """Entry distance [m] of a ray that is inside the solid from `first` to `last`; inf if behind."""
    return max(first, 0.0) if first <= last and last >= 0.0 else math.inf


@compiled_without_nrt
def _plane(z: float, w: float) -> float:
    """Intersect the half-space z ≤ 0: planes are infinite here, as in MuJoCo's contacts."""
    if z <= 0.0:
        return 0.0
    return -z / w if w < 0.0 else math.inf


@compiled_without_nrt
def _sphere(x: float, y: float, z: float, u: float, v: float, w: float, radius: float) -> float:
    first, last = _quadratic_interval(
        u * u + v * v + w * w, x * u + y * v + z * w, x * x + y * y + z * z - radius * radius
    )
    return _entry_distance_m(first, last)


@compiled_without_nrt
def _cylinder(
    x: float, y: float, z: float, u: float, v: float, w: float, radius: float, half: float
) -> float:
    side_first, side_last = _quadratic_interval(u * u + v * v, x * u + y * v, x * x + y * y - radius * radius)
    end_first, end_last = _slab(z, w, half)
    return _entry_distance_m(max(side_first, end_first), min(side_last, end_last))


@compiled_without_nrt
def _capsule(x: float, y: float, z: float, u: float, v: float, w: float, radius: float, half: float) -> float:
    """Intersect a capsule, the union of a cylinder and two spheres: the first of their entries."""
    body = _cylinder(x, y, z, u, v, w, radius, half)
    top = _sphere(x, y, z - half, u, v, w, radius)
    bottom = _sphere(x, y, z + half, u, v, w, radius)
    return min(body, top, bottom)


@compiled_without_nrt
def _ellipsoid(
    x: float, y: float, z: float, u: float, v: float, w: float, a: float, b: float, c: float
) -> float:
    """Intersect an ellipsoid, scaled to the unit sphere: the ray parameter, a distance, is invariant."""
    return _sphere(x / a, y / b, z / c, u / a, v / b, w / c, 1.0)


@compiled_without_nrt
def _box(x: float, y: float, z: float, u: float, v: float, w: float, a: float, b: float, c: float) -> float:
    first_x, last_x = _slab(x, u, a)
    first_y, last_y = _slab(y, v, b)
    first_z, last_z = _slab(z, w, c)
    return _entry_distance_m(max(first_x, first_y, first_z), min(last_x, last_y, last_z))


@compiled_without_nrt
def entry_distance_m(
    geom_type: int,
    a: float,
    b: float,
    c: float,
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    w: float,
) -> float:
    """Ray distance [m] from (x, y, z) along (u, v, w) to the solid of MuJoCo type `geom_type`, in its frame.

    Args:
        geom_type: PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER or BOX; rays miss all others, also meshes,
            whose rays are those of `convex_hull`.
        a: Size of the solid as in MuJoCo's `geom_size`, with b and c [m].
        b: See a.
        c: See a.
        x: Origin of the ray in the frame of the solid [m], with y and z.
        y: See x.
        z: See x.
        u: Unit direction of the ray in the frame of the solid, with v and w.
        v: See u.
        w: See u.
    """
    if geom_type == CAPSULE:
        return _capsule(x, y, z, u, v, w, a, b)
    if geom_type == BOX:
        return _box(x, y, z, u, v, w, a, b, c)
    if geom_type == SPHERE:
        return _sphere(x, y, z, u, v, w, a)
    if geom_type == CYLINDER:
        return _cylinder(x, y, z, u, v, w, a, b)
    if geom_type == ELLIPSOID:
        return _ellipsoid(x, y, z, u, v, w, a, b, c)
    if geom_type == PLANE:
        return _plane(z, w)
    return math.inf
