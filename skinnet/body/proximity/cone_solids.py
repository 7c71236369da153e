"""Nearest point of a solid within a cone, for MuJoCo's primitives, in compiled code.

All functions work in the frame of the sensor as those of `cone_pieces`. A solid has its centre at
(cx, cy, cz) and its axes along u, v and w, sizes as in MuJoCo's `geom_size`. They return the distance [m]
to the nearest point in view, zero when the sensor is inside, infinity when nothing is in view.

Round solids are families of slices: a capsule of balls, a cylinder of rectangles, an ellipsoid of segments.
The rank of the slices has one minimum, which a golden-section search finds (Kiefer, 1953).
"""

import math
from typing import NamedTuple

from skinnet.body.proximity.cone_pieces import OUT_OF_VIEW, ball_rank, facet_rank, segment_rank
from skinnet.compilation import compiled_without_nrt

__all__ = [
    "box_distance_m",
    "capsule_distance_m",
    "cylinder_distance_m",
    "ellipsoid_distance_m",
]

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_STEPS = 40
"""Slices that a search tries: the place of the nearest is then known to 1e-8 of the solid's size."""
_INNER_STEPS = 30
"""Slices in a search within another: 1e-6 of the solid's size."""


class _Bracket(NamedTuple):
    """Bracket of a golden-section search [m, or of the semi-axis]: places s < t between low and high.

    `at_s` and `at_t` are the ranks there, NaN until they are known.
    """

    low: float
    high: float
    s: float
    t: float
    at_s: float
    at_t: float
    is_s_next: bool


@compiled_without_nrt
def _bracket(low: float, high: float) -> _Bracket:
    """Bracket from `low` to `high`, of which no place was tried."""
    width = high - low
    return _Bracket(low, high, high - _GOLDEN * width, low + _GOLDEN * width, math.nan, math.nan, True)


@compiled_without_nrt
def _narrow(bracket: _Bracket, rank: float) -> _Bracket:
    """Note the `rank` at the place that was next; narrow the bracket once both places are known."""
    low, high, s, t, at_s, at_t, is_s = bracket
    if is_s:
        at_s = rank
    else:
        at_t = rank
    if math.isnan(at_t):
        return _Bracket(low, high, s, t, at_s, at_t, False)
    if at_s <= at_t:
        high, t, at_t = t, s, at_s
        return _Bracket(low, high, high - _GOLDEN * (high - low), t, at_s, at_t, True)
    low, s, at_s = s, t, at_t
    return _Bracket(low, high, s, low + _GOLDEN * (high - low), at_s, at_t, False)


@compiled_without_nrt
def _in_view(rank: float) -> float:
    """Distance [m] of a piece of `rank`."""
    return rank if rank < OUT_OF_VIEW else math.inf


@compiled_without_nrt
def capsule_distance_m(
    cx: float,
    cy: float,
    cz: float,
    wx: float,
    wy: float,
    wz: float,
    radius: float,
    half: float,
    cosine: float,
    sine: float,
) -> float:
    """Distance [m] of a capsule of `radius` and half length `half` [m] along w."""
    foot = min(max(-(cx * wx + cy * wy + cz * wz), -half), half)
    x, y, z = cx + foot * wx, cy + foot * wy, cz + foot * wz
    distance = math.sqrt(x * x + y * y + z * z)
    if distance <= radius or z >= cosine * distance:
        return max(distance - radius, 0.0)
    bracket, best = _bracket(-half, half), math.inf
    for _ in range(_STEPS):
        x = bracket.s if bracket.is_s_next else bracket.t
        rank = ball_rank(cx + x * wx, cy + x * wy, cz + x * wz, radius, cosine, sine)
        best = min(best, rank)
        bracket = _narrow(bracket, rank)
    return _in_view(best)


@compiled_without_nrt
def box_distance_m(
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
    a: float,
    b: float,
    c: float,
    cosine: float,
    sine: float,
) -> float:
    """Distance [m] of a box of half sizes a, b and c [m] along u, v and w: of its faces that are near."""
    along_u, along_v = -(cx * ux + cy * uy + cz * uz), -(cx * vx + cy * vy + cz * vz)
    along_w = -(cx * wx + cy * wy + cz * wz)
    if abs(along_u) <= a and abs(along_v) <= b and abs(along_w) <= c:
        return 0.0
    ux, uy, uz, vx, vy, vz = a * ux, a * uy, a * uz, b * vx, b * vy, b * vz
    wx, wy, wz = c * wx, c * wy, c * wz
    rank = math.inf
    for _ in range(3):  # the axes take turns as the one along which the sensor lies outside
        if abs(along_u) > a:
            sign = math.copysign(1.0, along_u)
            ox, oy, oz = cx + sign * ux - vx - wx, cy + sign * uy - vy - wy, cz + sign * uz - vz - wz
            face = facet_rank(
                ox, oy, oz, 2.0 * vx, 2.0 * vy, 2.0 * vz, 2.0 * wx, 2.0 * wy, 2.0 * wz, False, cosine, sine
            )
            rank = min(rank, face)
        along_u, along_v, along_w, a, b, c = along_v, along_w, along_u, b, c, a
        ux, uy, uz, vx, vy, vz, wx, wy, wz = vx, vy, vz, wx, wy, wz, ux, uy, uz
    return _in_view(rank)


