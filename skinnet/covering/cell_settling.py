"""Settling of a cell at a target: fitted to the surface, pushed or shifted until it keeps off others."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.covering.cell_fit import N_FINE_POINTS, is_good_cell, lay_cell
from skinnet.covering.cell_limits import CellLimits, sum_of_pushes
from skinnet.covering.felt_solids import FeltSolids
from skinnet.covering.hexagons import HEXAGON_WEIGHTS
from skinnet.covering.link_neighbours import LinkNeighbours, is_reached
from skinnet.covering.sample_search import SurfaceSamples, bin_rows, entries_of_row

__all__ = ["Ground", "Scratch", "copy_vector", "fit_cell", "hexagon_direction", "new_scratch", "settle_cell"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_HALF_SQRT3 = 0.5 * math.sqrt(3.0)
_PUSHES = 5
_PUSHES_OF_SHIFTED = 1
_RINGS = 2
_ASKED_FRACTION = 0.25
_CROWDED_FRACTION = 0.82
_RING_FRACTION = 0.08
"""Radius of a ring of shifts, as a fraction of the pitch."""


class Ground(NamedTuple):
    """Ground that cells may cover.

    Attributes:
        solids: Solids of the link.
        samples: Samples (n) of its surface.
        asked: (n,) samples where centres of cells may lie.
        blocked: (n,) samples that no cell may cover.
        neighbours: Links that may not come into the foam of a cell.
    """

    solids: FeltSolids
    samples: SurfaceSamples
    asked: Bools
    blocked: Bools
    neighbours: LinkNeighbours


class Scratch(NamedTuple):
    """Work space of growth."""

    position_m: Floats
    R: Floats
    R_trial: Floats
    heights_m: Floats
    fine_m: Floats
    push_m: Floats
    target_m: Floats
    normal: Floats
    x_axis: Floats


def new_scratch() -> Scratch:
    """Allocate work space."""
    return Scratch(
        np.zeros(3),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros(len(HEXAGON_WEIGHTS)),
        np.zeros(N_FINE_POINTS),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
    )


@compiled_without_nrt
def settle_cell(
    ground: Ground, limits: CellLimits, positions_m: Floats, rotations: Floats, n_cells: int, w: Scratch
) -> bool:
    """Fit a cell near `w.target_m` that keeps off all others; pushed off them, else shifted round about."""
    x0, y0, z0 = w.target_m[0], w.target_m[1], w.target_m[2]
    if not _is_asked_near(ground, w, _ASKED_FRACTION * limits.pitch_m):
        return False
    nx, ny, nz = w.normal[0], w.normal[1], w.normal[2]
    ax, ay, az = w.x_axis[0], w.x_axis[1], w.x_axis[2]
    along = ax * nx + ay * ny + az * nz
    ax, ay, az = ax - along * nx, ay - along * ny, az - along * nz
    length = math.sqrt(ax * ax + ay * ay + az * az)
    places = 1
    if length > 1e-9:
        places = 1 + 6 * _RINGS
        ax, ay, az = ax / length, ay / length, az / length
    bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    fitted = False
    for place in range(places):
        pushes = _PUSHES
        if place > 0:
            ring, k = 1 + (place - 1) // 6, (place - 1) % 6
            shift_m = _RING_FRACTION * ring * limits.pitch_m
            c, s = hexagon_direction(k)
            if ring % 2 == 0:
                c, s = _HALF_SQRT3 * c - 0.5 * s, 0.5 * c + _HALF_SQRT3 * s
            w.target_m[0] = x0 + shift_m * (c * ax + s * bx)
            w.target_m[1] = y0 + shift_m * (c * ay + s * by)
            w.target_m[2] = z0 + shift_m * (c * az + s * bz)
            if _is_crowded(positions_m, rotations, n_cells, limits, w):
                continue
            pushes = _PUSHES_OF_SHIFTED
        if fit_cell(ground, limits, positions_m, rotations, n_cells, w, pushes):
            fitted = True
            break
    w.target_m[0], w.target_m[1], w.target_m[2] = x0, y0, z0
    return fitted


@compiled_without_nrt
def _is_asked_near(ground: Ground, w: Scratch, reach_m: float) -> bool:
    """True if a cell may have its centre on the side of the target within `reach_m` [m] of it."""
    grid, n = ground.samples.grid, ground.samples.normal
    rows = bin_rows(grid, w.target_m[0], w.target_m[1], w.target_m[2], reach_m)
    for k in range(rows.n_rows):
        for entry in entries_of_row(grid, rows, k):
            j = grid.order[entry]
            alike = n[j, 0] * w.normal[0] + n[j, 1] * w.normal[1] + n[j, 2] * w.normal[2]
            if ground.asked[j] and alike > -0.2:
                return True
    return False


@compiled_without_nrt
def _is_crowded(positions_m: Floats, rotations: Floats, n_cells: int, limits: CellLimits, w: Scratch) -> bool:
    """True if a cell on the side of the target is so near that no push will do."""
    reach_m = _CROWDED_FRACTION * limits.pitch_m
    R = rotations
    for j in range(n_cells):
        x, y, z = (
            w.target_m[0] - positions_m[j, 0],
            w.target_m[1] - positions_m[j, 1],
            w.target_m[2] - positions_m[j, 2],
        )
        alike = w.normal[0] * R[j, 0, 2] + w.normal[1] * R[j, 1, 2] + w.normal[2] * R[j, 2, 2]
        if x * x + y * y + z * z < reach_m * reach_m and alike > 0.0:
            return True
    return False


@compiled_without_nrt
def fit_cell(
    ground: Ground,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    n_cells: int,
    w: Scratch,
    pushes: int,
) -> bool:
    """Fit a cell at `w.target_m`, which is pushed off other cells up to so many times; True if it fits."""
    for _ in range(pushes + 1):
        if not lay_cell(
            ground.solids,
            ground.samples,
            limits,
            w.target_m,
            w.normal,
            w.x_axis,
            w.position_m,
            w.R,
            w.heights_m,
            w.R_trial,
        ):
            return False
        if not sum_of_pushes(positions_m, rotations, n_cells, limits, w.position_m, w.R, w.push_m):
            if not is_good_cell(
                ground.solids,
                ground.samples,
                ground.asked,
                ground.blocked,
                limits,
                w.position_m,
                w.R,
                w.fine_m,
            ) or is_reached(ground.neighbours, w.position_m, w.R, limits.side_m, limits.foam_m):
                return False
            if not sum_of_pushes(positions_m, rotations, n_cells, limits, w.position_m, w.R, w.push_m):
                return True
        along_m = w.push_m[0] * w.R[0, 2] + w.push_m[1] * w.R[1, 2] + w.push_m[2] * w.R[2, 2]
        for k in range(3):
            w.target_m[k] = w.position_m[k] + w.push_m[k] - along_m * w.R[k, 2]
    return False


@compiled_without_nrt
def hexagon_direction(k: int) -> tuple[float, float]:
    """Cosine and sine of k · 60°."""
    if k == 0:
        return 1.0, 0.0
    if k == 1:
        return 0.5, _HALF_SQRT3
    if k == 2:
        return -0.5, _HALF_SQRT3
    if k == 3:
        return -1.0, 0.0
    if k == 4:
        return -0.5, -_HALF_SQRT3
    return 0.5, -_HALF_SQRT3


@compiled_without_nrt
def copy_vector(target: Floats, source: Floats) -> None:
    """Copy `source` (3,) into `target` (3,)."""
    for k in range(3):
        target[k] = source[k]
