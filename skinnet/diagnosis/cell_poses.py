"""Findings on where cells lie: off the surface of their link, buried in it, or through one another."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet.body.simulation import BodySimulation
from skinnet.covering.cell_heights import heights_under_cell
from skinnet.covering.covering_metrics import INTRUSION_M, PIERCING_M, PLATE_M
from skinnet.covering.felt_solids import FeltSolids, felt_solids, link_of_body, relative_pose
from skinnet.covering.hexagons import hexagon_grid, piercing_m
from skinnet.covering.surface_samples import sample_surface
from skinnet.deployment import Deployment
from skinnet.diagnosis.finding import Finding
from skinnet.skin.lattice import pitch_m

__all__ = ["cell_pose_findings", "patches_by_link"]

Floats = NDArray[np.float64]

_MAX_GAP_M = 0.006
"""Gap [m] up to which flat cells bridge the unevenness of a link: that of `skinnet cover`."""
_BURIED_SHARE = 0.5
_INTRUDED_SHARE = 0.1
_DEPTH_M = 0.05
"""Depth [m] below a cell down to which its surface is looked for along the normal."""
_SAMPLE_SPACING_M = 0.01
_HEXAGON, _WEIGHTS = hexagon_grid(3)
_CENTRE = np.zeros((1, 2))
_MM_PER_M = 1e3


class _Group(NamedTuple):
    """Cells of a patch, or elements of a sheet, on one body.

    Attributes:
        name: Name of the patch or sheet.
        body_id: Body that carries them.
        position_m: (n, 3) centres, frame of the body [m].
        R_body_cell: (n, 3, 3) axes.
        points: (p, 2) points of each at which the surface is looked for, in units of `side_m`.
        weights: (p,) shares of the points in the area of each.
    """

    name: str
    body_id: int
    position_m: Floats
    R_body_cell: Floats
    points: Floats
    weights: Floats

    def cell_names(self, rows: Iterable[int]) -> tuple[str, ...]:
        return tuple(f"{self.name}/{row}" for row in rows)


def cell_pose_findings(deployment: Deployment, body: BodySimulation) -> list[Finding]:
    """Findings on the poses of cells and elements, against the felt solids of their links."""
    mj = body.model.mj
    findings: list[Finding] = []
    links: dict[int, FeltSolids] = {}
    for group in _groups(body):
        if group.body_id not in links:
            links[group.body_id] = felt_solids(mj, link_of_body(mj, group.body_id))
        solids = links[group.body_id]
        if len(solids.kind):
            findings += _on_surface(deployment, mj.body(group.body_id).name, solids, group)
    return [*findings, *_piercing(deployment, body)]


def _groups(body: BodySimulation) -> Iterator[_Group]:
    surface = body.surface
    for patch, body_id in zip(body.patches, surface.patch_body_id.tolist(), strict=True):
        yield _Group(patch.name, body_id, patch.position_m, patch.R_body_cell, _HEXAGON, _WEIGHTS)
    for sheet in body.sheets:
        body_id = int(body.model.mj.body(sheet.surface.body).id)
        yield _Group(sheet.name, body_id, sheet.position_m, sheet.R_body_element, _CENTRE, np.ones(1))


def _on_surface(deployment: Deployment, link: str, solids: FeltSolids, group: _Group) -> Iterator[Finding]:
    """Cells of one group off the surface of `link`, buried in it, or with a part of it in their foam."""
    side_m, foam_m = deployment.cells.side_m, deployment.body.foam.thickness_m
    heights_m = np.zeros((len(group.position_m), len(group.points)))
    for row, (place_m, R) in enumerate(zip(group.position_m, group.R_body_cell, strict=True)):
        heights_under_cell(
            solids, place_m, np.ascontiguousarray(R), group.points, side_m, foam_m, _DEPTH_M, heights_m[row]
        )
    gap_m = -heights_m.max(axis=1)
    lost = np.flatnonzero(np.isinf(gap_m))
    if len(lost):
        gap_m[lost] = cKDTree(sample_surface(solids, _SAMPLE_SPACING_M).point_m).query(
            group.position_m[lost]
        )[0]
    is_off = np.isinf(heights_m).all(axis=1) | (gap_m > _MAX_GAP_M)
    share = ((heights_m > INTRUSION_M) * group.weights).sum(axis=1)
    buried = share >= _BURIED_SHARE
    intruded = (share >= _INTRUDED_SHARE) & ~buried
    subject = f"patch {group.name}"
    if is_off.any():
        far = gap_m > pitch_m(side_m)
        worst = int(np.where(is_off, gap_m, -math.inf).argmax())
        yield Finding(
            "error" if (far & is_off).any() else "warning",
            "cells_off_surface",
            subject,
            f'{int(is_off.sum())} of {len(gap_m)} cells lie off the felt surface of "{link}", the worst, '
            f"cell {worst}, by {_length(float(gap_m[worst]))}",
            "positions are in metres, frame of the body: move the cells, or cover the link by [[cover]]",
            group.cell_names(np.flatnonzero(is_off).tolist()),
        )
    if buried.any():
        depth_m = np.where(buried, heights_m[:, len(group.points) // 2], 0.0)
        deep = depth_m >= foam_m * (1.0 - 1e-9)
        yield Finding(
            "error" if deep.any() else "warning",
            "cells_buried",
            subject,
            f'{int(buried.sum())} of {len(gap_m)} cells are buried in "{link}"'
            + (f", {int(deep.sum())} of them with their faces" if deep.any() else ""),
            "move the cells out to the felt surface, with normals outwards, or cover the link by [[cover]]",
            group.cell_names(np.flatnonzero(buried).tolist()),
        )
    if intruded.any():
        yield Finding(
            "remark",
            "cells_intruded",
            subject,
            f'a part of "{link}" reaches into the foam of {int(intruded.sum())} of {len(gap_m)} cells, over '
            f"at most {100.0 * float(share[intruded].max()):.0f} % of one: nothing can touch it there",
            "move the cells aside, or leave it",
            group.cell_names(np.flatnonzero(intruded).tolist()),
        )


def _length(length_m: float) -> str:
    return f"{length_m:.3g} m" if length_m >= 1.0 else f"{_MM_PER_M * length_m:.0f} mm"


def patches_by_link(body: BodySimulation) -> dict[tuple[int, ...], list[int]]:
    """Indices of the patches on each link, by the bodies that the link has."""
    links: dict[tuple[int, ...], list[int]] = {}
    for index, body_id in enumerate(body.surface.patch_body_id.tolist()):
        links.setdefault(link_of_body(body.model.mj, body_id).members, []).append(index)
    return links


def _piercing(deployment: Deployment, body: BodySimulation) -> Iterator[Finding]:
    """Pairs of cells on one link whose plates go through each other."""
    mj, side_m = body.model.mj, deployment.cells.side_m
    for patches in patches_by_link(body).values():
        frame = int(body.surface.patch_body_id[patches[0]])
        names, position_m, R = _in_one_frame(body, frame, patches)
        pairs = []
        for a, b in sorted(cKDTree(position_m).query_pairs(2.0 * side_m + PLATE_M)):
            x, y, z = (position_m[b] - position_m[a]).tolist()
            depth_m = piercing_m(R[a], R[b], x, y, z, side_m, PLATE_M)
            if depth_m > PIERCING_M:
                pairs.append((depth_m, a, b))
        if pairs:
            depth_m, a, b = max(pairs)
            cells = sorted({row for _, *pair in pairs for row in pair})
            yield Finding(
                "warning",
                "cells_overlap",
                f'link "{mj.body(frame).name}"',
                f"{len(pairs)} pair{'s' if len(pairs) > 1 else ''} of cells in each other, the worst, "
                f"{names[a]} and {names[b]}, by {_MM_PER_M * depth_m:.1f} mm",
                f"keep cells {_MM_PER_M * pitch_m(side_m):.1f} mm apart and tilt them less, or leave one out",
                tuple(names[row] for row in cells),
            )


def _in_one_frame(body: BodySimulation, frame: int, patches: list[int]) -> tuple[list[str], Floats, Floats]:
    """Names, positions (n, 3) [m] and axes (n, 3, 3) of the cells of some patches in the frame of a body."""
    names: list[str] = []
    positions, rotations = [], []
    for index in patches:
        patch, body_id = body.patches[index], int(body.surface.patch_body_id[index])
        R, t_m = relative_pose(body.model.mj, frame, body_id)
        names += [f"{patch.name}/{row}" for row in range(patch.n_cells)]
        positions.append(np.einsum("ij,nj->ni", R, patch.position_m) + t_m)
        rotations.append(np.einsum("ij,njk->nik", R, patch.R_body_cell))
    return names, np.concatenate(positions), np.ascontiguousarray(np.concatenate(rotations))
