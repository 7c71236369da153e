"""Tactile sheets: grids of up to 8 × 8 pressure elements (taxels) on flat or cylindrical surfaces.

A surface has tactile coordinates ξ = (ξ1, ξ2) [m], "assigned to and spanning the robot surface" [R11, III]:
ξ1 is the arc length along its cross-section, ξ2 the length along its axis. The cross-section is a straight
segment with tangent arcs on both sides, so that ξ is continuous, isometric and orthogonal everywhere. Several
sheets may lie on one surface; they share its coordinates.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet import pinned_math
from skinnet.deployment.skin.sheets import SheetSpec, SurfaceSpec
from skinnet.errors import DeploymentError
from skinnet.near_points import near_pairs_between
from skinnet.pinned_arcs import atan2_of
from skinnet.pinned_linalg import dot, matmul, norm
from skinnet.suggestions import known_names

__all__ = ["PlacedSheet", "Surface", "build_surface", "place_sheets"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_ELEMENT, _GAP = "#", "."
_OVERLAP_FRACTION = 0.75
"""Overlap threshold of centres as a fraction of the pitch (a tightly bent sheet shortens chords)."""


@dataclass(frozen=True)
class Surface:
    """Surface with tactile coordinates.

    Attributes:
        name: Name of the surface.
        body: Name of the body that carries it.
        origin_m: (3,) origin of ξ, body frame [m].
        R_body_surface: (3, 3) surface frame at the origin: columns are e1, e2 and the outward normal.
        radius_m: Radius of the cylindrical sides [m]; inf for a plane.
        flat_half_width_m: Half the width of the flat middle [m]; inf for a plane.
    """

    name: str
    body: str
    origin_m: Floats
    R_body_surface: Floats
    radius_m: float
    flat_half_width_m: float

    @property
    def max_xi1_m(self) -> float:
        """Greatest tactile coordinate |ξ1| [m], at which the cylindrical sides span half a circle."""
        return self.flat_half_width_m + math.pi * self.radius_m

    def frame_at(self, xi_m: ArrayLike, height_m: ArrayLike = 0.0) -> tuple[Floats, Floats]:
        """Return position (…, 3) [m] and rotation (…, 3, 3) of the surface at ξ (…, 2) [m], body frame.

        The columns of the rotation are the tangents e1 and e2 along the coordinates and the outward normal
        e1 × e2 [R11, V]; positions are `height_m` (…) [m] above the rigid surface along the normal.
        """
        xi1, xi2 = np.moveaxis(np.asarray(xi_m, dtype=np.float64), -1, 0)
        across = np.clip(xi1, -self.flat_half_width_m, self.flat_half_width_m)
        angle = (xi1 - across) / self.radius_m
        sin, cos, zero = pinned_math.sin_of(angle), pinned_math.cos_of(angle), np.zeros_like(xi1)
        bent = self.radius_m if math.isfinite(self.radius_m) else 0.0
        local = np.stack([across + bent * sin, xi2, -bent * (1.0 - cos)], axis=-1)
        normal = np.stack([sin, zero, cos], axis=-1)
        local = local + np.asarray(height_m, dtype=np.float64)[..., None] * normal
        e1 = np.stack([cos, zero, -sin], axis=-1)
        e2 = np.broadcast_to([0.0, 1.0, 0.0], e1.shape)
        rotation = matmul(self.R_body_surface, np.stack([e1, e2, normal], axis=-1))
        return self.origin_m + matmul(local, self.R_body_surface.T), rotation

    def tactile_coordinates(self, position_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return tactile coordinates (…, 2) [m] and heights (…) [m] of points (…, 3) [m], body frame.

        The inverse of `frame_at` for points above the axes of the cylindrical sides or around them; the
        coordinates are those of the orthogonal projection on the surface.
        """
        local = matmul(np.asarray(position_m, dtype=np.float64) - self.origin_m, self.R_body_surface)
        x, y, z = np.moveaxis(local, -1, 0)
        if not math.isfinite(self.radius_m):
            return np.stack([x, y], axis=-1), z
        side = np.copysign(self.flat_half_width_m, x)
        over_flat = (np.abs(x) <= self.flat_half_width_m) & (z > -self.radius_m)
        dx, dz = x - side, z + self.radius_m
        xi1 = np.where(over_flat, x, side + self.radius_m * atan2_of(dx, dz))
        height = np.where(over_flat, z, pinned_math.hypot_of(dx, dz) - self.radius_m)
        return np.stack([xi1, y], axis=-1), height


@dataclass(frozen=True)
class PlacedSheet:
    """Placed tactile sheet; elements are numbered row by row in the mask, the scan order of its board.

    Attributes:
        name: Name of the sheet and of its board.
        surface: Surface that carries it.
        grid: (n, 2) row and column of each element.
        xi_m: (n, 2) tactile coordinates of the elements [m].
        position_m: (n, 3) centres of the elements on the rigid surface, body frame [m].
        R_body_element: (n, 3, 3) rotations of the elements; columns are e1, e2 and the outward normal.
        neighbours: (m, 2) pairs of neighbouring elements, each once, the lower number first, in order.
        area_m2: Area of an element [m²].
    """

    name: str
    surface: Surface
    grid: Ints
    xi_m: Floats
    position_m: Floats
    R_body_element: Floats
    neighbours: Ints
    area_m2: float

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return len(self.xi_m)


