"""Covering of one link: the best of several lattices over the surface that is asked for."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet import pinned_math
from skinnet.body.contact.collision_filter import geoms_felt_by_bodies
from skinnet.covering.asked_surface import creases, in_region
from skinnet.covering.cell_heights import heights_under_cell, peak_m
from skinnet.covering.cell_limits import CellLimits, limits_of
from skinnet.covering.cell_settling import Ground
from skinnet.covering.cell_shifts import shift_cells
from skinnet.covering.felt_solids import (
    FeltSolids,
    Link,
    Model,
    felt_geoms,
    felt_solids,
    geom_names,
    neighbour_poses,
)
from skinnet.covering.hexagons import hexagon_grid
from skinnet.covering.home_neighbours import home_neighbours
from skinnet.covering.lattice_growth import grow_lattice, improve_lattice
from skinnet.covering.link_neighbours import Neighbour, join_neighbours, mark_reached
from skinnet.covering.port_turns import best_turns, turned
from skinnet.covering.sample_search import SurfaceSamples
from skinnet.covering.surface_samples import sample_surface
from skinnet.deployment.skin.covers import CoverSpec
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import pitch_m as pitch_of_side_m
from skinnet.suggestions import known_names

__all__ = [
    "CellSize",
    "LinkCovering",
    "LinkGround",
    "cover_ground",
    "largest_side_m",
    "prepare_ground",
    "row_axis",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SEEDS = 2
_ANGLES_DEG = (0.0, 30.0)
"""Angles of the first rows to the axis of the link."""
_SEEDS_OF_FEW, _FEW_CELLS = 4, 40
_ROUNDS = 24
_COMPONENT_COST, _WIRE_GAIN = 0.5, 0.15
"""Score of a lattice in cells: every component costs so many, every wire is worth so many."""
_RINGS = (5, 8)
_INTRUSION_FRACTION = 0.035
"""Height in the foam to which the link may reach at one of many points, as a fraction of the pitch."""
_SMALLER = 0.85
"""Step of the search for a cell that fits, as a ratio of sides."""


@dataclass(frozen=True)
class CellSize:
    """Size of the cells: side of the hexagon, pitch and thickness of the foam [m]; density of samples."""

    side_m: float
    pitch_m: float
    foam_m: float
    samples_per_pitch: float = 8.0


@dataclass(frozen=True)
class LinkGround:
    """Surface of a link, and what of it is asked for.

    Attributes:
        link: The link.
        body: Name of its body.
        ground: Solids, samples, and where cells may lie.
        limits: Limits that its cells keep.
        axis: (3,) axis of the link, along its longest side.
        n_in_region: Number of samples in the region, before clearance.
    """

    link: Link
    body: str
    ground: Ground
    limits: CellLimits
    axis: Floats
    n_in_region: int

    @cached_property
    def tree(self) -> cKDTree:
        """Tree of the samples, for searches."""
        return cKDTree(self.ground.samples.point_m)

    @property
    def asked_m2(self) -> float:
        """Area asked for [m²]."""
        return float(self.ground.samples.area_m2[self.ground.asked].sum())


@dataclass(frozen=True)
class LinkCovering:
    """Cells of a link: positions (n, 3) [m] and rotations (n, 3, 3), frame of its body."""

    of: LinkGround
    position_m: Floats
    R_body_cell: Floats


def prepare_ground(
    mj: Model, link: Link, body: str, cover: CoverSpec, size: CellSize, home_qpos: Floats
) -> LinkGround:
    """Sample the surface of `link` and find what of it `cover` asks for; clearance is also that at home.

    Raises:
        DeploymentError: the region names a geom that the link does not have.
        ModelError: a mesh of the link is flat.
    """
    solids = felt_solids(mj, link)
    samples = sample_surface(solids, size.pitch_m / size.samples_per_pitch)
    inside = np.ones(len(samples.point_m), dtype=np.bool_)
    if cover.region is not None:
        inside = in_region(samples, solids, cover.region, _region_geoms(mj, solids, body, cover))
    reached = np.zeros(len(samples.point_m), dtype=np.bool_)
    neighbours = join_neighbours(
        _neighbours(mj, link, home_qpos, size) if cover.clearance else [], none=solids
    )
    mark_reached(samples.point_m, samples.normal, neighbours, size.foam_m, reached)
    blocked = np.zeros_like(reached)
    if cover.margin_m is not None:
        blocked = reached | ~inside | creases(samples)
    limits = limits_of(size.pitch_m, size.side_m, size.foam_m, cover.margin_m or 0.0)
    ground = Ground(solids, samples, inside & ~reached, blocked, neighbours)
    return LinkGround(link, body, ground, limits, _longest_axis(solids, samples), int(inside.sum()))


def _neighbours(mj: Model, link: Link, home_qpos: Floats, size: CellSize) -> list[Neighbour]:
    """Neighbours of `link` across its joints, and what it feels of the robot at home."""
    felt = np.flatnonzero(np.any(geoms_felt_by_bodies(mj, link.members), axis=0))
    across = [
        Neighbour(felt_solids(mj, other), poses, bool(np.isin(felt_geoms(mj, other.members), felt).any()))
        for other, poses in neighbour_poses(mj, link)
    ]
    at_home = home_neighbours(mj, link, home_qpos, size.foam_m)
    return across + [Neighbour(felt_solids(mj, other), poses, True) for other, poses in at_home]


def cover_ground(
    of: LinkGround, fixed_position_m: Floats, R_fixed: Floats, max_cells: int | None
) -> LinkCovering:
    """Cover a link with the best of several lattices; ports are turned so that few components remain.

    Args:
        of: Surface to cover.
        fixed_position_m: (f, 3) cells that the link has already, frame of its body [m].
        R_fixed: (f, 3, 3) their rotations.
        max_cells: Greatest number of cells; no limit for None.
    """
    starts = _starts(of)
    cell_pitch_m = pitch_of_side_m(of.limits.side_m)
    best, most = (np.zeros((0, 3)), np.zeros((0, 3, 3))), -math.inf
    for seed, x_axis in starts:
        cells = grow_lattice(of.ground, of.limits, seed, x_axis, fixed_position_m, R_fixed, max_cells)
        _, components, wires = best_turns(*cells, cell_pitch_m)
        score = len(cells[0]) - _COMPONENT_COST * components + _WIRE_GAIN * wires
        if score > most + 1e-9:
            best, most = cells, score
    if max_cells is None and len(best[0]):
        best = improve_lattice(of.ground, of.limits, best, fixed_position_m, R_fixed, _ROUNDS)
        best = shift_cells(of.ground, of.limits, best, fixed_position_m, R_fixed)
    clear = _clear_cells(of, *best)
    best = best[0][clear], np.ascontiguousarray(best[1][clear])
    turns, _, _ = best_turns(*best, cell_pitch_m)
    return LinkCovering(of, best[0], turned(best[1], turns))


def _clear_cells(of: LinkGround, position_m: Floats, R_body_cell: Floats) -> Bools:
    """Cells (n,) into whose foam no link reaches, at many more points than growth looks at.

    Growth asks for clearance where the surface was sampled; a cell at an edge juts out beyond it.
    """
    points = np.concatenate([hexagon_grid(rings)[0] for rings in _RINGS])
    points.flags.writeable = False  # as the points of growth, so that nothing is compiled twice
    heights_m, clear = np.zeros(len(points)), np.ones(len(position_m), dtype=np.bool_)
    for i, R in enumerate(R_body_cell):
        heights_under_cell(
            of.ground.solids,
            position_m[i],
            R,
            points,
            of.limits.side_m,
            of.limits.foam_m,
            of.limits.pitch_m,
            heights_m,
        )
        top_m = peak_m(
            of.ground.solids, position_m[i], R, points, heights_m, of.limits.side_m, of.limits.foam_m
        )
        clear[i] = top_m <= _INTRUSION_FRACTION * of.limits.pitch_m
    return clear


def largest_side_m(
    mj: Model, link: Link, body: str, cover: CoverSpec, size: CellSize, home_qpos: Floats
) -> float | None:
    """Largest side [m] of a smaller cell of which the link takes one, in steps of 15 %; None without one."""
    side_m = size.side_m
    for _ in range(12):
        side_m *= _SMALLER
        smaller = CellSize(side_m, pitch_of_side_m(side_m), size.foam_m)
        of = prepare_ground(mj, link, body, cover, smaller, home_qpos)
        if not of.ground.asked.any():
            continue
        seed, x_axis = _starts(of)[0]
        if len(grow_lattice(of.ground, of.limits, seed, x_axis, np.zeros((0, 3)), np.zeros((0, 3, 3)), 1)[0]):
            return side_m
    return None


def _region_geoms(mj: Model, solids: FeltSolids, body: str, cover: CoverSpec) -> list[int]:
    if cover.region is None or not cover.region.geoms:
        return []
    known = geom_names(mj, solids.geom_id.tolist())
    found = [known[name] for name in cover.region.geoms if name in known]
    if not found and isinstance(cover.body, str):
        name = cover.region.geoms[0]
        hint = known_names(name, known) if known else "none of its felt geoms has a name"
        raise DeploymentError(f'cover.{cover.name}.region.geoms: "{body}" has no felt geom "{name}"; {hint}')
    return found


def _longest_axis(solids: FeltSolids, samples: SurfaceSamples) -> Floats:
    """Axis of the largest solid if it is long and primitive, else the longest axis of the body's frame."""
    if not len(samples.point_m):
        return np.array([0.0, 0.0, 1.0])
    areas_m2 = np.bincount(samples.solid, samples.area_m2, minlength=len(solids.kind))
    largest = int(np.argmax(np.round(areas_m2, 6)))
    if solids.hull[largest] < 0:
        extent_m = np.ptp(
            np.stack(
                [
                    (samples.point_m[samples.solid == largest] * column).sum(axis=1)
                    for column in solids.R_body_solid[largest].T
                ],
                axis=1,
            ),
            axis=0,
        )
        return np.ascontiguousarray(solids.R_body_solid[largest][:, int(np.argmax(np.round(extent_m, 3)))])
    extent_m = np.ptp(samples.point_m, axis=0)
    axis = np.zeros(3)
    axis[int(np.argmax(np.round(extent_m, 3)))] = 1.0
    return axis


