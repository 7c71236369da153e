"""Findings on cells that lie on felt geometry, but far from what is drawn of their link."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.body.shown_geoms import felt_geoms, shown_geoms
from skinnet.body.simulation import BodySimulation
from skinnet.covering.felt_solids import SOLID_SHAPES
from skinnet.covering.measuring_model import surface_heights_m
from skinnet.deployment.deployment import Deployment
from skinnet.diagnosis.cell_poses import patches_by_link
from skinnet.diagnosis.finding import Finding
from skinnet.skin.lattice import pitch_m

__all__ = ["drawn_surface_findings"]

Floats = NDArray[np.float64]
_MM_PER_M = 1e3


def drawn_surface_findings(deployment: Deployment, body: BodySimulation) -> list[Finding]:
    """Findings on cells that lie further from the drawn surface than their foam is thick.

    Only links that are drawn by geoms of their own count: where the felt geoms are drawn, cells lie on these,
    and a mesh is compared with its convex hull (`skinnet.diagnosis.felt_geometry`).
    """
    mj = body.model.mj
    shown = shown_geoms(mj)
    unfelt = shown & ~felt_geoms(mj)
    findings: list[Finding] = []
    for members, rows in patches_by_link(body).items():
        of_link = np.isin(mj.geom_bodyid, members) & np.isin(mj.geom_type, list(SOLID_SHAPES))
        if (of_link & unfelt).any():
            drawn = np.flatnonzero(of_link & shown).tolist()
            findings += _far_cells(deployment, body, rows, drawn)
    return findings


def _far_cells(
    deployment: Deployment,
    body: BodySimulation,
    rows: Sequence[int],
    drawn: Sequence[int],
) -> Iterator[Finding]:
    """Finding on the cells of the patches `rows` of one link that lie far from its geoms `drawn`."""
    foam_m, reach_m = deployment.body.foam.thickness_m, 2.0 * pitch_m(deployment.cells.side_m)
    mj, data = body.model.mj, body.data
    far, worst_m, n_cells = [], 0.0, 0
    for row in rows:
        patch, body_id = body.patches[row], int(body.surface.patch_body_id[row])
        R = data.xmat[body_id].reshape(3, 3)
        n_cells += patch.n_cells
        for cell, (position_m, R_body_cell) in enumerate(
            zip(patch.position_m, patch.R_body_cell, strict=True)
        ):
            at_m = (R @ position_m + data.xpos[body_id])[None]
            normal = R @ R_body_cell[:, 2]
            gap_m = min(
                abs(float(surface_heights_m(mj, data, drawn, at_m, normal, foam_m, reach_m)[0])), reach_m
            )
            if gap_m > foam_m:
                far.append(f"{patch.name}/{cell}")
                worst_m = max(worst_m, gap_m)
    if far:
        name = mj.body(int(body.surface.patch_body_id[rows[0]])).name
        least = "at least " if worst_m >= reach_m else ""
        yield Finding(
            "warning",
            "cells_off_drawn",
            f'link "{name}"',
            f"{len(far)} of {n_cells} cells lie further from the drawn surface than their foam is thick, the "
            f"worst by {least}{_MM_PER_M * worst_m:.0f} mm: what is felt is coarser than what is seen",
            "give the link collision geoms that follow its drawn shape, or leave them out by a region",
            tuple(far),
        )
