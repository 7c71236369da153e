"""The skin as the body carries it: the cells of all patches as arrays, and the foam's sample points."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import require_body
from skinnet.deployment.schema import CellSpec
from skinnet.skin.placement import PlacedPatch

__all__ = [
    "N_ELEMENTS",
    "N_SAMPLES",
    "Surface",
    "element_centre_m",
    "hexagon_m",
    "sample_points_m",
    "skin_surface",
    "surface_of_patches",
]

N_ELEMENTS = 3
"""Force cells per cell: the three rhombi of the hexagon."""
_PER_SIDE = 3
"""3 × 3 points per force cell ripple by 3.5 % when a contact moves, one point by 29 % (FACTS.md)."""
N_SAMPLES = N_ELEMENTS * _PER_SIDE**2

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class Surface(NamedTuple):
    """Cells of all patches in the order of the deployment, on the rigid surface that they cover.

    A cell is a HEX-o-SKIN cell with e = 3 force cells and s = 27 sample points, or any other plane piece of
    skin whose foam is sampled alike (`sheet_surface`).

    Attributes:
        body: (n,) id of the body that carries each cell.
        position_m: (n, 3) middle of the cell on the rigid surface, frame of the body [m].
        R_body_cell: (n, 3, 3) columns are the cell's x, y and z (outward normal).
        patch_start: (p + 1,) first cell of each patch, and the number of cells.
        patch_body: (p,) id of the body of each patch.
        patch_centre_m: (p, 3) middle of a ball around the centres of the patch, frame of the body [m].
        patch_radius_m: (p,) its radius [m].
        sample_m: (s, 2) points at which a cell's foam is sampled, plane of the cell [m]; as many for each
            force cell in turn.
        sample_area_m2: Area that each of them stands for [m²].
        n_elements: e, number of force cells of a cell.
    """

    body: Indices
    position_m: Floats
    R_body_cell: Floats
    patch_start: Indices
    patch_body: Indices
    patch_centre_m: Floats
    patch_radius_m: Floats
    sample_m: Floats
    sample_area_m2: float
    n_elements: int


def skin_surface(
    mj: mujoco.MjModel, patches: list[PlacedPatch], cells: CellSpec, source: Path | str
) -> Surface:
    """Puts `patches` onto the bodies of `mj`.

    Raises:
        ModelError: a patch names a body that the model does not have.
    """
    return surface_of_patches(
        [require_body(mj, p.body, f"patches.{p.name}.body", source) for p in patches],
        [p.position_m for p in patches],
        [p.R_body_cell for p in patches],
        sample_m=sample_points_m(cells.side_m),
        sample_area_m2=1.5 * math.sqrt(3.0) * cells.side_m**2 / N_SAMPLES,
        n_elements=N_ELEMENTS,
    )


def surface_of_patches(
    body: Sequence[int],
    position_m: Sequence[Floats],
    R_body_cell: Sequence[Floats],
    *,
    sample_m: Floats,
    sample_area_m2: float,
    n_elements: int,
) -> Surface:
    """Skin that lies on bodies in patches; lists have an entry for each, else as in `Surface`."""
    centre_m = [0.5 * (p.min(axis=0) + p.max(axis=0)) for p in position_m]
    radius_m = [np.linalg.norm(p - c, axis=1).max() for p, c in zip(position_m, centre_m, strict=True)]
    counts = [len(p) for p in position_m]
    return Surface(
        body=np.repeat(np.array(body, dtype=np.int64), counts),
        position_m=np.concatenate([np.zeros((0, 3)), *position_m]),
        R_body_cell=np.concatenate([np.zeros((0, 3, 3)), *R_body_cell]),
        patch_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        patch_body=np.array(body, dtype=np.int64),
        patch_centre_m=np.array(centre_m).reshape(-1, 3),
        patch_radius_m=np.array(radius_m, dtype=np.float64),
        sample_m=sample_m,
        sample_area_m2=sample_area_m2,
        n_elements=n_elements,
    )


def sample_points_m(side_m: float) -> Floats:
    """Sample points (27, 2) [m] of a hexagon of `side_m`, with equal areas, in the plane of the cell.

    Three rhombi meet in the middle of the hexagon; each is cut into 3 × 3 equal rhombi with a point in
    the middle. Corners of the hexagon lie at 30°, 90°, …: the x axis points to an edge.
    """
    corners = hexagon_m(side_m)
    steps = (np.arange(_PER_SIDE) + 0.5) / _PER_SIDE
    return np.array(
        [
            a * corners[2 * k] + b * corners[(2 * k + 2) % 6]
            for k in range(N_ELEMENTS)
            for a in steps
            for b in steps
        ]
    )


def hexagon_m(side_m: float) -> Floats:
    """Corners (6, 2) [m] of a cell, counter-clockwise from 30°, in the plane of the cell."""
    corners: Floats = side_m * _directions([30.0 + 60.0 * k for k in range(6)])
    return corners


def element_centre_m(element: int, radius_m: float) -> Floats:
    """Middle (2,) [m] of a force cell in the plane of the cell: at 90°, 210° and 330°, `radius_m` out."""
    centre: Floats = radius_m * _directions([90.0 + 120.0 * element])[0]
    return centre


def _directions(angles_deg: list[float]) -> Floats:
    angles = np.radians(angles_deg)
    return np.column_stack([np.cos(angles), np.sin(angles)])