def _starts(of: LinkGround) -> list[tuple[int, Floats]]:
    """Seeds of lattices with the directions of their rows: seeds far from edges and from each other."""
    samples, asked = of.ground.samples, np.flatnonzero(of.ground.asked)
    if not len(asked):
        return []
    edge = ~of.ground.asked | creases(samples)
    if edge.all():
        edge = ~of.ground.asked
    room_m = np.full(len(asked), 1.0)
    if edge.any():
        room_m = np.minimum(cKDTree(samples.point_m[edge]).query(samples.point_m[asked])[0], 1.0)
    n_cells = of.asked_m2 / (0.5 * math.sqrt(3.0) * of.limits.pitch_m * of.limits.pitch_m)
    starts = []
    for _ in range(_SEEDS if n_cells > _FEW_CELLS else _SEEDS_OF_FEW):
        seed = int(asked[np.argmax(np.round(room_m, 6))])
        starts += [(seed, row_axis(samples.normal[seed], of.axis, angle_deg)) for angle_deg in _ANGLES_DEG]
        off = samples.point_m[asked] - samples.point_m[seed]
        room_m = np.minimum(room_m, np.sqrt((off * off).sum(axis=1)))
    return starts


def row_axis(normal: Floats, axis: Floats, angle_deg: float) -> Floats:
    """Direction (3,) at an angle to the axis of the link in the plane across `normal`."""
    for along in (axis, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        across = along - normal * (along * normal).sum()
        length = math.sqrt(float((across * across).sum()))
        if length > 0.3:
            break
    across = across / length
    angle = math.radians(angle_deg)
    direction: Floats = pinned_math.cos(angle) * across + pinned_math.sin(angle) * np.cross(normal, across)
    return direction
