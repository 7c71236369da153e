"""Hexagons of cells: whether two flat cells pierce each other, and points spread over one."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt

__all__ = [
    "HEXAGON_POINTS",
    "HEXAGON_WEIGHTS",
    "hexagon_grid",
    "hexagon_rim",
    "hexagon_spread",
    "in_hexagon",
    "piercing_m",
]

Floats = NDArray[np.float64]

_HALF_SQRT3 = 0.5 * math.sqrt(3.0)


def hexagon_grid(rings: int) -> tuple[Floats, Floats]:
    """Points (p, 2) of a hexagon of side 1 in `rings` rings up to its border, and weights (p,) of sum 1.

    Corners lie at 30°, 90°, …: the x axis points to an edge. Each point stands for the part of the hexagon
    that is nearest to it: a half on an edge, a third on a corner.
    """
    points, weights = [], []
    for q in range(-rings, rings + 1):
        for r in range(max(-rings, -q - rings), min(rings, rings - q) + 1):
            points.append((_HALF_SQRT3 * q / rings, (r + 0.5 * q) / rings))
            at_border = sum(abs(value) == rings for value in (q, r, q + r))
            weights.append((1.0, 0.5, 1.0 / 3.0)[at_border])
    return np.array(points), np.array(weights) / sum(weights)


def hexagon_rim(rings: int) -> Floats:
    """Points (6 rings, 2) on the border of a hexagon of side 1, as those of `hexagon_grid`."""
    points, weights = hexagon_grid(rings)
    rim: Floats = points[weights < 0.75 * weights.max()]
    return rim


def hexagon_spread(count: int) -> Floats:
    """Points (p, 2), about `count`, spread over a hexagon of side 1 so that no straight line misses them all.

    They follow a quasi-random sequence (R2), as an edge of a solid may run between the rows of a grid; its
    corners and the middles of its edges come last.
    """
    points = []
    for i in range(1, round(count * 1.5) + 1):
        x = (2.0 * ((0.5 + i * 0.7548776662466927) % 1.0) - 1.0) * _HALF_SQRT3
        y = 2.0 * ((0.5 + i * 0.5698402909980532) % 1.0) - 1.0
        if 0.5 * abs(x) + _HALF_SQRT3 * abs(y) <= _HALF_SQRT3:
            points.append((x, y))
    return np.concatenate([points, hexagon_rim(2)])


HEXAGON_POINTS, HEXAGON_WEIGHTS = hexagon_grid(3)
"""Points (37, 2) of a hexagon of side 1 and their weights."""


@compiled_without_nrt
def in_hexagon(x: float, y: float, side_m: float) -> bool:
    """True if (x, y) [m] lies in the hexagon of `side_m` [m] around the origin, plane of the cell."""
    apothem_m = _HALF_SQRT3 * side_m
    across = 0.5 * abs(x) + _HALF_SQRT3 * abs(y)
    return abs(x) <= apothem_m and across <= apothem_m


@compiled_without_nrt
def _extent(R: Floats, side_m: float, u: float, v: float, w: float) -> float:
    """Half extent [m] of the flat hexagon with axes `R` along (u, v, w)."""
    x = R[0, 0] * u + R[1, 0] * v + R[2, 0] * w
    y = R[0, 1] * u + R[1, 1] * v + R[2, 1] * w
    a, b = _HALF_SQRT3 * x, 0.5 * y
    half_m: float = side_m * max(abs(y), max(abs(a + b), abs(a - b)))
    return half_m


@compiled_without_nrt
def piercing_m(
    R_a: Floats, R_b: Floats, x: float, y: float, z: float, side_m: float, thickness_m: float
) -> float:
    """Overlap [m] of two hexagonal plates: the least way along one axis that would part them; 0 if apart.

    Separating axes of two convex prisms (Gottschalk, Lin, Manocha, OBBTree, 1996): normals of their faces,
    and the products of their edges. A plate reaches from its hexagon `thickness_m` outwards.

    Args:
        R_a: (3, 3) axes of the first cell.
        R_b: (3, 3) axes of the second cell.
        x: Centre of the second cell from that of the first [m], with y and z.
        y: See x.
        z: See x.
        side_m: Side of both hexagons [m].
        thickness_m: Thickness of both plates [m].
    """
    half_m = 0.5 * thickness_m
    x += half_m * (R_b[0, 2] - R_a[0, 2])
    y += half_m * (R_b[1, 2] - R_a[1, 2])
    z += half_m * (R_b[2, 2] - R_a[2, 2])
    reach_m = 2.0 * side_m + thickness_m
    if x * x + y * y + z * z > reach_m * reach_m:
        return 0.0
    least_m = math.inf
    for i in range(8):
        R = R_a if i < 4 else R_b
        k = i % 4
        if k == 3:
            u, v, w = R[0, 2], R[1, 2], R[2, 2]
        else:  # normals of the sides, at 0°, 60° and 120°
            cosine, sine = (1.0, 0.0) if k == 0 else ((0.5, _HALF_SQRT3) if k == 1 else (-0.5, _HALF_SQRT3))
            u = cosine * R[0, 0] + sine * R[0, 1]
            v = cosine * R[1, 0] + sine * R[1, 1]
            w = cosine * R[2, 0] + sine * R[2, 1]
        least_m = min(least_m, _overlap(R_a, R_b, x, y, z, u, v, w, side_m, half_m))
        if least_m <= 0.0:
            return 0.0
    for i in range(4):
        ax, ay, az = _edge(R_a, i)
        for k in range(4):
            bx, by, bz = _edge(R_b, k)
            u, v, w = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            length = math.sqrt(u * u + v * v + w * w)
            if length < 1e-6:
                continue
            overlap_m = _overlap(R_a, R_b, x, y, z, u / length, v / length, w / length, side_m, half_m)
            least_m = min(least_m, overlap_m)
            if least_m <= 0.0:
                return 0.0
    return least_m


@compiled_without_nrt
def _edge(R: Floats, k: int) -> tuple[float, float, float]:
    """Direction of an edge of a plate: those of its hexagon at 90°, 150° and 30°, and its normal."""
    if k == 3:
        return R[0, 2], R[1, 2], R[2, 2]
    cosine, sine = (0.0, 1.0) if k == 0 else ((-_HALF_SQRT3, 0.5) if k == 1 else (_HALF_SQRT3, 0.5))
    return (
        cosine * R[0, 0] + sine * R[0, 1],
        cosine * R[1, 0] + sine * R[1, 1],
        cosine * R[2, 0] + sine * R[2, 1],
    )


@compiled_without_nrt
def _overlap(
    R_a: Floats,
    R_b: Floats,
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    w: float,
    side_m: float,
    half_m: float,
) -> float:
    """Overlap [m] of both plates, whose middles are (x, y, z) apart, along the unit axis (u, v, w)."""
    thick_m = half_m * (
        abs(R_a[0, 2] * u + R_a[1, 2] * v + R_a[2, 2] * w)
        + abs(R_b[0, 2] * u + R_b[1, 2] * v + R_b[2, 2] * w)
    )
    wide_m = _extent(R_a, side_m, u, v, w) + _extent(R_b, side_m, u, v, w)
    overlap_m: float = wide_m + thick_m - abs(x * u + y * v + z * w)
    return overlap_m
