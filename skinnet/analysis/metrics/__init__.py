"""Metrics of a run, each computed only from the results of its processes."""

from pathlib import Path
from typing import Any

from skinnet.analysis.metrics.contact import contact_metrics
from skinnet.analysis.metrics.grasp import grasp_metrics, object_metrics
from skinnet.analysis.metrics.model_reference import ModelReference
from skinnet.analysis.metrics.nursing import board_metrics, nursing_metrics
from skinnet.analysis.metrics.packet_traffic import network_metrics
from skinnet.analysis.metrics.self_organisation import map_metrics, structure_metrics
from skinnet.analysis.metrics.teach_and_grasp import teach_and_grasp_metrics
from skinnet.analysis.metrics.teaching import teaching_metrics
from skinnet.analysis.metrics.touch import touch_metrics
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.runtime.process_result import ProcessResult

__all__ = ["Metrics", "compute_metrics"]

Metrics = dict[str, Any]


def compute_metrics(deployment: Deployment, base: Path, results: dict[str, ProcessResult]) -> Metrics:
    """Compute the metrics that the given process results allow, flat by dotted name."""
    metrics: Metrics = {}
    controller, body = results.get("controller"), results.get("body")
    if controller is not None and deployment.nursing is not None:
        metrics |= nursing_metrics(deployment, controller, body)
    elif controller is not None:
        truth = ModelReference(deployment, base)
        metrics |= structure_metrics(deployment, controller, truth)
        metrics |= map_metrics(deployment, controller, truth)
        metrics |= teach_and_grasp_metrics(controller)
        if body is not None:
            metrics |= touch_metrics(deployment, controller, body)
            metrics |= teaching_metrics(body)
            metrics |= grasp_metrics(deployment, controller, body)
    if body is not None:
        metrics |= object_metrics(body)
        metrics |= contact_metrics(body)
    if BOARD_PROCESS in results:
        metrics |= board_metrics(results[BOARD_PROCESS])
    metrics |= network_metrics([part for part in results.values() if part.role == "cells"])
    if controller is not None and "missed_level_events" in controller.facts:
        metrics["network.missed_level_events"] = controller.facts["missed_level_events"]
    return metrics
