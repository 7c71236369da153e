"""Diagnosis of a deployment: all findings, with and without simulation of its body at home."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skinnet.body.robot_tree import robot_tree
from skinnet.body.settling import settle
from skinnet.body.simulation import BodySimulation
from skinnet.body.step_cost import measure_step_cost
from skinnet.deployment import Deployment
from skinnet.diagnosis.at_rest import collision_findings, pressed_findings, settling_findings, speed_finding
from skinnet.diagnosis.base import base_findings
from skinnet.diagnosis.cell_poses import cell_pose_findings
from skinnet.diagnosis.drawn_surface import drawn_surface_findings
from skinnet.diagnosis.felt_geometry import felt_geometry_findings
from skinnet.diagnosis.finding import Finding, in_order
from skinnet.diagnosis.servos import servo_findings
from skinnet.diagnosis.wiring import wiring_findings
from skinnet.errors import ModelError

__all__ = ["Diagnosis", "diagnose"]


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of a deployment.

    Attributes:
        findings: Findings, the worst first.
        metrics: Metrics of the settling by name, empty without one.
    """

    findings: tuple[Finding, ...]
    metrics: dict[str, Any] = field(default_factory=dict)


def diagnose(
    deployment: Deployment,
    base_dir: Path,
    settle_ns: int = 0,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> Diagnosis:
    """Diagnose a deployment whose covers have become patches.

    Args:
        deployment: The deployment.
        base_dir: Folder that `body.model` is relative to.
        settle_ns: Time to simulate the body at home [ns], whole physics steps; 0 for findings without it.
        progress: Called with the fraction of that time that is done.

    Raises:
        DeploymentError: the deployment contradicts itself or the model.
        ModelError: the model does not compile or lacks something.
    """
    body = BodySimulation(deployment, base_dir)
    tree = robot_tree(body)
    findings = [
        *wiring_findings(deployment),
        *base_findings(deployment, body, tree),
        *cell_pose_findings(deployment, body),
        *drawn_surface_findings(deployment, body),
        *felt_geometry_findings(deployment, base_dir),
        *collision_findings(body, tree),
        *servo_findings(deployment, body),
    ]
    body.pressures()  # evaluates the contact at home
    contact = body.cell_foundation.contact
    if not settle_ns:
        findings += pressed_findings(body, contact.force_n.sum(axis=1), contact.patch_body_force_n)
        return Diagnosis(in_order(findings))
    try:
        settled = settle(body, deployment, settle_ns, progress)
    except ModelError as error:
        mend = "take a shorter body.timestep_ms, softer servos or softer foam, or a home without contact"
        unstable = Finding("error", "unstable", "body", str(error), mend)
        return Diagnosis(in_order([*findings, unstable]))
    findings += pressed_findings(body, settled.force_n, settled.patch_body_force_n)
    findings += settling_findings(deployment, body, tree, settled)
    findings.append(speed_finding(measure_step_cost(body, deployment.body.stimulus_period_ns)))
    return Diagnosis(in_order(findings), settled.metrics)
