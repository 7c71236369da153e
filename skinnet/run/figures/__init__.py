"""Metrics of a run, each computed only from the results of its processes."""

from pathlib import Path
from typing import Any

from skinnet.deployment import Deployment
from skinnet.deployment.schema import BOARDS
from skinnet.part import Part
from skinnet.run.figures.grasp import grasp_figures, object_figures
from skinnet.run.figures.network import network_figures
from skinnet.run.figures.nursing import board_figures, nursing_figures
from skinnet.run.figures.self_organisation import map_figures, structure_figures
from skinnet.run.figures.session import session_figures
from skinnet.run.figures.teaching import teaching_figures
from skinnet.run.figures.touch import touch_figures
from skinnet.run.truth import Truth

__all__ = ["Figures", "compute_figures"]

Figures = dict[str, Any]


def compute_figures(deployment: Deployment, base: Path, parts: dict[str, Part]) -> Figures:
    """Compute the metrics that the given process results allow, flat by dotted name."""
    figures: Figures = {}
    controller, body = parts.get("controller"), parts.get("body")
    if controller is not None and deployment.nursing is not None:
        figures |= nursing_figures(deployment, controller, body)
    elif controller is not None:
        truth = Truth(deployment, base)
        figures |= structure_figures(deployment, controller, truth)
        figures |= map_figures(deployment, controller, truth)
        figures |= session_figures(controller)
        if body is not None:
            figures |= touch_figures(deployment, controller, body)
            figures |= teaching_figures(body)
            figures |= grasp_figures(deployment, controller, body)
    if body is not None:
        figures |= object_figures(body)
    if BOARDS in parts:
        figures |= board_figures(parts[BOARDS])
    figures |= network_figures([part for part in parts.values() if part.role == "cells"])
    return figures
