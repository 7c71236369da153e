"""Tactile sheets of one link: as many as find a place beside each other and beside its cells."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from msgspec import structs
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet.covering.covering_patches import patch_name
from skinnet.covering.felt_solids import Link, Model
from skinnet.covering.link_covering import CellSize, LinkGround, prepare_ground
from skinnet.covering.sheet_fit import SheetPose, fit_sheet, sheet_poses
from skinnet.deployment.skin.covers import CoverSpec
from skinnet.deployment.skin.sheets import MAX_SIDE
from skinnet.pinned_linalg import norm
from skinnet.skin.lattice import pitch_m as pitch_of_side_m
from skinnet.skin.tactile_sheets import build_surface

__all__ = ["element_size", "largest_sheet_pitch_m", "lay_sheets"]

Floats = NDArray[np.float64]

_APART_FRACTION = 0.95
"""Least distance of elements of different sheets on one side, as a fraction of the pitch."""
_SMALLER, _STEPS = 0.85, 10
"""Step of the search for a sheet that fits, as a ratio of pitches, and the number of steps."""


def element_size(pitch_m: float, foam_m: float) -> CellSize:
    """Size of the elements of a sheet: that of a hexagon in each square."""
    return CellSize(0.5 * pitch_m, pitch_m, foam_m, samples_per_pitch=4.0)


def lay_sheets(
    of: LinkGround,
    pitch_m: float,
    cell_position_m: Floats,
    cell_normal: Floats,
    cell_side_m: float,
    name: str,
) -> list[SheetPose]:
    """Lay sheets on a link, first where the gap under one is least, then edge to edge, else near to others.

    Args:
        of: Surface to cover.
        pitch_m: Pitch of the elements [m].
        cell_position_m: (n, 3) cells and elements that the link has already, frame of its body [m].
        cell_normal: (n, 3) their normals.
        cell_side_m: Side of the cells [m].
        name: Name of the sheets, with a number if there are several.
    """
    reach_m = max(_APART_FRACTION * pitch_m, 0.5 * pitch_m + 0.5 * pitch_of_side_m(cell_side_m))
    free = [
        pose for pose in sheet_poses(of, pitch_m) if not _meets(pose, cell_position_m, cell_normal, reach_m)
    ]
    laid: list[SheetPose] = []
    beside: list[SheetPose] = []
    while beside or free:
        ahead = beside or free
        best = ahead[_first(ahead, laid)]
        laid.append(best)
        new = [
            pose
            for pose in _edge_to_edge(of, pitch_m, best)
            if not _meets(pose, cell_position_m, cell_normal, reach_m)
            and not any(_overlap(pose, other, pitch_m) for other in laid)
        ]
        beside, free = (
            [pose for pose in poses if not _overlap(pose, best, pitch_m)] for poses in (beside, free)
        )
        beside += new
    return [
        replace(pose, surface=structs.replace(pose.surface, name=_numbered(name, number, len(laid))))
        for number, pose in enumerate(laid)
    ]


def _numbered(name: str, number: int, count: int) -> str:
    return patch_name(name, str(number) if count > 1 else "")


def largest_sheet_pitch_m(
    mj: Model, link: Link, body: str, cover: CoverSpec, size: CellSize, home_qpos: Floats
) -> float | None:
    """Largest pitch [m] below that of `size` at which a sheet fits, in steps of 15 %; None without one."""
    pitch_m = size.pitch_m
    for _ in range(_STEPS):
        pitch_m *= _SMALLER
        of = prepare_ground(mj, link, body, cover, element_size(pitch_m, size.foam_m), home_qpos)
        if next(sheet_poses(of, pitch_m), None) is not None:
            return pitch_m
    return None


def _first(ahead: list[SheetPose], laid: list[SheetPose]) -> int:
    """Pose nearest to those `laid`, to 0.1 mm; of equals that with the least gap."""
    off_m: Floats = np.zeros(len(ahead))
    if laid:
        middles_m = np.array([pose.middle_m for pose in laid])
        off_m = np.asarray(cKDTree(middles_m).query(np.array([pose.middle_m for pose in ahead]))[0])
    gap_m = np.array([pose.gap_m for pose in ahead])
    return int(np.lexsort((np.round(gap_m, 6), np.round(off_m, 4)))[0])


def _edge_to_edge(of: LinkGround, pitch_m: float, pose: SheetPose) -> Iterator[SheetPose]:
    """Sheets on the same flat or bent surface, next to the four edges of one."""
    surface, width_m = build_surface(pose.surface), MAX_SIDE * pitch_m
    for xi_m in ((0.0, width_m), (0.0, -width_m), (width_m, 0.0), (-width_m, 0.0)):
        point_m, R = surface.frame_at(xi_m)
        found = fit_sheet(of, pitch_m, point_m, R[:, 2], R[:, 1], pose.surface.radius_m)
        if found is not None:
            yield found


def _overlap(one: SheetPose, other: SheetPose, pitch_m: float) -> bool:
    if norm(one.middle_m - other.middle_m) > 1.5 * MAX_SIDE * pitch_m:  # more than the diagonal of a sheet
        return False
    normal = other.R_body_element[:, :, 2]
    return _meets(one, other.position_m, normal, _APART_FRACTION * pitch_m)


def _meets(pose: SheetPose, position_m: Floats, normal: Floats, reach_m: float) -> bool:
    """True if an element is within `reach_m` [m] of a place (n, 3) on its side."""
    off_m = pose.position_m[:, None] - position_m
    near = (off_m * off_m).sum(axis=2) < reach_m * reach_m
    alike = (pose.R_body_element[:, None, :, 2] * normal).sum(axis=2)
    return bool((near & (alike > 0.0)).any())
