"""Shifts of single cells: they cover more with the same cells, and keep the limits of a covering."""

import numpy as np
from link_models import PITCH_M, SIDE_M, TEE, ground_of, model_of

from skinnet.covering.cell_shifts import shift_cells
from skinnet.covering.covering_metrics import CellFigures, cell_figures
from skinnet.covering.lattice_growth import grow_lattice

FOAM_M = 0.012
NONE = (np.zeros((0, 3)), np.zeros((0, 3, 3)))


def test_shifted_cells_cover_more_without_a_fault() -> None:
    of = ground_of(model_of(TEE))
    cells = grow_lattice(of.ground, of.limits, 0, np.array([1.0, 0.0, 0.0]), *NONE, None)
    shifted = shift_cells(of.ground, of.limits, cells, *NONE)

    def figures(position_m: np.ndarray, R: np.ndarray) -> CellFigures:
        return cell_figures(model_of(TEE), of, position_m, R, SIDE_M, FOAM_M)

    before, after = figures(*cells), figures(*shifted)
    assert len(shifted[0]) == len(cells[0])
    assert after.covered_m2 > before.covered_m2 + 0.02 * before.asked_m2
    assert (after.overlaps, after.piercing, after.buried) == (0, 0, 0)


def test_cells_that_are_fixed_stay_and_others_keep_off_them() -> None:
    of = ground_of(model_of(TEE))
    position_m, R = grow_lattice(of.ground, of.limits, 0, np.array([1.0, 0.0, 0.0]), *NONE, None)
    fixed = position_m[::2].copy(), R[::2].copy()
    kept = fixed[0].copy()
    moved_m, _ = shift_cells(of.ground, of.limits, (position_m[1::2], R[1::2]), *fixed)
    assert (fixed[0] == kept).all()
    assert not np.allclose(moved_m, position_m[1::2], atol=0.1 * PITCH_M)
    alike = moved_m[:, None] - kept
    assert np.sqrt((alike * alike).sum(axis=2)).min() > 0.9 * PITCH_M
