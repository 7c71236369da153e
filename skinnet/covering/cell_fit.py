"""Fit of one flat cell to a surface: tilt, lift, gap, support, and what may not lie under it."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.covering.cell_heights import heights_under_cell, peak_m
from skinnet.covering.cell_limits import CellLimits
from skinnet.covering.felt_solids import FeltSolids, first_entry_m
from skinnet.covering.hexagons import HEXAGON_POINTS, HEXAGON_WEIGHTS, hexagon_spread, in_hexagon
from skinnet.covering.sample_search import (
    SurfaceSamples,
    bin_rows,
    entries_of_row,
    mean_normal,
    nearest_sample,
)

__all__ = ["N_FINE_POINTS", "is_good_cell", "lay_cell"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_POINTS, _WEIGHTS = HEXAGON_POINTS, HEXAGON_WEIGHTS
_N_POINTS = len(HEXAGON_WEIGHTS)
_FINE_POINTS = np.concatenate([hexagon_spread(120), np.zeros((1, 2))])
"""Points at which a cell is judged in the end; the last is the centre."""
N_FINE_POINTS = len(_FINE_POINTS)
_N_SPREAD = N_FINE_POINTS - 13
"""Those of them that stand for equal areas: without rim and centre."""
_REFINEMENTS = 2


@compiled_without_nrt
def lay_cell(
    solids: FeltSolids,
    samples: SurfaceSamples,
    limits: CellLimits,
    target_m: Floats,
    normal: Floats,
    x_axis: Floats,
    position_m: Floats,
    R: Floats,
    heights_m: Floats,
    R_trial: Floats,
) -> bool:
    """Lay a cell near `target_m` (3,) on the side of `normal` (3,), with x along `x_axis` (3,).

    Of several tilts (mean normal under the cell, that of the nearest point, planes fitted to the surface
    below) the one with the least mean gap is taken, and the cell is lifted until it rests on the surface.

    Args:
        solids: Solids of the link.
        samples: Samples of its surface.
        limits: Limits to keep.
        target_m: Where the centre should lie, frame of the body [m].
        normal: Normal expected there.
        x_axis: Direction of port 0 expected there.
        position_m: (3,) position, set in place [m].
        R: (3, 3) axes, set in place.
        heights_m: (p,) work space.
        R_trial: (3, 3) work space.

    Returns:
        False if there is no surface.
    """
    s = nearest_sample(
        samples, target_m[0], target_m[1], target_m[2], normal[0], normal[1], normal[2], 0.0, limits.pitch_m
    )
    if s < 0:
        return False
    best = math.inf
    start_m = limits.foam_m + limits.lift_m
    for trial in range(2 + _REFINEMENTS):
        if trial == 0:
            n = samples.normal
            nx, ny, nz = mean_normal(
                samples,
                samples.point_m[s, 0],
                samples.point_m[s, 1],
                samples.point_m[s, 2],
                n[s, 0],
                n[s, 1],
                n[s, 2],
                0.5 * limits.pitch_m,
                -0.2,
            )
        elif trial == 1:
            nx, ny, nz = samples.normal[s, 0], samples.normal[s, 1], samples.normal[s, 2]
        else:
            nx, ny, nz = _fitted_normal(R_trial, heights_m, limits)
        if not set_axes(R_trial, nx, ny, nz, x_axis[0], x_axis[1], x_axis[2]):
            continue
        nx, ny, nz = R_trial[0, 2], R_trial[1, 2], R_trial[2, 2]
        entry_m = first_entry_m(
            solids,
            target_m[0] + limits.pitch_m * nx,
            target_m[1] + limits.pitch_m * ny,
            target_m[2] + limits.pitch_m * nz,
            -nx,
            -ny,
            -nz,
            2.0 * limits.pitch_m,
        )
        if not 0.0 < entry_m < math.inf:
            continue
        before = (position_m[0], position_m[1], position_m[2])
        height_m = limits.pitch_m - entry_m
        for k in range(3):
            position_m[k] = target_m[k] + height_m * R_trial[k, 2]
        heights_under_cell(
            solids, position_m, R_trial, _POINTS, limits.side_m, start_m, limits.pitch_m, heights_m
        )
        lift_m = max(_largest(heights_m) - limits.intrusion_m, 0.0)
        cost = 0.0
        for i in range(_N_POINTS):
            cost += _WEIGHTS[i] * min(lift_m - heights_m[i], limits.depth_m)
        cost += 1e3 * max(lift_m - limits.lift_m, 0.0)
        if cost < best - 1e-9:
            best = cost
            for k in range(3):
                position_m[k] += lift_m * R_trial[k, 2]
                for j in range(3):
                    R[k, j] = R_trial[k, j]
        else:
            position_m[0], position_m[1], position_m[2] = before
    return best < math.inf


@compiled_without_nrt
def set_axes(R: Floats, nx: float, ny: float, nz: float, ux: float, uy: float, uz: float) -> bool:
    """Set the columns of `R` (3, 3) to x along (ux, uy, uz), y, and z along the normal; False if parallel."""
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length < 1e-9:
        return False
    nx, ny, nz = nx / length, ny / length, nz / length
    along = ux * nx + uy * ny + uz * nz
    ux, uy, uz = ux - along * nx, uy - along * ny, uz - along * nz
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    if length < 1e-9:
        return False
    ux, uy, uz = ux / length, uy / length, uz / length
    R[0, 0], R[1, 0], R[2, 0] = ux, uy, uz
    R[0, 1], R[1, 1], R[2, 1] = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    R[0, 2], R[1, 2], R[2, 2] = nx, ny, nz
    return True


@compiled_without_nrt
def _largest(values: Floats) -> float:
    most: float = values[0]
    for i in range(1, len(values)):
        most = max(most, values[i])
    return most


@compiled_without_nrt
def _fitted_normal(R: Floats, heights_m: Floats, limits: CellLimits) -> tuple[float, float, float]:
    """Normal of the plane fitted to the supported heights (least squares) of a cell with axes `R`."""
    top_m = _largest(heights_m)
    n = sx = sy = sh = sxx = sxy = syy = sxh = syh = 0.0
    for i in range(_N_POINTS):
        h = heights_m[i] - top_m
        if h < -limits.depth_m:
            continue
        x, y, weight = limits.side_m * _POINTS[i, 0], limits.side_m * _POINTS[i, 1], _WEIGHTS[i]
        n, sx, sy, sh = n + weight, sx + weight * x, sy + weight * y, sh + weight * h
        sxx, sxy, syy = sxx + weight * x * x, sxy + weight * x * y, syy + weight * y * y
        sxh, syh = sxh + weight * x * h, syh + weight * y * h
    if n < 0.2:
        return R[0, 2], R[1, 2], R[2, 2]
    cxx, cxy, cyy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    cxh, cyh = sxh - sx * sh / n, syh - sy * sh / n
    area = cxx * cyy - cxy * cxy
    side_m2 = limits.side_m * limits.side_m
    if area < 1e-6 * side_m2 * side_m2:
        return R[0, 2], R[1, 2], R[2, 2]
    b, c = (cyy * cxh - cxy * cyh) / area, (cxx * cyh - cxy * cxh) / area
    return (
        R[0, 2] - b * R[0, 0] - c * R[0, 1],
        R[1, 2] - b * R[1, 0] - c * R[1, 1],
        R[2, 2] - b * R[2, 0] - c * R[2, 1],
    )


@compiled_without_nrt
def is_good_cell(
    solids: FeltSolids,
    samples: SurfaceSamples,
    asked: Bools,
    blocked: Bools,
    limits: CellLimits,
    position_m: Floats,
    R: Floats,
    fine_m: Floats,
) -> bool:
    """Lift a cell off what reaches into its foam between the points at which it was laid, and judge it.

    Args:
        solids: Solids of the link.
        samples: Samples of its surface.
        asked: (n,) samples where centres of cells may lie.
        blocked: (n,) samples that no cell may cover.
        limits: Limits to keep.
        position_m: (3,) position, lifted in place [m].
        R: (3, 3) axes.
        fine_m: (`N_FINE_POINTS`,) work space.
    """
    start_m = limits.foam_m
    heights_under_cell(solids, position_m, R, _FINE_POINTS, limits.side_m, start_m, limits.pitch_m, fine_m)
    top_m = _largest(fine_m)
    if top_m >= start_m - 1e-9:
        return False
    lift_m = max(top_m - limits.intrusion_m, 0.0)
    for k in range(3):
        position_m[k] += lift_m * R[k, 2]
    if lift_m - fine_m[N_FINE_POINTS - 1] > limits.lift_m:
        return False
    gap_m, held = 0.0, 0
    for i in range(_N_SPREAD):
        if lift_m - fine_m[i] <= limits.depth_m:
            held += 1
            gap_m += lift_m - fine_m[i]
    if held < limits.support * _N_SPREAD:
        return False
    if gap_m > limits.gap_m * held:
        return False
    for i in range(len(fine_m)):
        fine_m[i] -= lift_m
    peak = peak_m(solids, position_m, R, _FINE_POINTS, fine_m, limits.side_m, start_m)
    more_m = max(peak - limits.intrusion_m, 0.0)
    if peak >= start_m - 1e-9:
        return False
    if more_m - fine_m[N_FINE_POINTS - 1] > limits.lift_m:
        return False
    if gap_m + more_m * held > limits.gap_m * held:
        return False
    for k in range(3):
        position_m[k] += more_m * R[k, 2]
    s = nearest_sample(
        samples, position_m[0], position_m[1], position_m[2], R[0, 2], R[1, 2], R[2, 2], 0.2, limits.pitch_m
    )
    if s < 0 or not asked[s]:
        return False
    return not _covers_blocked(samples, blocked, limits, position_m, R)


@compiled_without_nrt
def _covers_blocked(
    samples: SurfaceSamples, blocked: Bools, limits: CellLimits, position_m: Floats, R: Floats
) -> bool:
    """True if blocked surface lies under the hexagon or within the margin of it."""
    side_m = limits.side_m + limits.margin_m / (0.5 * math.sqrt(3.0))
    reach_m = math.sqrt(side_m * side_m + limits.depth_m * limits.depth_m)
    n = samples.normal
    rows = bin_rows(samples.grid, position_m[0], position_m[1], position_m[2], reach_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(samples.grid, rows, k):
            j = samples.grid.order[entry]
            if not blocked[j]:
                continue
            dx, dy, dz = (
                samples.point_m[j, 0] - position_m[0],
                samples.point_m[j, 1] - position_m[1],
                samples.point_m[j, 2] - position_m[2],
            )
            height_m = dx * R[0, 2] + dy * R[1, 2] + dz * R[2, 2]
            if abs(height_m) > limits.depth_m:
                continue
            if n[j, 0] * R[0, 2] + n[j, 1] * R[1, 2] + n[j, 2] * R[2, 2] < 0.1:
                continue
            if in_hexagon(
                dx * R[0, 0] + dy * R[1, 0] + dz * R[2, 0],
                dx * R[0, 1] + dy * R[1, 1] + dz * R[2, 1],
                side_m,
            ):
                return True
    return False
