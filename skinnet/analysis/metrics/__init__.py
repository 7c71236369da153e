"""Metrics of a run, each computed only from the results of its processes."""

from pathlib import Path
from typing import Any

from skinnet.analysis.metrics.grasp import grasp_metrics, object_metrics
from skinnet.analysis.metrics.model_reference import ModelReference
from skinnet.analysis.metrics.nursing import board_metrics, nursing_metrics
from skinnet.analysis.metrics.packet_traffic import network_metrics
from skinnet.analysis.metrics.self_organisation import map_metrics, structure_metrics
from skinnet.analysis.metrics.teach_and_grasp import session_metrics
from skinnet.analysis.metrics.teaching import teaching_metrics
from skinnet.analysis.metrics.touch import touch_metrics
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.runtime.process_result import ProcessResult

__all__ = ["Metrics", "compute_metrics"]

Metrics = dict[str, Any]


def compute_metrics(deployment: Deployment, base: Path, results: dict[str, ProcessResult]) -> Metrics:
    """Compute the metrics that the given process results allow, flat by dotted name."""
    figures: Metrics = {}
    controller, body = results.get("controller"), results.get("body")
    if controller is not None and deployment.nursing is not None:
        figures |= nursing_metrics(deployment, controller, body)
    elif controller is not None:
        truth = ModelReference(deployment, base)
        figures |= structure_metrics(deployment, controller, truth)
        figures |= map_metrics(deployment, controller, truth)
        figures |= session_metrics(controller)
        if body is not None:
            figures |= touch_metrics(deployment, controller, body)
            figures |= teaching_metrics(body)
            figures |= grasp_metrics(deployment, controller, body)
    if body is not None:
        figures |= object_metrics(body)
    if BOARD_PROCESS in results:
        figures |= board_metrics(results[BOARD_PROCESS])
    figures |= network_metrics([part for part in results.values() if part.role == "cells"])
    return figures
