"""Gaps of a covering: how far samples of the surface are from cells, holes, and what is covered."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.covering.cell_limits import CellLimits
from skinnet.covering.cell_settling import Ground, Scratch, copy_vector
from skinnet.covering.sample_search import SurfaceSamples, bin_rows, entries_of_row
from skinnet.covering.surface_walk import turned_along

__all__ = [
    "add_covers",
    "aim_at_sample",
    "covered_value_m2",
    "mark_tried",
    "next_hole",
    "note_cell",
    "note_kept",
    "pick_gap",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_HOLE_FRACTION = 0.86
"""Least distance of a hole's centre from cells, as a fraction of the pitch; cells are pushed further off."""
_COVERED_FRACTION = 0.6
_REACH_FRACTION = 1.5
"""Distance up to which a sample's nearest cell is known, as a fraction of the pitch."""
_GOLDEN = 0.6180339887498949


@compiled_without_nrt
def note_cell(
    samples: SurfaceSamples,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    i: int,
    nearest_m: Floats,
) -> None:
    """Shorten the distances [m] of samples from the nearest cell on their side by those from cell `i`."""
    n, R, reach_m = samples.normal, rotations, _REACH_FRACTION * limits.pitch_m
    rows = bin_rows(samples.grid, positions_m[i, 0], positions_m[i, 1], positions_m[i, 2], reach_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(samples.grid, rows, k):
            j = samples.grid.order[entry]
            x, y, z = (
                samples.point_m[j, 0] - positions_m[i, 0],
                samples.point_m[j, 1] - positions_m[i, 1],
                samples.point_m[j, 2] - positions_m[i, 2],
            )
            off_m2 = x * x + y * y + z * z
            if off_m2 > reach_m * reach_m or off_m2 >= nearest_m[j] * nearest_m[j]:
                continue
            if n[j, 0] * R[i, 0, 2] + n[j, 1] * R[i, 1, 2] + n[j, 2] * R[i, 2, 2] > 0.0:
                nearest_m[j] = math.sqrt(off_m2)


@compiled_without_nrt
def note_kept(
    samples: SurfaceSamples,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    n_cells: int,
    gap: int,
    radius_m: float,
    before_m: Floats,
    nearest_m: Floats,
) -> None:
    """Set distances of samples from the nearest cell: as before, but anew about `gap`, where cells went."""
    reach_m = radius_m + _REACH_FRACTION * limits.pitch_m
    far_m = reach_m + _REACH_FRACTION * limits.pitch_m
    for j in range(len(nearest_m)):
        x, y, z = (
            samples.point_m[j, 0] - samples.point_m[gap, 0],
            samples.point_m[j, 1] - samples.point_m[gap, 1],
            samples.point_m[j, 2] - samples.point_m[gap, 2],
        )
        nearest_m[j] = before_m[j] if x * x + y * y + z * z > reach_m * reach_m else math.inf
    for i in range(n_cells):
        x, y, z = (
            positions_m[i, 0] - samples.point_m[gap, 0],
            positions_m[i, 1] - samples.point_m[gap, 1],
            positions_m[i, 2] - samples.point_m[gap, 2],
        )
        if x * x + y * y + z * z < far_m * far_m:
            note_cell(samples, limits, positions_m, rotations, i, nearest_m)


@compiled_without_nrt
def mark_tried(
    samples: SurfaceSamples, tried: Bools, target_m: Floats, normal: Floats, reach_m: float
) -> None:
    """Mark samples about `target_m`, where no cell fits, as tried."""
    n = samples.normal
    rows = bin_rows(samples.grid, target_m[0], target_m[1], target_m[2], reach_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(samples.grid, rows, k):
            j = samples.grid.order[entry]
            x, y, z = (
                samples.point_m[j, 0] - target_m[0],
                samples.point_m[j, 1] - target_m[1],
                samples.point_m[j, 2] - target_m[2],
            )
            alike = n[j, 0] * normal[0] + n[j, 1] * normal[1] + n[j, 2] * normal[2]
            if x * x + y * y + z * z < reach_m * reach_m and alike > 0.3:
                tried[j] = True


@compiled_without_nrt
def next_hole(limits: CellLimits, nearest_m: Floats, tried: Bools) -> int:
    """Sample not tried in a hole, as near to the cells about it as one more may be; −1 without a hole."""
    best, best_m = -1, math.inf
    for j in range(len(tried)):
        if tried[j] or nearest_m[j] < _HOLE_FRACTION * limits.pitch_m:
            continue
        off_m = abs(min(nearest_m[j], 2.0 * limits.pitch_m) - limits.distance_m)
        if best < 0 or off_m < best_m - 1e-6 * limits.pitch_m:
            best, best_m = j, off_m
    return best


@compiled_without_nrt
def aim_at_sample(
    samples: SurfaceSamples, positions_m: Floats, rotations: Floats, n_cells: int, sample: int, w: Scratch
) -> None:
    """Put a sample into `w` as the next target, with the axis carried over from the nearest cell."""
    copy_vector(w.target_m, samples.point_m[sample])
    copy_vector(w.normal, samples.normal[sample])
    near, near_m2 = -1, math.inf
    R, nx, ny, nz = rotations, w.normal[0], w.normal[1], w.normal[2]
    for i in range(n_cells):
        x, y, z = (
            w.target_m[0] - positions_m[i, 0],
            w.target_m[1] - positions_m[i, 1],
            w.target_m[2] - positions_m[i, 2],
        )
        off_m2 = x * x + y * y + z * z
        if off_m2 < near_m2 and nx * R[i, 0, 2] + ny * R[i, 1, 2] + nz * R[i, 2, 2] > -0.5:
            near, near_m2 = i, off_m2
    if near >= 0:
        w.x_axis[0], w.x_axis[1], w.x_axis[2] = turned_along(
            R[near, 0, 0],
            R[near, 1, 0],
            R[near, 2, 0],
            R[near, 0, 2],
            R[near, 1, 2],
            R[near, 2, 2],
            nx,
            ny,
            nz,
        )


@compiled_without_nrt
def covered_value_m2(ground: Ground, limits: CellLimits, nearest_m: Floats, n_cells: int) -> float:
    """Value [m²] of a covering: asked surface within 0.6 pitch of a cell, and half the area of the cells."""
    value_m2 = 0.25 * math.sqrt(3.0) * limits.pitch_m * limits.pitch_m * n_cells
    for j in range(len(nearest_m)):
        if ground.asked[j] and nearest_m[j] < _COVERED_FRACTION * limits.pitch_m:
            value_m2 += ground.samples.area_m2[j]
    return value_m2


@compiled_without_nrt
def add_covers(
    ground: Ground,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    i: int,
    by: int,
    covers: Indices,
) -> float:
    """Add `by`, 1 or −1, to the number of cells over asked samples that cell `i` covers, in `covers` (s,).

    Returns the area [m²] that is covered by it only.
    """
    samples, n, R, own_m2 = ground.samples, ground.samples.normal, rotations, 0.0
    reach_m = _COVERED_FRACTION * limits.pitch_m
    rows = bin_rows(samples.grid, positions_m[i, 0], positions_m[i, 1], positions_m[i, 2], reach_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(samples.grid, rows, k):
            j = samples.grid.order[entry]
            x, y, z = (
                samples.point_m[j, 0] - positions_m[i, 0],
                samples.point_m[j, 1] - positions_m[i, 1],
                samples.point_m[j, 2] - positions_m[i, 2],
            )
            if not ground.asked[j] or x * x + y * y + z * z >= reach_m * reach_m:
                continue
            if n[j, 0] * R[i, 0, 2] + n[j, 1] * R[i, 1, 2] + n[j, 2] * R[i, 2, 2] > 0.0:
                covers[j] += by
                if covers[j] == (by + 1) // 2:  # 1 where it is the first, 0 where it was the last
                    own_m2 += samples.area_m2[j]
    return own_m2


@compiled_without_nrt
def pick_gap(ground: Ground, limits: CellLimits, nearest_m: Floats, step: int) -> int:
    """Pick a sample far from cells, another one in each step; −1 without one."""
    count = 0
    for j in range(len(nearest_m)):
        if ground.asked[j] and nearest_m[j] >= _COVERED_FRACTION * limits.pitch_m:
            count += 1
    turn = 0.5 + step * _GOLDEN
    chosen = int((turn - math.floor(turn)) * count)
    for j in range(len(nearest_m)):
        if ground.asked[j] and nearest_m[j] >= _COVERED_FRACTION * limits.pitch_m:
            if chosen == 0:
                return j
            chosen -= 1
    return -1
