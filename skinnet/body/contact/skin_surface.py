"""Skin surface on its bodies: cells of all patches as arrays, and sample points of the foam."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact.sample_grid import SampleGrid, sample_grid
from skinnet.body.model import require_body_id
from skinnet.deployment.skin.cells import CellSpec
from skinnet.skin.placement import PlacedPatch

__all__ = [
    "N_FORCE_CELLS",
    "N_SAMPLES_PER_CELL",
    "SkinSurface",
    "build_skin_surface",
    "cell_grid",
    "force_cell_centre_m",
    "hexagon_m",
    "rows_by_patch",
    "surface_of_patches",
]

N_FORCE_CELLS = 3
"""Force cells (taxels) per cell: the three rhombi of the hexagon."""
_SAMPLES_PER_SIDE = 3
"""Samples per side of a force cell; those that are partly covered are sampled finer (`cell_loading`)."""
N_SAMPLES_PER_CELL = N_FORCE_CELLS * _SAMPLES_PER_SIDE**2

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class SkinSurface(NamedTuple):
    """Skin surface: cells of all patches in deployment order, on the rigid surface that they cover.

    A cell is a HEX-o-SKIN cell with e = 3 force cells and s = 27 samples, or another plane piece of
    skin whose foam is sampled in the same way (`sheet_surface`).

    Attributes:
        body_id: (n,) id of the body that carries each cell.
        position_m: (n, 3) centre of the cell on the rigid surface, frame of the body [m].
        R_body_cell: (n, 3, 3) columns are the cell's x, y and z (outward normal).
        curvature_per_m: (n,) curvature along each cell's x, 0 for HEX-o-SKIN, which is plane [1/m].
        patch_start: (p + 1,) row of the first cell of each patch, then the number of cells.
        patch_body_id: (p,) id of the body of each patch.
        patch_centre_m: (p, 3) centre of the bounding sphere of each patch's cells, frame of the body [m].
        patch_radius_m: (p,) radius of the bounding sphere [m].
        grid: Sample points of a cell's foam; s / e samples per force cell, in turn.
        n_taxels: e, number of force cells per cell.
    """

    body_id: Indices
    position_m: Floats
    R_body_cell: Floats
    curvature_per_m: Floats
    patch_start: Indices
    patch_body_id: Indices
    patch_centre_m: Floats
    patch_radius_m: Floats
    grid: SampleGrid
    n_taxels: int


def build_skin_surface(
    mj: mujoco.MjModel, patches: list[PlacedPatch], cells: CellSpec, source: Path | str
) -> SkinSurface:
    """Build the skin surface of `patches` on the bodies of `mj`.

    Raises:
        ModelError: a patch names a body that the model does not have.
    """
    return surface_of_patches(
        [require_body_id(mj, p.body, f"patches.{p.name}.body", source) for p in patches],
        [p.position_m for p in patches],
        [p.R_body_cell for p in patches],
        grid=cell_grid(cells.side_m),
        n_taxels=N_FORCE_CELLS,
    )


def rows_by_patch(patches: Sequence[PlacedPatch]) -> dict[str, slice]:
    """Rows of each patch's cells in the stimulus, by the name of the patch."""
    ends = np.cumsum([patch.n_cells for patch in patches]).tolist()
    return {p.name: slice(end - p.n_cells, end) for p, end in zip(patches, ends, strict=True)}


def surface_of_patches(
    body_id: Sequence[int],
    position_m: Sequence[Floats],
    R_body_cell: Sequence[Floats],
    *,
    grid: SampleGrid,
    n_taxels: int,
    curvature_per_m: Sequence[Floats] = (),
) -> SkinSurface:
    """Build a skin surface from lists with one entry per patch, plane unless told; fields: `SkinSurface`."""
    centre_m = [0.5 * (p.min(axis=0) + p.max(axis=0)) for p in position_m]
    radius_m = [np.linalg.norm(p - c, axis=1).max() for p, c in zip(position_m, centre_m, strict=True)]
    counts = [len(p) for p in position_m]
    return SkinSurface(
        body_id=np.repeat(np.array(body_id, dtype=np.int64), counts),
        position_m=np.concatenate([np.zeros((0, 3)), *position_m]),
        R_body_cell=np.concatenate([np.zeros((0, 3, 3)), *R_body_cell]),
        curvature_per_m=np.concatenate(curvature_per_m) if curvature_per_m else np.zeros(sum(counts)),
        patch_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        patch_body_id=np.array(body_id, dtype=np.int64),
        patch_centre_m=np.array(centre_m).reshape(-1, 3),
        patch_radius_m=np.array(radius_m, dtype=np.float64),
        grid=grid,
        n_taxels=n_taxels,
    )


def cell_grid(side_m: float) -> SampleGrid:
    """Lay out the 27 samples of a hexagon of side `side_m` [m]: all of its area, as cells in a lattice tile.

    Three rhombi meet at the centre of the hexagon; each is cut into 3 × 3 equal rhombi. Corners of the
    hexagon lie at 30°, 90°, …: the x axis points to an edge.
    """
    corners = hexagon_m(side_m)
    steps = (np.arange(_SAMPLES_PER_SIDE) + 0.5) / _SAMPLES_PER_SIDE
    axes = [(corners[2 * k], corners[(2 * k + 2) % 6]) for k in range(N_FORCE_CELLS)]
    return sample_grid(
        np.array([a * one + b * other for one, other in axes for a in steps for b in steps]),
        np.repeat(np.array(axes) / _SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE**2, axis=0),
        corners,
    )


def hexagon_m(side_m: float) -> Floats:
    """Hexagon corners (6, 2) [m] of a cell, counter-clockwise from 30°, in the plane of the cell."""
    corners: Floats = side_m * _directions([30.0 + 60.0 * k for k in range(6)])
    return corners


def force_cell_centre_m(force_cell: int, radius_m: float) -> Floats:
    """Force cell centre (2,) [m] in the plane of the cell: at 90°, 210° and 330°, radius `radius_m` [m]."""
    centre: Floats = radius_m * _directions([90.0 + 120.0 * force_cell])[0]
    return centre


def _directions(angles_deg: list[float]) -> Floats:
    angles = np.radians(angles_deg)
    return np.column_stack([pinned_math.cos_of(angles), pinned_math.sin_of(angles)])
