"""Fit of tactile sheets to a link: poses, flat or bent round a cylinder, in which all elements lie on it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from skinnet.covering.cell_heights import heights_under_cell
from skinnet.covering.covering_patches import rounded_vector
from skinnet.covering.link_covering import LinkGround, row_axis
from skinnet.deployment.skin.sheets import MAX_SIDE, SheetSpec, SurfaceSpec
from skinnet.skin.tactile_sheets import Surface, build_surface

__all__ = ["SheetPose", "fit_sheet", "sheet_poses"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_GAP_M = 4e-3
"""Greatest height [m] of an element of a sheet over the felt surface *(assumed)*."""
_SEEDS = 200
_ANGLES_DEG = (0.0, 90.0, 45.0, 135.0)
_FLATTEST_M = 2.0
"""Radius [m] from which on a surface counts as flat."""
_HALF = 0.5 * MAX_SIDE
_LINE = np.array([(0.0, (0.5 * (MAX_SIDE - 1) - row) / _HALF) for row in range(MAX_SIDE)])
_LINE.flags.writeable = False  # as the points of cells, so that nothing is compiled twice
"""Elements of a column of a sheet, in units of half its width."""
_COLUMNS = np.array([(column - 0.5 * (MAX_SIDE - 1), 0.0) for column in range(MAX_SIDE)])
_GRID = np.repeat(_COLUMNS, MAX_SIDE, axis=0) + np.tile(_HALF * _LINE, (MAX_SIDE, 1))
"""Middles of the columns, and all elements, as tactile coordinates in units of the pitch."""
_OUTER_FIRST = (0, 7, 3, 1, 6, 2, 5, 4)
_NEAREST = 4
_FACING_COSINE = 0.5
_DIGITS = 6


@dataclass(frozen=True)
class SheetPose:
    """Sheet at ξ = 0 of a surface of its own, and its elements as they will be placed.

    Attributes:
        surface: The surface, whose name is that of the sheet.
        position_m: (n, 3) centres of the elements, column by column, frame of the body [m].
        R_body_element: (n, 3, 3) their axes.
        pitch_m: Their pitch [m].
        gap_m: Mean gap under them [m].
        mask: Rows of the grid from the top, as in the spec of the sheet; 8 × 8 elements without it.
    """

    surface: SurfaceSpec
    position_m: Floats
    R_body_element: Floats
    pitch_m: float
    gap_m: float
    mask: tuple[str, ...] = ()

    @cached_property
    def middle_m(self) -> Floats:
        """Mean (3,) of the centres of the elements [m]."""
        middle_m: Floats = self.position_m.mean(axis=0)
        return middle_m

    @property
    def sheet(self) -> SheetSpec:
        """Sheet that covers the surface."""
        whole = SheetSpec(name=self.surface.name, surface=self.surface.name, pitch_m=self.pitch_m)
        if not self.mask:
            return whole
        return replace(whole, rows=len(self.mask), columns=len(self.mask[0]), mask=self.mask)


def sheet_poses(of: LinkGround, pitch_m: float) -> Iterator[SheetPose]:
    """Poses in which a sheet fits the surface asked for: at places and in directions spread over it."""
    samples, asked = of.ground.samples, np.flatnonzero(of.ground.asked)
    for seed in asked[:: max(len(asked) // _SEEDS, 1)].tolist():
        point_m, normal = samples.point_m[seed], samples.normal[seed]
        for angle_deg in _ANGLES_DEG:
            up = row_axis(normal, of.axis, angle_deg)
            pose = fit_sheet(of, pitch_m, point_m, normal, up, _radius_m(of, pitch_m, point_m, normal, up))
            if pose is not None:
                yield pose


def fit_sheet(
    of: LinkGround, pitch_m: float, point_m: Floats, normal: Floats, up: Floats, radius_m: float | None
) -> SheetPose | None:
    """Lay a sheet at `point_m` (3,) on the side of `normal` (3,), lifted until it rests on the surface.

    Args:
        of: Surface of the link.
        pitch_m: Pitch of its elements [m].
        point_m: Middle of the sheet, frame of the body [m].
        normal: Outward normal there.
        up: Direction of its columns.
        radius_m: Radius of the cylinder round which it is bent [m]; flat for None.

    Returns:
        The pose, or None if an element does not lie on surface that is asked for.
    """
    if radius_m is not None and math.pi * radius_m < _HALF * pitch_m:
        return None
    height_m = _heights_m(of, pitch_m, build_surface(_surface(of.body, point_m, normal, up, radius_m)))
    if height_m is None:
        return None
    top_m = float(height_m.max())
    lifted_m = point_m + top_m * normal
    surface = _surface(of.body, lifted_m, normal, up, None if radius_m is None else radius_m + top_m)
    position_m, R = build_surface(surface).frame_at(pitch_m * _GRID)
    if not _lies_on_asked(of, position_m, R[:, :, 2]):
        return None
    return SheetPose(surface, position_m, R, pitch_m, float((top_m - height_m).mean()))


def _surface(body: str, origin_m: Floats, normal: Floats, up: Floats, radius_m: float | None) -> SurfaceSpec:
    return SurfaceSpec(
        name="sheet",
        body=body,
        origin_m=rounded_vector(origin_m, _DIGITS),
        normal=rounded_vector(normal, _DIGITS),
        up=rounded_vector(up, _DIGITS),
        radius_m=None if radius_m is None else round(radius_m, _DIGITS),
    )


def _heights_m(of: LinkGround, pitch_m: float, surface: Surface) -> Floats | None:
    """Heights (n,) [m] of the felt surface along the normals of the elements; None if they differ much."""
    middle_m, R = surface.frame_at(pitch_m * _COLUMNS)
    height_m = np.zeros((MAX_SIDE, MAX_SIDE))
    low_m, high_m = math.inf, -math.inf
    for column in _OUTER_FIRST:
        heights_under_cell(
            of.ground.solids,
            middle_m[column],
            np.ascontiguousarray(R[column]),
            _LINE,
            _HALF * pitch_m,
            0.5 * pitch_m,
            0.5 * pitch_m + _GAP_M,
            height_m[column],
        )
        low_m, high_m = min(low_m, height_m[column].min()), max(high_m, height_m[column].max())
        if not low_m > high_m - _GAP_M or high_m >= 0.5 * pitch_m:
            return None
    return height_m.ravel()


def _lies_on_asked(of: LinkGround, position_m: Floats, normal: Floats) -> bool:
    """True if surface that is asked for is nearest to every element (n, 3), on its side."""
    samples = of.ground.samples
    off_m, near = of.tree.query(position_m, _NEAREST)
    facing = (samples.normal[near] * normal[:, None]).sum(axis=2) > _FACING_COSINE
    close = off_m <= _GAP_M + 2.0 * samples.spacing_m
    return bool((facing & close & of.ground.asked[near]).any(axis=1).all())


def _radius_m(of: LinkGround, pitch_m: float, point_m: Floats, normal: Floats, up: Floats) -> float | None:
    """Radius [m] of the circle fitted to the surface across `up` (least squares); None if it is flat."""
    samples = of.ground.samples
    near = np.array(sorted(of.tree.query_ball_point(point_m, 1.5 * _HALF * pitch_m)), dtype=np.int64)
    off_m = samples.point_m[near] - point_m
    along_m, height_m = (off_m * up).sum(axis=1), (off_m * normal).sum(axis=1)
    across_m = (off_m * np.cross(up, normal)).sum(axis=1)
    own = (np.abs(along_m) <= 0.5 * pitch_m) & (np.abs(across_m) <= _HALF * pitch_m)
    own &= (samples.normal[near] * normal).sum(axis=1) > _FACING_COSINE
    x, z = across_m[own], height_m[own]
    down_m2 = float((z * z).sum())
    if down_m2 <= 1e-12:
        return None
    radius_m = -0.5 * float((z * (x * x + z * z)).sum()) / down_m2
    return radius_m if 0.0 < radius_m < _FLATTEST_M else None