@compiled_without_nrt
def _cylinder_slice(
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
    radius: float,
    half: float,
    s: float,
    cosine: float,
    sine: float,
) -> float:
    """Rank of the rectangle that cuts a cylinder at `s` [m] along u."""
    width = math.sqrt(max(radius * radius - s * s, 0.0))
    ox, oy, oz = cx + s * ux - width * vx, cy + s * uy - width * vy, cz + s * uz - width * vz
    ox, oy, oz, width, length = ox - half * wx, oy - half * wy, oz - half * wz, 2.0 * width, 2.0 * half
    vx, vy, vz, wx, wy, wz = width * vx, width * vy, width * vz, length * wx, length * wy, length * wz
    return facet_rank(ox, oy, oz, vx, vy, vz, wx, wy, wz, False, cosine, sine)


@compiled_without_nrt
def cylinder_distance_m(
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
    radius: float,
    half: float,
    cosine: float,
    sine: float,
) -> float:
    """Distance [m] of a cylinder of `radius` and half length `half` [m] along w."""
    p, q, r = -(cx * ux + cy * uy + cz * uz), -(cx * vx + cy * vy + cz * vz), -(cx * wx + cy * wy + cz * wz)
    off = math.sqrt(p * p + q * q)
    scale = min(1.0, radius / off) if off > 0.0 else 1.0
    p, q, r = scale * p, scale * q, min(max(r, -half), half)
    x, y, z = cx + p * ux + q * vx + r * wx, cy + p * uy + q * vy + r * wy, cz + p * uz + q * vz + r * wz
    distance = math.sqrt(x * x + y * y + z * z)
    if z >= cosine * distance:  # the foot of the perpendicular; also if the sensor is inside
        return distance
    bracket, best = _bracket(-radius, radius), math.inf
    for _ in range(_STEPS):
        x = bracket.s if bracket.is_s_next else bracket.t
        rank = _cylinder_slice(cx, cy, cz, ux, uy, uz, vx, vy, vz, wx, wy, wz, radius, half, x, cosine, sine)
        best = min(best, rank)
        bracket = _narrow(bracket, rank)
    return _in_view(best)


@compiled_without_nrt
def _chord(
    cx: float,
    cy: float,
    cz: float,
    vx: float,
    vy: float,
    vz: float,
    wx: float,
    wy: float,
    wz: float,
    scale: float,
    s: float,
    cosine: float,
) -> float:
    """Rank of the chord along w of the ellipse (v, w) times `scale`, at `s` of its semi-axis v."""
    half = math.sqrt(max(scale * scale - s * s, 0.0))
    ox, oy, oz = cx + s * vx - half * wx, cy + s * vy - half * wy, cz + s * vz - half * wz
    return segment_rank(ox, oy, oz, 2.0 * half * wx, 2.0 * half * wy, 2.0 * half * wz, cosine)


@compiled_without_nrt
def _ellipse_rank(
    cx: float,
    cy: float,
    cz: float,
    vx: float,
    vy: float,
    vz: float,
    wx: float,
    wy: float,
    wz: float,
    scale: float,
    cosine: float,
) -> float:
    """Rank of the ellipse with semi-axes v and w [m] times `scale`."""
    bracket, best = _bracket(-scale, scale), math.inf
    for _ in range(_INNER_STEPS):
        x = bracket.s if bracket.is_s_next else bracket.t
        rank = _chord(cx, cy, cz, vx, vy, vz, wx, wy, wz, scale, x, cosine)
        best = min(best, rank)
        bracket = _narrow(bracket, rank)
    return best


@compiled_without_nrt
def ellipsoid_distance_m(
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
    a: float,
    b: float,
    c: float,
    cosine: float,
) -> float:
    """Distance [m] of an ellipsoid of semi-axes a, b and c [m] along u, v and w."""
    p, q = (cx * ux + cy * uy + cz * uz) / a, (cx * vx + cy * vy + cz * vz) / b
    r = (cx * wx + cy * wy + cz * wz) / c
    if p * p + q * q + r * r <= 1.0:
        return 0.0
    ux, uy, uz, vx, vy, vz = a * ux, a * uy, a * uz, b * vx, b * vy, b * vz
    wx, wy, wz = c * wx, c * wy, c * wz
    bracket, best = _bracket(-1.0, 1.0), math.inf
    for _ in range(_INNER_STEPS):
        x = bracket.s if bracket.is_s_next else bracket.t
        scale = math.sqrt(max(1.0 - x * x, 0.0))
        rank = _ellipse_rank(cx + x * ux, cy + x * uy, cz + x * uz, vx, vy, vz, wx, wy, wz, scale, cosine)
        best = min(best, rank)
        bracket = _narrow(bracket, rank)
    return _in_view(best)
