"""Searches among samples of a surface: the nearest one on a side, the mean normal about a point."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt

__all__ = [
    "SampleGrid",
    "SurfaceSamples",
    "bin_rows",
    "entries_of_row",
    "mean_normal",
    "nearest_sample",
    "sample_grid",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_MAX_BINS = 4_000_000


class SampleGrid(NamedTuple):
    """Uniform grid over samples.

    Attributes:
        origin_m: (3,) lowest corner [m].
        bin_m: Side of a bin [m].
        shape: (3,) bins along each axis.
        start: (b + 1,) first entry of each bin in `order`.
        order: (n,) samples, bin by bin.
    """

    origin_m: Floats
    bin_m: float
    shape: Indices
    start: Indices
    order: Indices


class SurfaceSamples(NamedTuple):
    """Samples (n) of the outer surface of a link, frame of its body.

    Attributes:
        point_m: (n, 3) points [m].
        normal: (n, 3) outward unit normals of the solid at the points.
        area_m2: (n,) areas for which the samples stand [m²].
        solid: (n,) solids on which the samples lie.
        spacing_m: Mean distance of neighbours, about [m].
        grid: Grid over the samples, for searches.
    """

    point_m: Floats
    normal: Floats
    area_m2: Floats
    solid: Indices
    spacing_m: float
    grid: SampleGrid


class _BinRows(NamedTuple):
    """Rows, along the third axis, of the bins near a point.

    Attributes:
        n_rows: Number of rows.
        low_a: First bin along the first axis.
        low_b: First bin along the second axis.
        n_b: Number of bins along the second axis.
        low_c: First bin of each row.
        high_c: Past last bin of each row.
    """

    n_rows: int
    low_a: int
    low_b: int
    n_b: int
    low_c: int
    high_c: int


def sample_grid(point_m: Floats, bin_m: float) -> SampleGrid:
    """Build a grid of bins of `bin_m` [m], larger if there are too many, over points (n, 3) [m]."""
    low_m = point_m.min(axis=0) if len(point_m) else np.zeros(3)
    high_m = point_m.max(axis=0) if len(point_m) else np.zeros(3)
    while np.prod(np.floor((high_m - low_m) / bin_m) + 1.0) > _MAX_BINS:
        bin_m *= 1.5
    shape = (np.floor((high_m - low_m) / bin_m) + 1.0).astype(np.int64)
    place = np.floor((point_m - low_m) / bin_m).astype(np.int64)
    bins = (place[:, 0] * shape[1] + place[:, 1]) * shape[2] + place[:, 2]
    start = np.concatenate([[0], np.cumsum(np.bincount(bins, minlength=int(np.prod(shape))))])
    order = np.argsort(bins, kind="stable").astype(np.int64)
    return SampleGrid(low_m, float(bin_m), shape, start.astype(np.int64), order)


@compiled_without_nrt
def nearest_sample(
    samples: SurfaceSamples,
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    w: float,
    least_cosine: float,
    reach_m: float,
) -> int:
    """Sample nearest to (x, y, z) [m] within `reach_m`, its normal within a cosine of (u, v, w), or −1."""
    n, best, best_m2 = samples.normal, -1, reach_m * reach_m
    rows = bin_rows(samples.grid, x, y, z, reach_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(samples.grid, rows, k):
            j = samples.grid.order[entry]
            dx, dy, dz = (
                samples.point_m[j, 0] - x,
                samples.point_m[j, 1] - y,
                samples.point_m[j, 2] - z,
            )
            off_m2 = dx * dx + dy * dy + dz * dz
            if off_m2 < best_m2 and n[j, 0] * u + n[j, 1] * v + n[j, 2] * w >= least_cosine:
                best, best_m2 = j, off_m2
    return best


@compiled_without_nrt
def mean_normal(
    samples: SurfaceSamples,
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    w: float,
    radius_m: float,
    least_cosine: float,
) -> tuple[float, float, float]:
    """Mean normal of surface within `radius_m` of (x, y, z) that faces (u, v, w), which it is without any."""
    n = samples.normal
    sx, sy, sz = 0.0, 0.0, 0.0
    rows = bin_rows(samples.grid, x, y, z, radius_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(samples.grid, rows, k):
            j = samples.grid.order[entry]
            dx, dy, dz = (
                samples.point_m[j, 0] - x,
                samples.point_m[j, 1] - y,
                samples.point_m[j, 2] - z,
            )
            near = 1.0 - (dx * dx + dy * dy + dz * dz) / (radius_m * radius_m)
            if near > 0.0 and n[j, 0] * u + n[j, 1] * v + n[j, 2] * w >= least_cosine:
                weight = near * samples.area_m2[j]
                sx, sy, sz = sx + weight * n[j, 0], sy + weight * n[j, 1], sz + weight * n[j, 2]
    length = math.sqrt(sx * sx + sy * sy + sz * sz)
    if length < 1e-12:
        return u, v, w
    return sx / length, sy / length, sz / length


@compiled_without_nrt
def bin_rows(grid: SampleGrid, x: float, y: float, z: float, reach_m: float) -> _BinRows:
    """Rows of the bins within `reach_m` of (x, y, z) [m]."""
    low_a, high_a = _bins_within(grid, 0, x, reach_m)
    low_b, high_b = _bins_within(grid, 1, y, reach_m)
    low_c, high_c = _bins_within(grid, 2, z, reach_m)
    n_b = max(high_b - low_b, 0)
    return _BinRows(max(high_a - low_a, 0) * n_b, low_a, low_b, n_b, low_c, max(high_c, low_c))


@compiled_without_nrt
def entries_of_row(grid: SampleGrid, rows: _BinRows, k: int) -> range:
    """Entries of the grid's `order` that lie in row `k` of `rows`."""
    row = ((rows.low_a + k // rows.n_b) * grid.shape[1] + rows.low_b + k % rows.n_b) * grid.shape[2]
    return range(grid.start[row + rows.low_c], grid.start[row + rows.high_c])


@compiled_without_nrt
def _bins_within(grid: SampleGrid, axis: int, value_m: float, reach_m: float) -> tuple[int, int]:
    """First and past last bin of an axis within `reach_m` of a coordinate."""
    low = math.floor((value_m - reach_m - grid.origin_m[axis]) / grid.bin_m)
    high = math.floor((value_m + reach_m - grid.origin_m[axis]) / grid.bin_m) + 1
    return min(max(low, 0), grid.shape[axis]), max(min(high, grid.shape[axis]), 0)
