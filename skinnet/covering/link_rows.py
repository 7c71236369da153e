"""Rows of metrics, one for each link that a cover has given patches or sheets."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from skinnet.covering.covering_metrics import CellFigures, cell_figures, covering_metrics, element_figures
from skinnet.covering.felt_solids import Model
from skinnet.covering.link_covering import LinkGround
from skinnet.covering.sheet_fit import SheetPose
from skinnet.skin.placement import PlacedPatch

__all__ = ["patch_row", "sheet_row"]


def patch_row(
    mj: Model, of: LinkGround, patches: Sequence[PlacedPatch], side_m: float, foam_m: float
) -> tuple[dict[str, Any], CellFigures]:
    """Metrics and figures of a link with patches."""
    n_wires = sum(len(patch.wires) for patch in patches)
    position_m = np.concatenate([patch.position_m for patch in patches])
    R = np.ascontiguousarray(np.concatenate([patch.R_body_cell for patch in patches]))
    figures = cell_figures(mj, of, position_m, R, side_m, foam_m)
    names = [patch.name for patch in patches]
    row = covering_metrics([figures], n_wires)
    return row | {"wires": n_wires, "components": len(patches), "patches": names, "sheets": []}, figures


def sheet_row(
    mj: Model, of: LinkGround, sheets: Sequence[SheetPose], foam_m: float
) -> tuple[dict[str, Any], CellFigures]:
    """Metrics and figures of a link with sheets, whose elements count as cells."""
    position_m = np.concatenate([sheet.position_m for sheet in sheets])
    R = np.ascontiguousarray(np.concatenate([sheet.R_body_element for sheet in sheets]))
    figures = element_figures(mj, of, position_m, R, of.limits.pitch_m, foam_m)
    names = [sheet.surface.name for sheet in sheets]
    row = covering_metrics([figures], 0)
    return row | {"wires": 0, "components": 0, "patches": [], "sheets": names}, figures
