"""Samples of the surface of a union of solids: evenly spaced points with normals and areas.

Points are drawn on each solid by area with a quasi-random sequence, those inside another solid are left out,
and the rest is thinned to a least distance (Poisson-disc), which spreads them as blue noise does.
"""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact import ray_casting as shapes
from skinnet.compilation import compiled, compiled_without_nrt
from skinnet.covering.felt_solids import FeltSolids, is_inside
from skinnet.covering.sample_search import SampleGrid, SurfaceSamples, bin_rows, entries_of_row, sample_grid

__all__ = ["sample_surface"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Steps of the quasi-random sequence R2: 1/g and 1/g² of the plastic number g (Roberts, 2018)."""
_OVERSAMPLING = 4.0
_LEAST_SPACING = 0.8
"""Least distance of samples of one side, as a fraction of the spacing asked for."""
_SAME_SIDE_COSINE = 0.5
_SKIN_M = 1e-5
"""Distance [m] from a surface at which a point counts as outside or inside another solid."""


def sample_surface(solids: FeltSolids, spacing_m: float) -> SurfaceSamples:
    """Sample the surface of the union of `solids`, about `spacing_m` [m] apart."""
    cell_m2 = spacing_m * spacing_m / _OVERSAMPLING
    points, normals, areas, owners = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0)], []
    first = 0
    for k in range(len(solids.kind)):
        if solids.hull[k] >= 0:
            h = solids.hull[k]
            last = first + int(solids.hulls.first[h + 1] - solids.hulls.first[h])
            drawn = _on_triangles(solids.corner_m[first:last], cell_m2)
            first = last
        else:
            drawn = _on_primitive(int(solids.kind[k]), solids.size_m[k], cell_m2)
            R = solids.R_body_solid[k]
            drawn = _turned(R, drawn[0]) + solids.position_m[k], _turned(R, drawn[1]), drawn[2]
        points.append(drawn[0])
        normals.append(drawn[1])
        areas.append(drawn[2])
        owners.append(np.full(len(drawn[2]), k, dtype=np.int64))
    point_m, normal, area_m2 = (
        np.ascontiguousarray(np.concatenate(parts)) for parts in (points, normals, areas)
    )
    owner = np.concatenate([np.zeros(0, dtype=np.int64), *owners])
    outer = np.ones(len(point_m), dtype=np.bool_)
    _drop_inner(solids, point_m, normal, owner, outer)
    point_m, normal, area_m2, owner = (
        np.ascontiguousarray(part[outer]) for part in (point_m, normal, area_m2, owner)
    )
    fine = sample_grid(point_m, spacing_m)
    kept = np.zeros(len(point_m), dtype=np.bool_)
    merged_m2 = np.zeros(len(point_m))
    _thin(point_m, normal, area_m2, fine, _LEAST_SPACING * spacing_m, kept, merged_m2)
    point_m = np.ascontiguousarray(point_m[kept])
    return SurfaceSamples(
        point_m,
        np.ascontiguousarray(normal[kept]),
        merged_m2[kept],
        owner[kept],
        spacing_m,
        sample_grid(point_m, 2.0 * spacing_m),
    )


def _turned(R: Floats, vectors: Floats) -> Floats:
    turned: Floats = vectors[:, :1] * R[:, 0] + vectors[:, 1:2] * R[:, 1] + vectors[:, 2:] * R[:, 2]
    return turned


def _sequence(n: int) -> tuple[Floats, Floats]:
    """Quasi-random points (n,), (n,) of the unit square."""
    i = np.arange(1, n + 1, dtype=np.float64)
    return np.mod(0.5 + i * _STEPS[0], 1.0), np.mod(0.5 + i * _STEPS[1], 1.0)


def _count(area_m2: float, cell_m2: float) -> int:
    return max(math.ceil(area_m2 / cell_m2), 8)


def _circle(turns: Floats) -> tuple[Floats, Floats]:
    angle = 2.0 * math.pi * turns
    return pinned_math.cos_of(angle), pinned_math.sin_of(angle)


def _on_triangles(corner_m: Floats, cell_m2: float) -> tuple[Floats, Floats, Floats]:
    across = np.cross(corner_m[:, 1] - corner_m[:, 0], corner_m[:, 2] - corner_m[:, 0])
    twice_m2 = np.sqrt((across * across).sum(axis=1))
    ends_m2 = np.cumsum(0.5 * twice_m2)
    n = _count(float(ends_m2[-1]), cell_m2)
    along_m2 = (np.arange(n) + 0.5) * (ends_m2[-1] / n)
    t = np.minimum(np.searchsorted(ends_m2, along_m2), len(ends_m2) - 1)
    u, v = _sequence(n)
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u)[:, None], np.where(fold, 1.0 - v, v)[:, None]
    a, b, c = corner_m[t, 0], corner_m[t, 1], corner_m[t, 2]
    normal = across[t] / np.maximum(twice_m2[t, None], 1e-300)
    return a + u * (b - a) + v * (c - a), normal, np.full(n, ends_m2[-1] / n)


def _on_primitive(kind: int, size_m: Floats, cell_m2: float) -> tuple[Floats, Floats, Floats]:
    a, b, c = (float(value) for value in size_m)
    match kind:
        case shapes.BOX:
            return _on_box(a, b, c, cell_m2)
        case shapes.CYLINDER:
            return _on_cylinder(a, b, cell_m2)
        case shapes.ELLIPSOID:
            return _on_ellipsoid(a, b, c, cell_m2)
        case _:
            return _on_capsule(a, b if kind == shapes.CAPSULE else 0.0, cell_m2)


def _on_capsule(radius_m: float, half_m: float, cell_m2: float) -> tuple[Floats, Floats, Floats]:
    """Draw on a capsule, a sphere if `half_m` is 0: its area is uniform along its axis (Archimedes)."""
    area_m2 = 4.0 * math.pi * radius_m * (half_m + radius_m)
    n = _count(area_m2, cell_m2)
    u, v = _sequence(n)
    height_m = (2.0 * u - 1.0) * (half_m + radius_m)
    cap_m = height_m - np.clip(height_m, -half_m, half_m)
    cosine, sine = _circle(v)
    sine_up = cap_m / radius_m
    across = np.sqrt(np.maximum(1.0 - sine_up * sine_up, 0.0))
    normal = np.column_stack([across * cosine, across * sine, sine_up])
    point_m = radius_m * normal
    point_m[:, 2] = height_m
    return point_m, normal, np.full(n, area_m2 / n)


def _on_cylinder(radius_m: float, half_m: float, cell_m2: float) -> tuple[Floats, Floats, Floats]:
    side_m2, end_m2 = 4.0 * math.pi * radius_m * half_m, math.pi * radius_m * radius_m
    n, m = _count(side_m2, cell_m2), _count(end_m2, cell_m2)
    u, v = _sequence(n)
    cosine, sine = _circle(v)
    points = [np.column_stack([radius_m * cosine, radius_m * sine, (2.0 * u - 1.0) * half_m])]
    normals = [np.column_stack([cosine, sine, np.zeros(n)])]
    u, v = _sequence(m)
    cosine, sine = _circle(v)
    for side in (-1.0, 1.0):
        r = radius_m * np.sqrt(u)
        points.append(np.column_stack([r * cosine, r * sine, np.full(m, side * half_m)]))
        normals.append(np.tile([0.0, 0.0, side], (m, 1)))
    areas_m2 = np.concatenate([np.full(n, side_m2 / n), np.full(2 * m, end_m2 / m)])
    return np.concatenate(points), np.concatenate(normals), areas_m2


def _on_box(a: float, b: float, c: float, cell_m2: float) -> tuple[Floats, Floats, Floats]:
    half_m, points, normals, areas = (a, b, c), [], [], []
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        face_m2 = 4.0 * half_m[one] * half_m[other]
        n = _count(face_m2, cell_m2)
        u, v = _sequence(n)
        for side in (-1.0, 1.0):
            point_m, normal = np.zeros((n, 3)), np.zeros((n, 3))
            point_m[:, axis], normal[:, axis] = side * half_m[axis], side
            point_m[:, one], point_m[:, other] = (2 * u - 1) * half_m[one], (2 * v - 1) * half_m[other]
            points.append(point_m)
            normals.append(normal)
            areas.append(np.full(n, face_m2 / n))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas)


def _on_ellipsoid(a: float, b: float, c: float, cell_m2: float) -> tuple[Floats, Floats, Floats]:
    """Draw on an ellipsoid as on a sphere, with the areas that the stretching gives to the points."""
    largest_m2 = 4.0 * math.pi * max(a * b, b * c, c * a)
    unit, _, _ = _on_capsule(1.0, 0.0, 4.0 * math.pi * cell_m2 / largest_m2)
    scaled = unit * np.array([b * c, c * a, a * b])
    length = np.sqrt((scaled * scaled).sum(axis=1))
    return unit * np.array([a, b, c]), scaled / length[:, None], 4.0 * math.pi / len(unit) * length


@compiled_without_nrt
def _drop_inner(solids: FeltSolids, point_m: Floats, normal: Floats, owner: Indices, outer: Bools) -> None:
    """Drop points that another solid covers; where two share a surface, those of the later one."""
    for i in range(len(point_m)):
        x, y, z = point_m[i]
        u, v, w = normal[i, 0] * _SKIN_M, normal[i, 1] * _SKIN_M, normal[i, 2] * _SKIN_M
        for k in range(len(solids.kind)):
            if k == owner[i]:
                continue
            if is_inside(solids, k, x + u, y + v, z + w):
                outer[i] = False
                break
            if k < owner[i] and is_inside(solids, k, x - u, y - v, z - w):
                outer[i] = False
                break


@compiled
def _thin(
    point_m: Floats,
    normal: Floats,
    area_m2: Floats,
    grid: SampleGrid,
    least_m: float,
    kept: Bools,
    merged_m2: Floats,
) -> None:
    """Keep points at least `least_m` from all kept before on their side, and give each the area around it."""
    for i in range(len(point_m)):
        if _nearest_kept(point_m, normal, grid, kept, i, least_m) < 0:
            kept[i] = True
    for i in range(len(point_m)):
        j = i if kept[i] else _nearest_kept(point_m, normal, grid, kept, i, least_m)
        merged_m2[j] += area_m2[i]


@compiled_without_nrt
def _nearest_kept(
    point_m: Floats, normal: Floats, grid: SampleGrid, kept: Bools, i: int, reach_m: float
) -> int:
    best, best_m2 = -1, reach_m * reach_m
    rows = bin_rows(grid, point_m[i, 0], point_m[i, 1], point_m[i, 2], reach_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(grid, rows, k):
            j = grid.order[entry]
            if not kept[j]:
                continue
            dx, dy, dz = (
                point_m[j, 0] - point_m[i, 0],
                point_m[j, 1] - point_m[i, 1],
                point_m[j, 2] - point_m[i, 2],
            )
            off_m2 = dx * dx + dy * dy + dz * dz
            alike = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1] + normal[i, 2] * normal[j, 2]
            if off_m2 < best_m2 and alike >= _SAME_SIDE_COSINE:
                best, best_m2 = j, off_m2
    return best
