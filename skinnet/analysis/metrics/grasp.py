"""Grasp metrics: success, states, forces, and contacts of the object."""

from itertools import pairwise
from typing import Any

import numpy as np

from skinnet.analysis.metrics.object_pose import rotation_deg
from skinnet.analysis.metrics.teach_and_grasp import StateInterval, state_intervals
from skinnet.deployment import Deployment
from skinnet.deployment.environment.stand import StandSpec
from skinnet.deployment.skin.cells import ForceSpec
from skinnet.protocol.states import GRASP_STATES
from skinnet.runtime.process_result import ProcessResult

__all__ = ["grasp_metrics", "object_metrics"]

_MIN_HOLD_S = 5.0
_SUPPORTED_WEIGHT_FRACTION = 0.5
"""Fraction of its weight that the stand carries at the end if the object is back."""


def grasp_metrics(deployment: Deployment, controller: ProcessResult, body: ProcessResult) -> dict[str, Any]:
    """Metrics of the last grasp of the run; empty without one."""
    spans = state_intervals(controller)
    begins = [i for i, span in enumerate(spans) if span.state == "open"]
    if not begins:
        return {}
    grasp = [span for span in spans[begins[-1] :] if span.state in GRASP_STATES]
    metrics: dict[str, Any] = {"grasp.object": deployment.object, "grasp.attempts": len(begins)}
    metrics |= _state_metrics(grasp)
    metrics |= _force_metrics(deployment.cells.force, grasp, controller, body)
    thing = body.facts.get("object")
    carried = (
        thing is not None and deployment.stand is not None and _was_carried(thing, deployment.stand, body)
    )
    metrics["grasp.success"] = bool(
        carried and _had_three_contacts(grasp) and grasp[-1].event == "pose reached"
    )
    return metrics


def _had_three_contacts(grasp: list[StateInterval]) -> bool:
    """Test for a full grasp: pulled to the chest with all three in contact, held, and released on request."""
    order = [(span.state, span.event) for span in grasp]
    pulled = [span for span in grasp if (span.state, span.event) == ("pull", "object touches the chest")]
    held = ("hold", "release") in order
    return bool(pulled) and held and all(cells > 0 for cells in pulled[-1].contacts)


def _was_carried(thing: dict[str, Any], stand: StandSpec, body: ProcessResult) -> bool:
    """Test of the object: skin held it for five seconds without the stand, and it is back at the end.

    An object that sinks through the arms, or lies on a bare link, is not held.
    """
    stands_n = float(body.arrays["object_stand_force_n"][-1])
    return (
        thing["dropped_ns"] is None
        and thing["carried_on_skin_s"] >= _MIN_HOLD_S
        and thing["max_descent_m"] <= stand.max_descent_m
        and stands_n > _SUPPORTED_WEIGHT_FRACTION * thing["weight_n"]
    )


def _state_metrics(grasp: list[StateInterval]) -> dict[str, Any]:
    metrics: dict[str, Any] = {}
    for span in grasp:
        key = f"grasp.{span.state}_s"
        metrics[key] = metrics.get(key, 0.0) + (span.end_ns - span.start_ns) * 1e-9
    for span in grasp:
        metrics.setdefault(f"grasp.start_s.{span.state}", span.start_ns * 1e-9)
        if span.state in ("approach", "contact", "load", "pull", "hold") and len(span.contacts) == 3:
            metrics[f"grasp.{span.state}.contact_cells"] = list(span.contacts)
    failed = [span for span, after in pairwise(grasp) if after.state in ("set_down", "safe")]
    metrics["grasp.cancelled_in"] = failed[0].state if failed else ""
    metrics["grasp.cancelled_by"] = failed[0].event if failed else ""
    metrics["grasp.final_state"] = grasp[-1].state
    return metrics


def _force_metrics(
    force: ForceSpec, grasp: list[StateInterval], controller: ProcessResult, body: ProcessResult
) -> dict[str, Any]:
    """Peak forces of the grasp: ground truth on one force cell, and readings that reached the controller."""
    start_ns, end_ns = grasp[0].start_ns, grasp[-1].end_ns
    t_ns = body.arrays["peak_force_t_ns"]
    within = (t_ns >= start_ns) & (t_ns <= end_ns)
    peak_n = float(body.arrays["peak_force_n"][within].max(initial=0.0))
    ticks = controller.arrays["patch_t_ns"]
    told = controller.arrays["patch_readings"][(ticks >= start_ns) & (ticks <= end_ns), :, 0]
    t_move = controller.arrays["t_ns"]
    speed = np.abs(controller.arrays["velocity_rad_s"][(t_move >= start_ns) & (t_move <= end_ns)])
    stages = {name.rpartition(".")[2]: n for name, n in body.facts["peak_force_by_stage_n"].items()}
    by_state = {f"grasp.{span.state}.peak_force_n": stages.get(span.state, 0.0) for span in grasp}
    return by_state | {
        "grasp.peak_force_n": peak_n,
        "grasp.peak_reading": float(np.interp(peak_n, force.calibration_n, force.calibration_reading)),
        "grasp.peak_reading_received": float(told.max(initial=0.0)),
        "grasp.peak_speed_rad_s": float(speed.max(initial=0.0)),
    }


def object_metrics(body: ProcessResult) -> dict[str, Any]:
    """Object metrics from ground truth: its motion, and contacts with bare links, which have no skin."""
    thing = body.facts.get("object")
    if thing is None:
        return {}
    moved_m = body.arrays["object_pose"][-1, :3] - np.array(thing["initial_position_m"])
    turned_deg = rotation_deg(body.arrays["object_pose"])
    metrics: dict[str, Any] = {
        "object.name": thing["name"],
        "object.initial_position_m": list(thing["initial_position_m"]),
        "object.yaw_deg": float(np.degrees(thing["yaw_rad"])),
        "object.carried_s": thing["carried_without_stand_s"],
        "object.carried_on_skin_s": thing["carried_on_skin_s"],
        "object.dropped": thing["dropped_ns"] is not None,
        "object.max_descent_mm": 1e3 * thing["max_descent_m"],
        "object.peak_speed_m_s": thing["peak_speed_m_s"],
        "object.displacement_m": [float(m) for m in moved_m],
        "object.rotation_deg.peak": float(turned_deg.max()),
        "object.rotation_deg.end": float(turned_deg[-1]),
    }
    for name, met in sorted(thing["rigid_contacts"].items()):
        metrics[f"object.bare_link.{name}.peak_force_n"] = met["peak_force_n"]
        metrics[f"object.bare_link.{name}.contact_s"] = met["duration_s"]
    return metrics
