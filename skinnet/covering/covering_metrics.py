"""Metrics of a covering, from the cells as they will be placed: coverage, faults, gaps, wiring.

They share no geometry with the placer of cells (`skinnet.covering.measuring_model`), but what is asked for.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet import pinned_math
from skinnet.covering.cell_limits import CellLimits
from skinnet.covering.felt_solids import Model
from skinnet.covering.hexagons import hexagon_grid
from skinnet.covering.link_covering import LinkGround
from skinnet.covering.link_thickness import thickness_m
from skinnet.covering.measuring_model import MeasuringModel, plate_overlap_m
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.skin.lattice import pitch_m
from skinnet.skin.placement import place_patch

__all__ = [
    "INTRUSION_M",
    "PIERCING_M",
    "PLATE_M",
    "CellFigures",
    "cell_figures",
    "covered_share_of_thick",
    "covering_metrics",
    "element_figures",
    "network_metrics",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_OVERLAP_FRACTION, _WIRE_FRACTION, _COVERED_FRACTION = 0.9, 1.15, 0.6
_BACK_TO_BACK_COSINE, _SAME_SIDE_COSINE = pinned_math.cos(math.radians(170.0)), -0.5
INTRUSION_M = PIERCING_M = 1e-3
"""Overlap [m] of a cell with its link, and of two plates, below which they just touch."""
PLATE_M = 0.002
"""Thickness [m] of the rigid plate of a cell, which may not pierce another."""
_DEPTH_M = 0.010
_THICK_M, _ROUNDING_M = 0.050, 1e-6
_SAMPLES_PER_CELL, _LEAST_ASKED, _MOST_SAMPLES = 12.0, 300, 3000
"""Samples for the area of each cell, the least number in what is asked for, and the greatest."""
_TRIED_SAMPLES, _TRIED_ABOUT = 60, 6
"""Number of places of a link at which the metrics try whether a cell fits, and of places about each."""
_NEAREST = 6
_MM_PER_M = 1e3


@dataclass(frozen=True)
class CellFigures:
    """Figures of the cells (n) of one link, and of the surface asked for.

    Attributes:
        cell_m2: Area of a cell [m²].
        thickness_m: Thickness of the link [m].
        asked_m2: Area asked for [m²].
        covered_m2: Area of it within 0.6 pitch of the centre of a cell whose normal is within 120°.
        fit_m2: Area of it where a cell would fit.
        pairs: Pairs of cells closer than 1.15 pitch that face within 120° of each other.
        overlaps: Pairs of centres closer than 0.9 pitch that are not back to back.
        piercing: Pairs of plates of 2 mm that penetrate each other by more than 1 mm.
        buried: Cells into whose foam the link reaches by more than 1 mm.
        gap_m: (n,) mean distances [m] of cells from the felt surface under them, where it is within 10 mm.
        visual_gap_m: (n,) the same from the surface as drawn, not signed; one pitch where there is none.
    """

    cell_m2: float
    thickness_m: float
    asked_m2: float
    covered_m2: float
    fit_m2: float
    pairs: int
    overlaps: int
    piercing: int
    buried: int
    gap_m: Floats
    visual_gap_m: Floats


def cell_figures(
    mj: Model, of: LinkGround, position_m: Floats, R_body_cell: Floats, side_m: float, foam_m: float
) -> CellFigures:
    """Figures of cells at positions (n, 3) [m] with axes (n, 3, 3) on a link, frame of its body."""
    cell_m2 = 1.5 * math.sqrt(3.0) * side_m * side_m
    return _figures(mj, of, position_m, R_body_cell, side_m, foam_m, pitch_m(side_m), cell_m2)


def element_figures(
    mj: Model, of: LinkGround, position_m: Floats, R_body_element: Floats, pitch: float, foam_m: float
) -> CellFigures:
    """Figures of elements of tactile sheets, without wires: each a hexagon in its square of `pitch` [m]."""
    found = _figures(mj, of, position_m, R_body_element, 0.5 * pitch, foam_m, pitch, pitch * pitch)
    return replace(found, pairs=0)


def _figures(
    mj: Model,
    of: LinkGround,
    position_m: Floats,
    R_body_cell: Floats,
    side_m: float,
    foam_m: float,
    pitch: float,
    cell_m2: float,
) -> CellFigures:
    measured = MeasuringModel(mj, of.link, side_m, INTRUSION_M, foam_m)
    pairs = np.array(sorted(cKDTree(position_m).query_pairs(2.0 * side_m + PLATE_M)), dtype=np.int64).reshape(
        -1, 2
    )
    a, b = pairs[:, 0], pairs[:, 1]
    off_m = np.linalg.norm(position_m[a] - position_m[b], axis=1)
    alike = (R_body_cell[a, :, 2] * R_body_cell[b, :, 2]).sum(axis=1)
    pierced_m = plate_overlap_m(position_m, R_body_cell, pairs, side_m, PLATE_M)
    gaps_m = [
        _gaps_m(measured, p, R, side_m, foam_m, pitch) for p, R in zip(position_m, R_body_cell, strict=True)
    ]
    point_m, normal, area_m2 = measured.surface_points(_sample_count(of, pitch))
    asked = _asked(of, point_m, normal)
    each_m2 = area_m2 / len(point_m)
    point_m, normal = point_m[asked], normal[asked]
    return CellFigures(
        cell_m2=cell_m2,
        thickness_m=thickness_m(of.ground.solids, of.ground.samples),
        asked_m2=each_m2 * len(point_m),
        covered_m2=each_m2 * int(_near_cells(point_m, normal, position_m, R_body_cell, pitch).sum()),
        fit_m2=each_m2 * len(point_m) * _share_that_fits(measured, of.limits, point_m, normal),
        pairs=int(((off_m <= _WIRE_FRACTION * pitch) & (alike >= _SAME_SIDE_COSINE)).sum()),
        overlaps=int(((off_m < _OVERLAP_FRACTION * pitch) & (alike > _BACK_TO_BACK_COSINE)).sum()),
        piercing=int((pierced_m > PIERCING_M).sum()),
        buried=sum(measured.is_buried(p, R) for p, R in zip(position_m, R_body_cell, strict=True)),
        gap_m=np.array([gap_m for gap_m, _ in gaps_m]),
        visual_gap_m=np.array([gap_m for _, gap_m in gaps_m]),
    )


def covering_metrics(figures: Sequence[CellFigures], n_wires: int) -> dict[str, Any]:
    """Metrics of one or several links with `n_wires` wires: sums, shares of sums, percentiles of all cells.

    `within_0_6_pitch` is the covered share of the asked area; `filled` the area of the cells over that of the
    surface where a cell fits; `wired` the share of neighbours that are wired; `thickness_mm` the least.
    """
    asked_m2 = sum(link.asked_m2 for link in figures)
    cells_m2 = sum(link.cell_m2 * len(link.gap_m) for link in figures)
    return {
        "cells": sum(len(link.gap_m) for link in figures),
        "thickness_mm": round(_MM_PER_M * min(link.thickness_m for link in figures), 2),
        "asked_m2": round(asked_m2, 6),
        "within_0_6_pitch": _covered_share(figures),
        "filled": round(cells_m2 / max(sum(link.fit_m2 for link in figures), 1e-12), 4),
        "overlaps": sum(link.overlaps for link in figures),
        "piercing": sum(link.piercing for link in figures),
        "buried": sum(link.buried for link in figures),
        "gap_mm_p95": _percentile_mm([link.gap_m for link in figures]),
        "visual_gap_mm_p95": _percentile_mm([link.visual_gap_m for link in figures]),
        "wired": round(n_wires / max(sum(link.pairs for link in figures), 1), 4),
    }


def covered_share_of_thick(figures: Sequence[CellFigures]) -> float | None:
    """Share of the asked area of links at least 50 mm thick that is within 0.6 pitch; None without one."""
    thick = [link for link in figures if link.thickness_m >= _THICK_M - _ROUNDING_M]
    return _covered_share(thick) if thick else None


def _covered_share(figures: Sequence[CellFigures]) -> float:
    asked_m2 = sum(link.asked_m2 for link in figures)
    return round(sum(link.covered_m2 for link in figures) / max(asked_m2, 1e-12), 4)


def network_metrics(
    links: Sequence[Sequence[str]],
    patches: Sequence[PatchSpec],
    bridges: Sequence[BridgeSpec],
    cells: CellSpec,
) -> list[dict[str, Any]]:
    """Metrics of the network of each of `links`, which are given by the names of their patches.

    `groups` counts parts that no wire and no bridge joins, also over patches of the same link in other
    covers; `gateways` interfaces; `unreached` cells without a path to one.
    """
    placed = {patch.name: place_patch(patch, cells) for patch in patches}
    wires: dict[str, set[str]] = {}
    for patch in placed.values():
        for a, _, b, _ in patch.wires.tolist():
            _join(wires, f"{patch.name}/{a}", f"{patch.name}/{b}")
    for bridge in bridges:
        _join(wires, bridge.a.partition(":")[0], bridge.b.partition(":")[0])
    gateways = [f"{patch.name}/{cell}" for patch in placed.values() for cell, _ in patch.interfaces.tolist()]
    reached = _reached_from(gateways, wires)
    found = []
    for own in links:
        mine = [f"{name}/{cell}" for name in own for cell in range(placed[name].n_cells)]
        groups, seen = 0, set[str]()
        for cell in mine:
            if cell not in seen:
                groups += 1
                seen |= _reached_from([cell], wires)
        found.append(
            {
                "bridges": sum(bridge.a.rpartition("/")[0] in own for bridge in bridges),
                "groups": groups,
                "gateways": sum(len(placed[name].interfaces) for name in own),
                "unreached": sum(cell not in reached for cell in mine),
            }
        )
    return found


def _join(wires: dict[str, set[str]], a: str, b: str) -> None:
    wires.setdefault(a, set()).add(b)
    wires.setdefault(b, set()).add(a)


def _reached_from(cells: Sequence[str], wires: dict[str, set[str]]) -> set[str]:
    """Cells that wires lead to from `cells`, with these."""
    reached, ahead = set(cells), list(cells)
    while ahead:
        new = wires.get(ahead.pop(), set()) - reached
        reached |= new
        ahead += new
    return reached


def _percentile_mm(gaps_m: Sequence[Floats]) -> float:
    return round(_MM_PER_M * float(np.percentile(np.concatenate(gaps_m), 95)), 2)


def _gaps_m(
    measured: MeasuringModel, position_m: Floats, R: Floats, side_m: float, foam_m: float, pitch: float
) -> tuple[float, float]:
    """Mean gaps [m] between a cell and the felt and the drawn surface, over what the felt one supports."""
    points, weights = hexagon_grid(2)
    at_m = position_m + side_m * (points[:, :1] * R[:, 0] + points[:, 1:] * R[:, 1])
    felt_m = -measured.felt_heights_m(at_m, R[:, 2], foam_m, pitch)
    held = felt_m <= _DEPTH_M
    if not held.any():
        return pitch, pitch
    weights = weights[held] / weights[held].sum()
    drawn_m = -measured.visual_heights_m(at_m[held], R[:, 2], pitch, pitch)
    return float((weights * felt_m[held]).sum()), float((weights * np.minimum(np.abs(drawn_m), pitch)).sum())


def _sample_count(of: LinkGround, pitch: float) -> int:
    whole_m2 = float(of.ground.samples.area_m2.sum())
    by_area = _SAMPLES_PER_CELL * whole_m2 / (0.5 * math.sqrt(3.0) * pitch * pitch)
    return int(min(max(by_area, _LEAST_ASKED * whole_m2 / of.asked_m2), _MOST_SAMPLES))


def _asked(of: LinkGround, point_m: Floats, normal: Floats) -> Bools:
    """Points (p,) in the surface asked for: where the nearest sample of it on their side is."""
    samples = of.ground.samples
    _, found = cKDTree(samples.point_m).query(point_m, min(_NEAREST, len(samples.point_m)))
    near = np.asarray(found, dtype=np.int64).reshape(len(point_m), -1)
    facing = (samples.normal[near] * normal[:, None]).sum(axis=2) > 0.0
    first = np.argmax(facing, axis=1)
    return np.asarray(of.ground.asked[near[np.arange(len(near)), first]])


def _near_cells(
    point_m: Floats, normal: Floats, position_m: Floats, R_body_cell: Floats, pitch: float
) -> Bools:
    """Points (p,) within 0.6 pitch of the centre of a cell on their side."""
    covered = np.zeros(len(point_m), dtype=np.bool_)
    if not len(point_m):
        return covered
    tree = cKDTree(point_m)
    for place_m, R in zip(position_m, R_body_cell, strict=True):
        near = np.array(sorted(tree.query_ball_point(place_m, _COVERED_FRACTION * pitch)), dtype=np.int64)
        covered[near] |= (normal[near] * R[:, 2]).sum(axis=1) > _SAME_SIDE_COSINE
    return covered


def _share_that_fits(measured: MeasuringModel, limits: CellLimits, point_m: Floats, normal: Floats) -> float:
    """Share of the asked surface that a cell over it, or at one of the places next to it, would cover."""
    if not len(point_m):
        return 0.0
    tree, tried = cKDTree(point_m), range(0, len(point_m), max(len(point_m) // _TRIED_SAMPLES, 1))
    count = 0
    for i in tried:
        near = np.array(sorted(tree.query_ball_point(point_m[i], 0.5 * limits.pitch_m)), dtype=np.int64)
        near = near[(normal[near] * normal[i]).sum(axis=1) > 0.0]
        mean = normal[near].sum(axis=0)
        near = near[:: max(len(near) // _TRIED_ABOUT, 1)]
        mean /= math.sqrt(float((mean * mean).sum()))
        places = [(i, normal[i]), (i, mean), *((j, normal[j]) for j in near), *((j, mean) for j in near)]
        count += any(_fits(measured, limits, point_m[j], n) for j, n in places)
    return count / len(tried)


def _fits(measured: MeasuringModel, limits: CellLimits, point_m: Floats, normal: Floats) -> bool:
    """True if a cell at `point_m` across `normal`, lifted until it rests on the surface, keeps the limits."""
    x = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    x /= math.sqrt(float((x * x).sum()))
    R = np.column_stack([x, np.cross(normal, x), normal])
    points, weights = hexagon_grid(2)
    at_m = point_m + limits.side_m * (points[:, :1] * R[:, 0] + points[:, 1:] * R[:, 1])
    heights_m = measured.felt_heights_m(at_m, normal, limits.foam_m, limits.pitch_m)
    lift_m = max(float(heights_m.max()) - limits.intrusion_m, 0.0)
    depth_m = lift_m - heights_m
    held = depth_m <= limits.depth_m
    return bool(
        lift_m <= limits.lift_m
        and weights[held].sum() >= limits.support
        and (weights[held] * depth_m[held]).sum() <= limits.gap_m * weights[held].sum()
        and not measured.is_buried(point_m + lift_m * normal, R)
    )