def build_surface(spec: SurfaceSpec) -> Surface:
    """Build the surface that a deployment describes.

    Raises:
        DeploymentError: vectors are degenerate, or a plane has a flat middle.
    """
    where = f"surfaces.{spec.name}"
    if spec.radius_m is None and spec.flat_m > 0.0:
        raise DeploymentError(
            f"{where}.flat_m = {spec.flat_m}: not allowed on a plane; give radius_m, or remove it"
        )
    normal = _unit(f"{where}.normal", np.array(spec.normal))
    up = np.array(spec.up)
    e2 = _unit(f"{where}.up (it may not be parallel to normal)", up - normal * dot(up, normal))
    return Surface(
        name=spec.name,
        body=spec.body,
        origin_m=np.array(spec.origin_m),
        R_body_surface=np.column_stack([np.cross(e2, normal), e2, normal]),
        radius_m=math.inf if spec.radius_m is None else spec.radius_m,
        flat_half_width_m=math.inf if spec.radius_m is None else 0.5 * spec.flat_m,
    )


def place_sheets(surfaces: Iterable[SurfaceSpec], sheets: Iterable[SheetSpec]) -> tuple[PlacedSheet, ...]:
    """Place all `sheets` of a robot.

    Raises:
        DeploymentError: as `build_surface`; a name is given twice or unknown, a mask does not match its grid,
            a sheet extends beyond half a circle on one side of its surface, or elements overlap.
    """
    known: dict[str, Surface] = {}
    for spec in surfaces:
        if spec.name in known:
            raise DeploymentError(f"surfaces.{spec.name}: duplicate name; give each its own")
        known[spec.name] = build_surface(spec)
    placed: dict[str, PlacedSheet] = {}
    for sheet in sheets:
        if sheet.name in placed:
            raise DeploymentError(f"sheets.{sheet.name}: duplicate name; give each its own")
        if sheet.surface not in known:
            names = known_names(sheet.surface, known)
            raise DeploymentError(f"sheets.{sheet.name}.surface = {sheet.surface!r}: unknown; {names}")
        placed[sheet.name] = _place_sheet(sheet, known[sheet.surface])
    for one, other in combinations(placed.values(), 2):
        if one.surface.body == other.surface.body:
            _require_no_overlap(one, other)
    return tuple(placed.values())


def _unit(key: str, vector: Floats) -> Floats:
    length = norm(vector)
    if not math.isfinite(length) or length < 1e-9:
        raise DeploymentError(f"{key} = {vector.tolist()}: the vector must have a finite length above zero")
    return vector / length


def _place_sheet(spec: SheetSpec, surface: Surface) -> PlacedSheet:
    grid = _element_grid(spec)
    half = 0.5 * np.array([spec.columns - 1, spec.rows - 1])
    steps = np.column_stack([grid[:, 1] - half[0], half[1] - grid[:, 0]])
    xi_m = np.array(spec.centre_xi_m) + spec.pitch_m * steps
    if np.abs(xi_m[:, 0]).max() > surface.max_xi1_m - 0.5 * spec.pitch_m + 1e-9:
        raise DeploymentError(
            f"sheets.{spec.name}: an element lies at ξ1 = {np.abs(xi_m[:, 0]).max():.4f} m; "
            f"{surface.name} extends to {surface.max_xi1_m:.4f} m on both sides; use fewer columns"
        )
    position_m, rotation = surface.frame_at(xi_m)
    neighbours = _neighbours(grid, connect_across_gaps=spec.connect_across_gaps)
    area_m2 = spec.pitch_m * spec.pitch_m
    return PlacedSheet(spec.name, surface, grid, xi_m, position_m, rotation, neighbours, area_m2)


def _element_grid(spec: SheetSpec) -> Ints:
    """Return rows and columns (n, 2) of the elements, row by row."""
    mask = spec.mask or (_ELEMENT * spec.columns,) * spec.rows
    if len(mask) != spec.rows or any(len(row) != spec.columns or set(row) - {_ELEMENT, _GAP} for row in mask):
        raise DeploymentError(
            f"sheets.{spec.name}.mask: needs {spec.rows} texts of {spec.columns} characters {_ELEMENT} or "
            f"{_GAP}; got {list(mask)}"
        )
    grid = np.argwhere(np.array([list(row) for row in mask]) == _ELEMENT)
    if not len(grid):
        raise DeploymentError(f"sheets.{spec.name}.mask: leaves no element")
    return grid


def _neighbours(grid: Ints, *, connect_across_gaps: bool) -> Ints:
    """Return neighbour pairs (m, 2) in the 8-neighbourhood; if asked, also across gaps of one."""
    number = {(row, column): i for i, (row, column) in enumerate(grid.tolist())}
    pairs = set()
    for (row, column), i in number.items():
        for down, right in product((-1, 0, 1), repeat=2):
            to = number.get((row + down, column + right))
            if to is not None:
                pairs.add((i, to))
            if not connect_across_gaps:
                continue
            if (row, column + 1) not in number and (row + down, column + 1) not in number:
                pairs.add((i, number.get((row + down, column + 2), i)))
            if (row + 1, column) not in number and (row + 1, column + right) not in number:
                pairs.add((i, number.get((row + 2, column + right), i)))
    ordered = sorted({(min(pair), max(pair)) for pair in pairs if pair[0] != pair[1]})
    return np.array(ordered, dtype=np.int64).reshape(-1, 2)


def _require_no_overlap(one: PlacedSheet, other: PlacedSheet) -> None:
    reach_m = _OVERLAP_FRACTION * math.sqrt(min(one.area_m2, other.area_m2))
    for a, b in near_pairs_between(one.position_m, other.position_m, reach_m):
        if dot(one.R_body_element[a, :, 2], other.R_body_element[b, :, 2]) > 0.0:  # else back to back
            raise DeploymentError(
                f"sheets.{other.name}: element {b} overlaps element {a} of {one.name} on {one.surface.body}"
            )
