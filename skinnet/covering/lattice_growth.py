"""Growth of a hexagonal lattice of cells over a surface, from a seed, cell by cell.

Every cell predicts its six neighbours, one pitch away along the surface. The site that most cells predict is
filled next, at the mean of the predictions; so rows stay straight and meet themselves round a link. Where no
site is left, the largest holes are filled, and growth goes on from there.
"""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.covering.cell_limits import CellLimits
from skinnet.covering.cell_settling import Ground, Scratch, new_scratch, settle_cell
from skinnet.covering.gaps import (
    aim_at_sample,
    covered_value_m2,
    mark_tried,
    next_hole,
    note_cell,
    note_kept,
    pick_gap,
)
from skinnet.covering.lattice_sites import Sites, new_sites, predict_neighbours, take_next_site

__all__ = ["grow_lattice", "improve_lattice"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_HALF_SQRT3 = 0.5 * math.sqrt(3.0)
_SITES_OF_A_GAP = 1024


def grow_lattice(
    ground: Ground,
    limits: CellLimits,
    seed: int,
    x_axis: Floats,
    fixed_position_m: Floats,
    R_fixed: Floats,
    max_cells: int | None,
) -> tuple[Floats, Floats]:
    """Grow a lattice over `ground`; return positions (n, 3) [m] and rotations (n, 3, 3) of the new cells.

    Args:
        ground: Where cells may lie.
        limits: Limits that cells keep.
        seed: Sample at which the first cell is tried.
        x_axis: (3,) direction of its port 0.
        fixed_position_m: (f, 3) cells that are there already [m].
        R_fixed: (f, 3, 3) their rotations.
        max_cells: Greatest number of new cells; no limit for None.
    """
    position_m, R = _with_room(ground, limits, fixed_position_m, R_fixed, max_cells)
    n_fixed = len(fixed_position_m)
    n = _grow_from_seed(ground, limits, seed, x_axis, position_m, R, n_fixed)
    return position_m[n_fixed:n].copy(), R[n_fixed:n].copy()


def improve_lattice(
    ground: Ground,
    limits: CellLimits,
    cells: tuple[Floats, Floats],
    fixed_position_m: Floats,
    R_fixed: Floats,
    rounds: int,
) -> tuple[Floats, Floats]:
    """Take away `cells` about a gap and fill the place anew, `rounds` times; keep what covers more.

    Arguments and result as those of `grow_lattice`; `cells` are positions and rotations of a lattice.
    """
    n_fixed, n = len(fixed_position_m), len(fixed_position_m) + len(cells[0])
    position_m, R = _with_room(ground, limits, fixed_position_m, R_fixed, None)
    position_m[n_fixed:n], R[n_fixed:n] = cells
    n = _improve(ground, limits, position_m, R, n, n_fixed, rounds)
    return position_m[n_fixed:n].copy(), R[n_fixed:n].copy()


def _with_room(
    ground: Ground, limits: CellLimits, fixed_position_m: Floats, R_fixed: Floats, max_cells: int | None
) -> tuple[Floats, Floats]:
    """Positions and rotations with rows for all cells that may fit after those that are fixed."""
    n_fixed = len(fixed_position_m)
    area_m2 = float(ground.samples.area_m2[ground.asked].sum())
    room = 64 + int(2.0 * area_m2 / (_HALF_SQRT3 * limits.pitch_m * limits.pitch_m))
    room = n_fixed + (room if max_cells is None else min(room, max_cells))
    position_m, R = np.zeros((room, 3)), np.zeros((room, 3, 3))
    position_m[:n_fixed], R[:n_fixed] = fixed_position_m, R_fixed
    return position_m, R


def _grow_from_seed(
    ground: Ground,
    limits: CellLimits,
    seed: int,
    x_axis: Floats,
    positions_m: Floats,
    rotations: Floats,
    n_fixed: int,
) -> int:
    """Grow from sample `seed` beside `n_fixed` cells; return the number of rows filled."""
    samples, w = ground.samples, new_scratch()
    nearest_m = _distances_m(ground, limits, positions_m, rotations, n_fixed)
    w.target_m[:], w.normal[:], w.x_axis[:] = samples.point_m[seed], samples.normal[seed], x_axis
    sites = new_sites(12 * len(positions_m) + 16)
    return int(_grow(ground, limits, positions_m, rotations, n_fixed, nearest_m, ~ground.asked, sites, w))


def _distances_m(
    ground: Ground, limits: CellLimits, positions_m: Floats, rotations: Floats, n_cells: int
) -> Floats:
    """Distances (s,) [m] of samples from the nearest of the first `n_cells` cells."""
    nearest_m = np.full(len(ground.samples.point_m), np.inf)
    for i in range(n_cells):
        note_cell(ground.samples, limits, positions_m, rotations, i, nearest_m)
    return nearest_m


@compiled_without_nrt
def _grow(
    ground: Ground,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    n: int,
    nearest_m: Floats,
    tried: Bools,
    sites: Sites,
    w: Scratch,
) -> int:
    """Add cells from row `n` on, the first at the target in `w`; return the number of rows filled.

    `nearest_m` (s,) holds distances of samples from the nearest cell, `tried` (s,) samples that are no holes.
    """
    samples, n_sites = ground.samples, 0 * n  # a literal 0 would compile what takes it once more
    while n < len(positions_m):
        if settle_cell(ground, limits, positions_m, rotations, n, w):
            for k in range(3):
                positions_m[n, k] = w.position_m[k]
                for m in range(3):
                    rotations[n, k, m] = w.R[k, m]
            n += 1
            note_cell(samples, limits, positions_m, rotations, n - 1, nearest_m)
            n_sites = predict_neighbours(ground, limits, positions_m, rotations, n, sites, n_sites, w)
        else:
            mark_tried(samples, tried, w.target_m, w.normal, 0.15 * limits.pitch_m)
        if not take_next_site(sites, n_sites, w):
            hole = next_hole(limits, nearest_m, tried)
            if hole < 0:
                break
            tried[hole] = True
            aim_at_sample(samples, positions_m, rotations, n, hole, w)
    return n


def _improve(
    ground: Ground,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    n: int,
    n_fixed: int,
    rounds: int,
) -> int:
    """Take away cells about a gap and fill the place anew, `rounds` times; keep what covers more."""
    samples, w = ground.samples, new_scratch()
    nearest_m = _distances_m(ground, limits, positions_m, rotations, n)
    sites = new_sites(_SITES_OF_A_GAP)
    value_m2 = covered_value_m2(ground, limits, nearest_m, n)
    for step in range(rounds):
        gap = pick_gap(ground, limits, nearest_m, step)
        if gap < 0:
            break
        radius_m = (1.0 + 0.4 * (step % 3)) * limits.pitch_m
        stays = _square_m2(positions_m[:n] - samples.point_m[gap]) > radius_m * radius_m
        stays[:n_fixed] = True
        kept = int(stays.sum())
        trial_m, R_trial = np.zeros_like(positions_m), np.zeros_like(rotations)
        trial_m[:kept], R_trial[:kept] = positions_m[:n][stays], rotations[:n][stays]
        trial_nearest_m = np.empty_like(nearest_m)
        note_kept(samples, limits, trial_m, R_trial, kept, gap, radius_m, nearest_m, trial_nearest_m)
        about_m = radius_m + 1.2 * limits.pitch_m
        about = _square_m2(samples.point_m - samples.point_m[gap]) < about_m * about_m
        tried = ~(about & ground.asked)
        first = gap if step % 2 == 0 else next_hole(limits, trial_nearest_m, tried)
        aim_at_sample(samples, trial_m, R_trial, kept, gap if first < 0 else first, w)
        m = int(_grow(ground, limits, trial_m, R_trial, kept, trial_nearest_m, tried, sites, w))
        trial_m2 = covered_value_m2(ground, limits, trial_nearest_m, m)
        if trial_m2 > value_m2 + 1e-9 * limits.pitch_m * limits.pitch_m:
            value_m2, n, nearest_m = trial_m2, m, trial_nearest_m
            positions_m[:n], rotations[:n] = trial_m[:n], R_trial[:n]
    return n


def _square_m2(offset_m: Floats) -> Floats:
    square: Floats = (offset_m * offset_m).sum(axis=1)
    return square
