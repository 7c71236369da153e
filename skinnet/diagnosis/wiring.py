"""Findings on the wiring of cells: those that no gateway reaches."""

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment import Deployment
from skinnet.diagnosis.finding import Finding
from skinnet.graph_components import connected_components
from skinnet.skin.placement import place_patch, resolve_bridges
from skinnet.skin.whole_skin import WholeSkin, join_patches

__all__ = ["wiring_findings"]


def wiring_findings(deployment: Deployment) -> list[Finding]:
    """Findings on cells without a path over wires and bridges to a gateway; a run refuses them."""
    if not deployment.patches:
        return []
    placed = tuple(place_patch(patch, deployment.cells) for patch in deployment.patches)
    skin = join_patches(placed, resolve_bridges(deployment.bridges, placed))
    cut_off = np.flatnonzero(~_reached(skin))
    findings = []
    for index in dict.fromkeys(skin.patch_of_cell[cut_off].tolist()):
        cells = cut_off[skin.patch_of_cell[cut_off] == index].tolist()
        patch = skin.patches[index]
        findings.append(
            Finding(
                "error",
                "cells_unreached",
                f"patch {patch.name}",
                f"no path of wires leads from {len(cells)} of {patch.n_cells} cells to a gateway",
                "wire an interface or a bridge to one of them, or turn cells so that ports face each other",
                tuple(skin.cell_name(cell) for cell in cells),
            )
        )
    return findings


def _reached(skin: WholeSkin) -> NDArray[np.bool_]:
    """Cells (n,) with a path to a gateway."""
    group = connected_components(skin.n_cells, skin.wires[:, 0], skin.wires[:, 2])
    return np.isin(group, group[skin.gateways[:, 0]])
