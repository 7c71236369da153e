"""Nursing metrics: deviations of contacts, forces, centres of pressure, and ground truth of the object."""

from typing import Any

import numpy as np

from skinnet.analysis.metrics.object_pose import rotation_deg
from skinnet.analysis.metrics.packet_traffic import percentile_us
from skinnet.deployment import Deployment
from skinnet.pinned_linalg import norm
from skinnet.runtime.process_result import ProcessResult

__all__ = ["board_metrics", "contact_label", "nursing_metrics"]


def nursing_metrics(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult | None
) -> dict[str, Any]:
    """Metrics of Figs. 9 to 14 [R11], under the label of the deployment's program."""
    assert deployment.nursing is not None
    label = deployment.nursing.label
    facts = controller.facts
    metrics: dict[str, Any] = {
        "state": facts["states"][-1][0] if facts["states"] else "hold",
        "stopped_by": facts["stopped_by"] or "nothing",
    }
    if facts["reason"]:
        metrics["reason"] = facts["reason"]
    names = [contact["name"] for contact in facts["contacts"]]
    for contact in facts["contacts"]:
        name = contact_label(contact["name"], names)
        metrics[f"position_dev_mm.{name}"] = 1e3 * contact["position_dev_end_m"]
        metrics[f"position_dev_mm.{name}.peak"] = 1e3 * contact["position_dev_peak_m"]
        metrics[f"rotation_dev_deg.{name}"] = float(np.degrees(contact["rotation_dev_end_rad"]))
        metrics[f"rotation_dev_deg.{name}.peak"] = float(np.degrees(contact["rotation_dev_peak_rad"]))
        for when in () if deployment.nursing.assumed_contacts else ("start", "min", "max", "end"):
            metrics[f"force_n.{name}.{when}"] = contact[f"force_{when}_n"]
    if names and not deployment.nursing.assumed_contacts:
        metrics["cop_mm.peak"] = 1e3 * max(contact["cop_peak_m"] for contact in facts["contacts"])
        metrics["cop_mm.end"] = 1e3 * max(contact["cop_end_m"] for contact in facts["contacts"])
        metrics["peak_pressure_kpa"] = facts["peak_kpa"]
    if body is not None and "payload" in body.facts:
        metrics |= _object_metrics(deployment, controller, body)
    return {f"{label}.{name}": value for name, value in metrics.items()}


def board_metrics(boards: ProcessResult) -> dict[str, Any]:
    """Network metrics of the boards: messages, drops by cause, latency."""
    total: dict[str, int] = {}
    for counts in boards.facts["boards"].values():
        for name, value in counts.items():
            total[name] = total.get(name, 0) + value
    offered, delivered, in_flight = (total.pop(name) for name in ("offered", "delivered", "in_flight"))
    metrics: dict[str, Any] = {
        "network.offered": offered,
        "network.delivered": delivered,
        "network.dropped": sum(total.values()),
        "network.in_flight": in_flight,
        "network.conserved": offered == delivered + sum(total.values()) + in_flight,
    }
    metrics |= {f"network.dropped.{cause}": count for cause, count in sorted(total.items()) if count}
    histogram = boards.arrays["latency_us"]
    if histogram.sum():
        metrics["network.latency_us.p50"] = percentile_us(histogram, 0.50)
        metrics["network.latency_us.p99"] = percentile_us(histogram, 0.99)
        metrics["network.latency_us.max"] = boards.facts["latency_max_ns"] * 1e-3
    return metrics


def contact_label(contact: str, contacts: list[str]) -> str:
    """Display name of a contact: its side, if there is exactly one on each side."""
    sides = [name.split("_")[0] for name in contacts]
    side = contact.split("_")[0]
    return side if sorted(sides) == ["left", "right"] else contact


def _object_metrics(deployment: Deployment, controller: ProcessResult, body: ProcessResult) -> dict[str, Any]:
    """Ground truth of the object: drop, displacement in the arms, slip, rotation, distance from target."""
    assert deployment.nursing is not None
    truth = body.facts["payload"]
    metrics: dict[str, Any] = {
        "dropped": truth["dropped_ns"] is not None,
        "dropped_by": truth["dropped_by"] or "nothing",
        "slid_mm": 1e3 * truth["slid_m"],
        "slip_mm": 1e3 * truth["sliding_distance_m"],
    }
    turned_deg = rotation_deg(body.arrays["object_pose"])
    metrics |= {"rotation_deg.peak": float(turned_deg.max()), "rotation_deg.end": float(turned_deg[-1])}
    begin_ns = next((t_ns for state, t_ns in controller.facts["states"] if state == "move"), None)
    if begin_ns is not None:
        t_ns, pose = body.arrays["object_t_ns"], body.arrays["object_pose"]
        start = pose[min(int(np.searchsorted(t_ns, begin_ns)), len(pose) - 1), :3]
        wanted = np.array(deployment.nursing.waypoints[-1].displacement_m)
        metrics["object_error_mm"] = 1e3 * norm(pose[-1, :3] - start - wanted)
    return metrics
