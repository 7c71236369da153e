"""Skin surface on its bodies: cells of all patches as arrays, and sample points of the foam."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.model import require_body_id
from skinnet.deployment.skin.cells import CellSpec
from skinnet.skin.placement import PlacedPatch

__all__ = [
    "N_FORCE_CELLS",
    "N_SAMPLES_PER_CELL",
    "SkinSurface",
    "build_skin_surface",
    "force_cell_centre_m",
    "hexagon_m",
    "rows_by_patch",
    "sample_points_m",
    "surface_of_patches",
]

N_FORCE_CELLS = 3
"""Force cells (taxels) per cell: the three rhombi of the hexagon."""
_SAMPLES_PER_SIDE = 3
"""Sample points per side of a force cell: force ripple of 3.5 %, with one point 29 %, docs/assumptions.md."""
N_SAMPLES_PER_CELL = N_FORCE_CELLS * _SAMPLES_PER_SIDE**2

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class SkinSurface(NamedTuple):
    """Skin surface: cells of all patches in deployment order, on the rigid surface that they cover.

    A cell is a HEX-o-SKIN cell with e = 3 force cells and s = 27 sample points, or another plane piece of
    skin whose foam is sampled in the same way (`sheet_surface`).

    Attributes:
        body_id: (n,) id of the body that carries each cell.
        position_m: (n, 3) centre of the cell on the rigid surface, frame of the body [m].
        R_body_cell: (n, 3, 3) columns are the cell's x, y and z (outward normal).
        patch_start: (p + 1,) row of the first cell of each patch, then the number of cells.
        patch_body_id: (p,) id of the body of each patch.
        patch_centre_m: (p, 3) centre of the bounding sphere of each patch's cells, frame of the body [m].
        patch_radius_m: (p,) radius of the bounding sphere [m].
        sample_m: (s, 2) sample points of a cell's foam, plane of the cell [m]; s / e per force cell, in turn.
        sample_area_m2: Area per sample point [m²].
        n_taxels: e, number of force cells per cell.
    """

    body_id: Indices
    position_m: Floats
    R_body_cell: Floats
    patch_start: Indices
    patch_body_id: Indices
    patch_centre_m: Floats
    patch_radius_m: Floats
    sample_m: Floats
    sample_area_m2: float
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
        sample_m=sample_points_m(cells.side_m),
        sample_area_m2=1.5 * math.sqrt(3.0) * cells.side_m * cells.side_m / N_SAMPLES_PER_CELL,
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
    sample_m: Floats,
    sample_area_m2: float,
    n_taxels: int,
) -> SkinSurface:
    """Build a skin surface from lists with one entry per patch; fields as in `SkinSurface`."""
    centre_m = [0.5 * (p.min(axis=0) + p.max(axis=0)) for p in position_m]
    radius_m = [np.linalg.norm(p - c, axis=1).max() for p, c in zip(position_m, centre_m, strict=True)]
    counts = [len(p) for p in position_m]
    return SkinSurface(
        body_id=np.repeat(np.array(body_id, dtype=np.int64), counts),
        position_m=np.concatenate([np.zeros((0, 3)), *position_m]),
        R_body_cell=np.concatenate([np.zeros((0, 3, 3)), *R_body_cell]),
        patch_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        patch_body_id=np.array(body_id, dtype=np.int64),
        patch_centre_m=np.array(centre_m).reshape(-1, 3),
        patch_radius_m=np.array(radius_m, dtype=np.float64),
        sample_m=sample_m,
        sample_area_m2=sample_area_m2,
        n_taxels=n_taxels,
    )


def sample_points_m(side_m: float) -> Floats:
    """Sample points (27, 2) [m] of a hexagon of side `side_m` [m], of equal areas, plane of the cell.

    Three rhombi meet at the centre of the hexagon; each is cut into 3 × 3 equal rhombi with a point at
    the centre. Corners of the hexagon lie at 30°, 90°, …: the x axis points to an edge.
    """
    corners = hexagon_m(side_m)
    steps = (np.arange(_SAMPLES_PER_SIDE) + 0.5) / _SAMPLES_PER_SIDE
    return np.array(
        [
            a * corners[2 * k] + b * corners[(2 * k + 2) % 6]
            for k in range(N_FORCE_CELLS)
            for a in steps
            for b in steps
        ]
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
