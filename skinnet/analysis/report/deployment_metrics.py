"""Settings of the deployment under metric names: size of the skin, number of joints, rates, delay.

All names begin with `size.`: the report shows them as settings, without a verdict.
"""

from typing import Any

from skinnet.deployment import Deployment

__all__ = ["deployment_metrics"]

_EXPLORATION_PASSES = 2
"""Runs of the structural exploration: every DoF forth, then every DoF back [M14, III.A]."""


def deployment_metrics(deployment: Deployment | None) -> dict[str, Any]:
    """Sizes and rates of a deployment under metric names; empty for None."""
    if deployment is None:
        return {}
    metrics: dict[str, Any] = {}
    cells = sum(patch.n_cells for patch in deployment.patches)
    if cells:
        metrics |= {"size.patches": len(deployment.patches), "size.cells": cells}
        if deployment.scripted_stimuli is not None and deployment.scripted_stimuli.stimulated_fraction:
            metrics["size.touched_cells"] = round(deployment.scripted_stimuli.stimulated_fraction * cells)
    if deployment.sheets:
        metrics["size.sheets"] = len(deployment.sheets)
        metrics["size.tactile_points"] = sum(sheet.n_elements for sheet in deployment.sheets)
    period_ms = deployment.cells.period_ms if cells else deployment.boards.period_ms
    metrics["size.skin_rate_hz"] = 1e3 / period_ms
    metrics["size.joints"] = len(deployment.body.joints)
    metrics["size.control_rate_hz"] = 1e3 / deployment.controller.period_ms
    metrics["size.command_delay_ms"] = 1e-6 * deployment.controller.command_delay_ns
    stages = (deployment.controller.stages.get(name) for name in deployment.controller.program)
    if any(stage is not None and stage.kind == "structure" for stage in stages):
        metrics["size.exploration_steps"] = _EXPLORATION_PASSES * len(deployment.body.joints)
    return metrics
