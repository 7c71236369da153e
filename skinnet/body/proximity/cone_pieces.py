"""Nearest point of balls, segments and facets within a cone, in closed form, in compiled code.

All functions work in the frame of the sensor: the apex of the cone at the origin, its axis along z, its half
angle given by cosine and sine. Vectors are scalars [m]. The nearest point of a convex piece within the cone
is its foot of the perpendicular if that lies in the cone; else it lies on the cone's surface, or on the
boundary of the piece.

Every piece has a rank, a number by which a search over the slices of a solid finds the nearest point: the
distance [m] where the piece is in view, above `OUT_OF_VIEW` the more, the larger its angle to the axis, above
`BEHIND` the more, the farther it lies behind. Each of them is convex, or has convex level sets, in the
position of the piece, so that along a family of parallel slices the rank has one minimum.
"""

import math

from skinnet.compilation import compiled_without_nrt
from skinnet.pinned_arcs import asin, atan2

__all__ = ["BEHIND", "OUT_OF_VIEW", "ball_rank", "facet_rank", "half_space_distance_m", "segment_rank"]

OUT_OF_VIEW = 1e6
"""Smallest rank [m] of a piece that is out of view."""
BEHIND = 2e6
"""Smallest rank of a piece that lies behind the sensor."""


@compiled_without_nrt
def _hidden_rank(angle: float, z: float) -> float:
    """Rank of a piece out of view, by its smallest `angle` to the axis [rad] and its largest `z` [m]."""
    return OUT_OF_VIEW + angle if angle < 0.5 * math.pi else BEHIND - z


@compiled_without_nrt
def half_space_distance_m(nx: float, ny: float, nz: float, h: float, cosine: float, sine: float) -> float:
    """Distance [m] of a half-space `h` [m] away in the unit direction (nx, ny, nz); inf out of view."""
    across = math.sqrt(nx * nx + ny * ny)
    if nz >= cosine:
        return max(h, 0.0)
    towards = across * sine + nz * cosine  # along the generator of the cone that leads there fastest
    if h <= 0.0:
        return 0.0
    return h / towards if towards > 0.0 else math.inf


@compiled_without_nrt
def ball_rank(x: float, y: float, z: float, radius: float, cosine: float, sine: float) -> float:
    """Rank [m] of the ball of `radius` [m] around (x, y, z)."""
    across2 = x * x + y * y
    distance = math.sqrt(across2 + z * z)
    if distance <= radius:
        return 0.0
    if z >= cosine * distance:
        return distance - radius
    across = math.sqrt(across2)
    # along the generator of the cone in the plane of axis and centre, and square to it
    along, off = z * cosine + across * sine, across * cosine - z * sine
    if along > 0.0 and off <= radius:
        return along - math.sqrt(radius * radius - off * off)
    beyond = asin(radius / distance)
    angle = atan2(across, z) - beyond
    return _hidden_rank(angle, z + radius)


@compiled_without_nrt
def _view_of_segment(
    ax: float, ay: float, az: float, dx: float, dy: float, dz: float, cosine: float
) -> tuple[float, float]:
    """Interval of t in which a + t d, t from 0 to 1, is in the cone; empty is (inf, -inf).

    The points of the double cone have z² ≥ cos² |a + t d|², a quadratic inequality in t.
    """
    c2 = cosine * cosine
    p2 = dz * dz - c2 * (dx * dx + dy * dy + dz * dz)
    p1 = az * dz - c2 * (ax * dx + ay * dy + az * dz)
    p0 = az * az - c2 * (ax * ax + ay * ay + az * az)
    first, last = 0.0, 1.0
    discriminant = p1 * p1 - p2 * p0
    if discriminant < 0.0:
        if p2 < 0.0:
            return math.inf, -math.inf
    elif p2 == 0.0:
        if p1 > 0.0:
            first = max(first, -0.5 * p0 / p1)
        elif p1 < 0.0:
            last = min(last, -0.5 * p0 / p1)
        elif p0 < 0.0:
            return math.inf, -math.inf
    else:
        q = -(p1 + math.copysign(math.sqrt(discriminant), p1))
        one = q / p2
        other = p0 / q if q != 0.0 else one
        low, high = min(one, other), max(one, other)
        if p2 < 0.0:  # the line crosses one half of the double cone
            first, last = max(first, low), min(last, high)
        elif dz > 0.0:  # it comes out of the other half and goes into ours
            first = max(first, high)
        else:
            last = min(last, low)
    if first > last or az + 0.5 * (first + last) * dz < 0.0:
        return math.inf, -math.inf
    return first, last


