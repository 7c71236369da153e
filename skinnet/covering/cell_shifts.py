"""Small shifts and turns of single cells by which a lattice covers more.

A lattice has straight rows, edges of the surface do not: strips too narrow for one more row stay bare along
them. Cells may stand a little further apart than a pitch and still leave nothing bare between them, so rows
next to an edge move towards it where there is room.
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.covering.cell_limits import CellLimits
from skinnet.covering.cell_settling import Ground, Scratch, fit_cell, new_scratch
from skinnet.covering.gaps import add_covers

__all__ = ["shift_cells"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_SHIFTS_PER_CELL = 200
_FIRST_FRACTION, _LAST_FRACTION = 0.25, 0.05
"""Greatest shift along an axis of the cell at the start and at the end, as fractions of the pitch."""
_GREATEST_TURN = 0.25
"""Tangent of the greatest turn."""
_STEPS = (0.8566748838545029, 0.733891856627126, 0.6287067210378086, 0.53859725722361)
"""Steps of the quasi-random sequence R4: powers of the root of x⁵ = x + 1 (Roberts, 2018)."""


def shift_cells(
    ground: Ground,
    limits: CellLimits,
    cells: tuple[Floats, Floats],
    fixed_position_m: Floats,
    R_fixed: Floats,
) -> tuple[Floats, Floats]:
    """Shift and turn `cells`, one at a time, wherever they then cover more of the surface.

    Args:
        ground: Where cells may lie.
        limits: Limits that cells keep.
        cells: Positions (n, 3) [m] and rotations (n, 3, 3).
        fixed_position_m: (f, 3) cells that stay where they are [m].
        R_fixed: (f, 3, 3) their rotations.

    Returns:
        Positions and rotations of `cells` as they are now.
    """
    n_fixed = len(fixed_position_m)
    position_m = np.concatenate([fixed_position_m, cells[0], np.zeros((1, 3))])
    R = np.concatenate([R_fixed, cells[1], np.zeros((1, 3, 3))])
    i = np.arange(1, _SHIFTS_PER_CELL * len(cells[0]) + 1, dtype=np.float64)
    draws = np.stack([np.mod(0.5 + i * step, 1.0) for step in _STEPS], axis=1)
    covers = np.zeros(len(ground.asked), dtype=np.int64)
    _shift(ground, limits, position_m, R, n_fixed, draws, covers, new_scratch())
    return position_m[n_fixed:-1].copy(), R[n_fixed:-1].copy()


@compiled_without_nrt
def _shift(
    ground: Ground,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    n_fixed: int,
    draws: Floats,
    covers: Indices,
    w: Scratch,
) -> None:
    """Try the shifts `draws` (t, 4) of cells, in place; the last of their rows is spare.

    `covers` (s,) is work space for the number of cells over each sample, all 0.
    """
    n, spare = len(positions_m) - 1, len(positions_m) - 1
    for i in range(n):
        add_covers(ground, limits, positions_m, rotations, i, 1, covers)
    for t in range(len(draws)):
        i = n_fixed + int(draws[t, 0] * (n - n_fixed))
        reach_m = (_FIRST_FRACTION + (_LAST_FRACTION - _FIRST_FRACTION) * t / len(draws)) * limits.pitch_m
        x_m, y_m = (2.0 * draws[t, 1] - 1.0) * reach_m, (2.0 * draws[t, 2] - 1.0) * reach_m
        turn = (2.0 * draws[t, 3] - 1.0) * _GREATEST_TURN
        for k in range(3):
            w.target_m[k] = positions_m[i, k] + x_m * rotations[i, k, 0] + y_m * rotations[i, k, 1]
            w.normal[k] = rotations[i, k, 2]
            w.x_axis[k] = rotations[i, k, 0] + turn * rotations[i, k, 1]
        _copy_row(positions_m, rotations, i, spare)
        _copy_row(positions_m, rotations, n - 1, i)  # so that all others are the first n - 1 rows
        fits = fit_cell(ground, limits, positions_m, rotations, n - 1, w, 0)
        _copy_row(positions_m, rotations, spare, i)
        if not fits:
            continue
        bared_m2 = add_covers(ground, limits, positions_m, rotations, i, -1, covers)
        for k in range(3):
            positions_m[i, k] = w.position_m[k]
            for m in range(3):
                rotations[i, k, m] = w.R[k, m]
        if add_covers(ground, limits, positions_m, rotations, i, 1, covers) <= bared_m2:
            add_covers(ground, limits, positions_m, rotations, i, -1, covers)
            _copy_row(positions_m, rotations, spare, i)
            add_covers(ground, limits, positions_m, rotations, i, 1, covers)


@compiled_without_nrt
def _copy_row(positions_m: Floats, rotations: Floats, source: int, target: int) -> None:
    for k in range(3):
        positions_m[target, k] = positions_m[source, k]
        for m in range(3):
            rotations[target, k, m] = rotations[source, k, m]
