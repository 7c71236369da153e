"""Tactile sheets of a measured layout: flat or bent surfaces fitted to where their elements are."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.covering.covering_patches import patch_name, rounded_vector
from skinnet.covering.measured_layouts import Layout
from skinnet.covering.sheet_fit import SheetPose
from skinnet.deployment.skin.sheets import SurfaceSpec
from skinnet.errors import DeploymentError
from skinnet.pinned_arcs import atan2_of
from skinnet.pinned_linalg import matmul, norm, solve
from skinnet.skin.tactile_sheets import build_surface

__all__ = ["sheets_of_layout"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_MISFIT_FRACTION = 0.2
"""Greatest distance of an element from its place on the surface, as a fraction of the pitch *(assumed)*."""
_TILT_COSINE = pinned_math.cos(math.radians(20.0))
"""Greatest angle between its normal and that of the surface: 20° *(assumed)*."""
_FLATTEST_M = 2.0
"""Radius [m] from which on a surface counts as flat."""
_FLAT_M = 1e-6
"""Span of heights [m] below which elements lie in a plane."""
_LEAST_LENGTH = 1e-9
"""Length below which a vector has no direction."""
_DIGITS = 6
_MM_PER_M = 1e3


def sheets_of_layout(layout: Layout, name: str, body: str) -> list[SheetPose]:
    """Sheets of a layout, in the order of their first elements, on surfaces of their own.

    Each is flat, or a cylinder about the direction of its columns, whichever is nearer to its elements
    (least squares; the circle after Kåsa, 1976).

    Args:
        layout: Layout with sheets, rows and columns.
        name: Name with which those of the sheets begin.
        body: Body that carries them.

    Raises:
        DeploymentError: names the line of an element whose place is taken, or that lies or faces off the
            surface; or the sheet whose elements fix no surface, or are numbered from right to left.
    """
    names = list(dict.fromkeys(layout.sheet))
    return [
        _fitted(layout, np.flatnonzero(np.array(layout.sheet) == sheet), sheet, patch_name(name, sheet), body)
        for sheet in names
    ]


def _fitted(layout: Layout, rows: Ints, sheet: str, name: str, body: str) -> SheetPose:
    """Sheet whose elements are the `rows` (n,) of the layout."""
    grid = np.array(layout.grid)[rows]
    _require_grid(layout, rows, grid, sheet)
    position_m, normal = np.array(layout.position_m)[rows], np.array(layout.normal)[rows]
    normal /= np.sqrt((normal * normal).sum(axis=1))[:, None]
    shape = grid.max(axis=0) + 1
    at = np.column_stack([grid[:, 1] - 0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1) - grid[:, 0]])
    middle_m, across_m, up_m = _least_squares(np.column_stack([np.ones(len(at)), at]), position_m)
    up = _direction(layout, sheet, up_m)
    out = normal.mean(axis=0)
    out = _direction(layout, sheet, out - up * (out * up).sum())
    e1 = np.cross(up, out)
    if float((across_m * e1).sum()) <= 0.0:
        raise DeploymentError(
            f"{layout.name}: sheet {sheet!r}: its columns run from right to left as seen from outside with "
            "row 0 on top; number them from left to right, or turn the normals"
        )
    flat = SurfaceSpec(name=name, body=body, origin_m=_vector(middle_m), normal=_vector(out), up=_vector(up))
    pitch_m = 0.5 * (norm(across_m) + norm(up_m))
    fits = [(flat, pitch_m), *_bent(flat, position_m - middle_m, at, (e1, up, out), norm(up_m))]
    surface, pitch_m, placed_m, R = min(
        ((spec, pitch, *build_surface(spec).frame_at(pitch * at)) for spec, pitch in fits),
        key=lambda fit: float(((fit[2] - position_m) * (fit[2] - position_m)).sum()),
    )
    _require_fit(layout, rows, position_m, normal, placed_m, R, pitch_m)
    mask = np.full(shape, ".")
    mask[grid[:, 0], grid[:, 1]] = "#"
    return SheetPose(surface, placed_m, R, round(pitch_m, _DIGITS), 0.0, tuple("".join(row) for row in mask))


def _direction(layout: Layout, sheet: str, vector: Floats) -> Floats:
    """Unit vector (3,) along `vector`; refuse the sheet if that has no length."""
    length = norm(vector)
    if length < _LEAST_LENGTH:
        raise DeploymentError(
            f"{layout.name}: sheet {sheet!r}: its elements lie at one place, or their normals cancel or "
            "run along its columns; give centres in m and outward normals"
        )
    direction: Floats = vector / length
    return direction


def _bent(
    flat: SurfaceSpec, off_m: Floats, at: Floats, axes: tuple[Floats, Floats, Floats], up_pitch_m: float
) -> list[tuple[SurfaceSpec, float]]:
    """Cylinder about the columns fitted to elements, with its pitch [m]; none if they are flat or hollow.

    Args:
        flat: Plane through their middle.
        off_m: (n, 3) their centres from there [m].
        at: (n, 2) their places, in pitches.
        axes: Directions of rows and columns, and outwards.
        up_pitch_m: Their pitch along the columns [m].
    """
    e1, up, out = axes
    x, z = (off_m * e1).sum(axis=1), (off_m * out).sum(axis=1)
    if float(np.ptp(z)) < _FLAT_M:
        return []
    centre_x, centre_z, rest = _least_squares(
        np.column_stack([2.0 * x, 2.0 * z, np.ones(len(x))]), x * x + z * z
    )
    square_m2 = float(rest + centre_x * centre_x + centre_z * centre_z)
    if centre_z >= 0.0 or not 0.0 < square_m2 < _FLATTEST_M * _FLATTEST_M:
        return []
    radius_m = math.sqrt(square_m2)
    angle = atan2_of(x - centre_x, z - centre_z)
    first, step = _least_squares(np.column_stack([np.ones(len(at)), at[:, 0]]), angle)
    sin, cos = pinned_math.sin(float(first)), pinned_math.cos(float(first))
    normal = sin * e1 + cos * out
    origin_m = np.array(flat.origin_m) + centre_x * e1 + centre_z * out + radius_m * normal
    spec = SurfaceSpec(
        name=flat.name,
        body=flat.body,
        origin_m=_vector(origin_m),
        normal=_vector(normal),
        up=_vector(up),
        radius_m=round(radius_m, _DIGITS),
    )
    return [(spec, 0.5 * (radius_m * float(step) + up_pitch_m))]


def _least_squares(design: Floats, values: Floats) -> Floats:
    """Coefficients (k, …) of the columns of `design` (n, k) that are nearest to `values` (n, …)."""
    return solve(matmul(design.T, design), matmul(design.T, values))


def _require_grid(layout: Layout, rows: Ints, grid: Ints, sheet: str) -> None:
    """Require each place once, and at least two rows and two columns."""
    taken: dict[tuple[int, ...], int] = {}
    for row, place in zip(rows.tolist(), map(tuple, grid.tolist()), strict=True):
        if place in taken:
            raise DeploymentError(
                f"{layout.name}: lines {layout.line[taken[place]]} and {layout.line[row]} are both "
                f"row {place[0]}, column {place[1]} of sheet {sheet!r}; number each element once"
            )
        taken[place] = row
    down, along = (grid - grid[0]).T
    common = int((down * along).sum())
    if int((down * down).sum()) * int((along * along).sum()) == common * common:
        raise DeploymentError(
            f"{layout.name}: sheet {sheet!r}: its elements lie in one line of its grid, which fixes no "
            "surface; give elements of two rows and two columns at least"
        )


def _require_fit(
    layout: Layout,
    rows: Ints,
    position_m: Floats,
    normal: Floats,
    placed_m: Floats,
    R: Floats,
    pitch_m: float,
) -> None:
    """Require that elements lie on the fitted surface, in its grid, and face as it does."""
    off_m = np.sqrt(((placed_m - position_m) * (placed_m - position_m)).sum(axis=1))
    worst = int(off_m.argmax())
    remedy = 'a sheet is flat or bent about its columns; correct the line, or give kind = "cells"'
    if off_m[worst] > _MISFIT_FRACTION * pitch_m:
        raise DeploymentError(
            f"{layout.name}: line {layout.line[rows[worst]]}: {_MM_PER_M * off_m[worst]:.1f} mm from its "
            f"place in a grid of {_MM_PER_M * pitch_m:.1f} mm; {remedy}"
        )
    alike = (R[:, :, 2] * normal).sum(axis=1)
    worst = int(alike.argmin())
    if alike[worst] < _TILT_COSINE:
        raise DeploymentError(
            f"{layout.name}: line {layout.line[rows[worst]]}: its normal is more than 20° off that of its "
            f"sheet; {remedy}"
        )


def _vector(vector: Floats) -> tuple[float, float, float]:
    return rounded_vector(vector, _DIGITS)