@compiled_without_nrt
def _angle_at(ax: float, ay: float, az: float, dx: float, dy: float, dz: float, t: float) -> float:
    """Angle [rad] between the axis and a + t d, for t cut off at 0 and 1."""
    t = min(max(t, 0.0), 1.0)
    x, y, z = ax + t * dx, ay + t * dy, az + t * dz
    return atan2(math.sqrt(x * x + y * y), z)


@compiled_without_nrt
def segment_rank(ax: float, ay: float, az: float, dx: float, dy: float, dz: float, cosine: float) -> float:
    """Rank [m] of the segment from a to a + d."""
    aa, ad, dd = ax * ax + ay * ay + az * az, ax * dx + ay * dy + az * dz, dx * dx + dy * dy + dz * dz
    first, last = _view_of_segment(ax, ay, az, dx, dy, dz, cosine)
    if first <= last:
        foot = -ad / dd if dd > 0.0 else 0.0
        t = min(max(foot, first), last)
        x, y, z = ax + t * dx, ay + t * dy, az + t * dz
        return math.sqrt(x * x + y * y + z * z)
    angle = min(_angle_at(ax, ay, az, dx, dy, dz, 0.0), _angle_at(ax, ay, az, dx, dy, dz, 1.0))
    slope = dz * ad - az * dd
    if slope != 0.0:  # where the angle is stationary
        angle = min(angle, _angle_at(ax, ay, az, dx, dy, dz, (az * ad - dz * aa) / slope))
    return _hidden_rank(angle, az + max(dz, 0.0))


@compiled_without_nrt
def facet_rank(
    ox: float,
    oy: float,
    oz: float,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    is_triangle: bool,
    cosine: float,
    sine: float,
) -> float:
    """Rank [m] of the parallelogram of corner o and edges a and b, or of the half of it that is a triangle.

    The nearest point of its plane within the cone, if it lies on the facet, else that of its edges.
    """
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nn = nx * nx + ny * ny + nz * nz
    if nn > 0.0:
        size = math.sqrt(nn)
        nx, ny, nz = nx / size, ny / size, nz / size
        h = ox * nx + oy * ny + oz * nz
        if h < 0.0:
            nx, ny, nz, h = -nx, -ny, -nz, -h
        distance = half_space_distance_m(nx, ny, nz, h, cosine, sine)
        if h > 0.0 and distance < math.inf:
            if nz >= cosine:
                px, py, pz = h * nx, h * ny, h * nz
            else:
                across = math.sqrt(nx * nx + ny * ny)
                px, py, pz = distance * sine * nx / across, distance * sine * ny / across, distance * cosine
            px, py, pz = px - ox, py - oy, pz - oz
            aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
            pa, pb = px * ax + py * ay + pz * az, px * bx + py * by + pz * bz
            u, v = (bb * pa - ab * pb) / nn, (aa * pb - ab * pa) / nn
            if u >= 0.0 and v >= 0.0 and (u + v <= 1.0 if is_triangle else (u <= 1.0 and v <= 1.0)):
                return distance
    # one edge after the other, with one call: the compiler copies what is called
    rank, px, py, pz = math.inf, ox, oy, oz
    for edge in range(3 if is_triangle else 4):
        if edge == 0:
            dx, dy, dz = ax, ay, az
        elif edge == 1:
            dx, dy, dz = (bx - ax, by - ay, bz - az) if is_triangle else (bx, by, bz)
        elif edge == 2:
            dx, dy, dz = (-bx, -by, -bz) if is_triangle else (-ax, -ay, -az)
        else:
            dx, dy, dz = -bx, -by, -bz
        rank = min(rank, segment_rank(px, py, pz, dx, dy, dz, cosine))
        px, py, pz = px + dx, py + dy, pz + dz
    return rank
