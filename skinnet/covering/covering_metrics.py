"""Metrics of a covering, from the cells as they will be placed: coverage, faults, gap, wiring."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet.covering.cell_fit import heights_under_cell
from skinnet.covering.cell_settling import Ground
from skinnet.covering.hexagons import hexagon_grid, piercing_m
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.skin.lattice import pitch_m
from skinnet.skin.placement import place_patch

__all__ = ["covering_metrics", "network_metrics"]

Floats = NDArray[np.float64]

_RINGS = 5
_OVERLAP_FRACTION, _WIRE_FRACTION, _COVERED_FRACTION = 0.9, 1.15, 0.6
_BACK_TO_BACK_COSINE, _SAME_SIDE_COSINE = math.cos(math.radians(170.0)), -0.5
_PIERCING_M = _INTRUSION_M = 1e-3
_PLATE_M = 0.002
_DEPTH_M = 0.010
_MM_PER_M = 1e3


def covering_metrics(
    ground: Ground, position_m: Floats, R_body_cell: Floats, n_wires: int, side_m: float, foam_m: float
) -> dict[str, Any]:
    """Metrics of the cells (n) of one link.

    `within_0_6_pitch` is the share of the asked surface that lies within 0.6 pitch of the centre of a cell
    whose normal is within 120°; `filled` the area of cells over that of the asked surface; `overlaps` counts
    pairs of centres closer than 0.9 pitch that are not back to back; `piercing` pairs of plates of 2 mm that
    overlap by more than 1 mm; `buried` cells into whose foam the link reaches by more than 1 mm, at 91 points
    of each; `gap_mm_p95` is the 95th percentile over cells of the mean gap between cell and surface; `wired`
    the share of neighbours that are wired.
    """
    pitch = pitch_m(side_m)
    samples, asked = ground.samples, ground.asked
    pairs = np.array(
        sorted(cKDTree(position_m).query_pairs(2.0 * side_m + _PLATE_M)), dtype=np.int64
    ).reshape(-1, 2)
    a, b = pairs[:, 0], pairs[:, 1]
    off_m = np.sqrt(((position_m[a] - position_m[b]) ** 2).sum(axis=1))
    alike = (R_body_cell[a, :, 2] * R_body_cell[b, :, 2]).sum(axis=1)
    neighbours = int(((off_m <= _WIRE_FRACTION * pitch) & (alike >= _SAME_SIDE_COSINE)).sum())
    pierced_m = [
        _piercing_m(R_body_cell[i], R_body_cell[j], position_m[j] - position_m[i], side_m)
        for i, j in pairs.tolist()
    ]
    points, weights = hexagon_grid(_RINGS)
    heights_m, gaps_m, buried = np.zeros(len(points)), [], 0
    for place_m, R in zip(position_m, R_body_cell, strict=True):
        heights_under_cell(
            ground.solids, place_m, np.ascontiguousarray(R), points, side_m, foam_m, pitch, heights_m
        )
        buried += bool(heights_m.max() > _INTRUSION_M)
        held = heights_m >= -_DEPTH_M
        gaps_m.append(-float((weights[held] * heights_m[held]).sum() / max(weights[held].sum(), 1e-9)))
    asked_m2 = float(samples.area_m2[asked].sum())
    return {
        "cells": len(position_m),
        "asked_m2": round(asked_m2, 6),
        "within_0_6_pitch": round(_covered_m2(ground, position_m, R_body_cell, pitch) / asked_m2, 4),
        "filled": round(len(position_m) * 1.5 * math.sqrt(3.0) * side_m**2 / asked_m2, 4),
        "overlaps": int(((off_m < _OVERLAP_FRACTION * pitch) & (alike > _BACK_TO_BACK_COSINE)).sum()),
        "piercing": sum(depth_m > _PIERCING_M for depth_m in pierced_m),
        "buried": buried,
        "gap_mm_p95": round(_MM_PER_M * float(np.percentile(gaps_m, 95)), 2),
        "wired": round(n_wires / max(neighbours, 1), 4),
    }


def network_metrics(
    own: Sequence[str], patches: Sequence[PatchSpec], bridges: Sequence[BridgeSpec], cells: CellSpec
) -> dict[str, Any]:
    """Metrics of the network of one link, whose patches are named `own`.

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
    mine = [f"{name}/{cell}" for name in own for cell in range(placed[name].n_cells)]
    gateways = [f"{patch.name}/{cell}" for patch in placed.values() for cell, _ in patch.interfaces.tolist()]
    groups, seen = 0, set[str]()
    for cell in mine:
        if cell not in seen:
            groups += 1
            seen |= _reached_from([cell], wires)
    reached = _reached_from(gateways, wires)
    return {
        "bridges": sum(bridge.a.rpartition("/")[0] in own for bridge in bridges),
        "groups": groups,
        "gateways": sum(len(placed[name].interfaces) for name in own),
        "unreached": sum(cell not in reached for cell in mine),
    }


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


def _piercing_m(R: Floats, R_other: Floats, offset_m: Floats, side_m: float) -> float:
    x, y, z = offset_m.tolist()
    return piercing_m(R, R_other, x, y, z, side_m, _PLATE_M)


def _covered_m2(ground: Ground, position_m: Floats, R_body_cell: Floats, pitch: float) -> float:
    """Area [m²] of asked surface within 0.6 pitch of a cell on its side."""
    samples = ground.samples
    covered = np.zeros(len(samples.point_m), dtype=np.bool_)
    tree = cKDTree(samples.point_m)
    for place_m, R in zip(position_m, R_body_cell, strict=True):
        near = np.array(sorted(tree.query_ball_point(place_m, _COVERED_FRACTION * pitch)), dtype=np.int64)
        covered[near] |= (samples.normal[near] * R[:, 2]).sum(axis=1) > _SAME_SIDE_COSINE
    return float(samples.area_m2[covered & ground.asked].sum())
