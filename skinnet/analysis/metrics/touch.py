"""Touch metrics: reaction latencies, contact forces, tactile guidance."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.analysis.metrics.stages import stage_intervals
from skinnet.deployment import Deployment
from skinnet.deployment.controller.stages import StageSpec
from skinnet.runtime.process_result import ProcessResult

__all__ = ["Reaction", "reactions", "touch_metrics"]

_HELD_READING = 0.14
_HELD_TOLERANCE = 0.005
_PROXIMITY_CHANNEL = 3
_MAX_REACTION_NS = 100_000_000
"""Longest time from a crossing to a sample that counts as its reaction [ns]."""


class Reaction(NamedTuple):
    """Reaction to a stimulus, times [ns]: threshold crossed, sampled, delivered, control tick, in effect."""

    cell: int
    channel: int
    crossed_ns: int
    sampled_ns: int
    delivered_ns: int
    tick_ns: int
    effect_ns: int


def touch_metrics(deployment: Deployment, controller: ProcessResult, body: ProcessResult) -> dict[str, Any]:
    """Metrics of reaction latencies and their components, peak forces, and guidance."""
    metrics: dict[str, Any] = {}
    metrics |= _latency_metrics(*reactions(deployment, controller, body))
    metrics |= _force_metrics(body)
    metrics |= _guidance_metrics(deployment, controller, body)
    metrics |= _proximity_metrics(deployment, controller, body)
    return metrics


def reactions(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> tuple[list[Reaction], int]:
    """Reactions to true threshold crossings: the first sample after each crossing that drove the robot.

    Samples before the crossing do not count, though noise lets some of them react early. Return also the
    number of crossings without a reaction, because the touch ended before a sample exceeded the threshold.
    """
    stages = [deployment.controller.stages[name] for name, _ in controller.facts["stages"]]
    spans = stage_intervals(deployment, controller, "guide")
    drives = controller.arrays["reaction_log"]
    delay_ns = controller.facts["command_delay_ns"]
    found = []
    unanswered = 0
    for t_ns, cell, channel, reading in body.facts["threshold_crossings"]:
        if not any(s.start_ns <= t_ns < s.end_ns and _has_threshold(s.spec, channel, reading) for s in spans):
            continue
        mine = drives[(drives["cell"] == cell) & (drives["channel"] == channel)]
        after = mine[(mine["t_sampled_ns"] >= t_ns) & (mine["t_sampled_ns"] < t_ns + _MAX_REACTION_NS)]
        after = [d for d in after if _has_threshold(stages[d["stage"]], channel, reading)]
        if not after:
            unanswered += 1
            continue
        first = min(after, key=lambda drive: int(drive["t_sampled_ns"]))
        sampled_ns, delivered_ns = int(first["t_sampled_ns"]), int(first["t_delivered_ns"])
        tick_ns = int(first["tick_ns"])
        found.append(Reaction(cell, channel, t_ns, sampled_ns, delivered_ns, tick_ns, tick_ns + delay_ns))
    return found, unanswered


def _has_threshold(spec: StageSpec, channel: int, reading: float) -> bool:
    """Test whether a stage reacts to a channel from exactly this threshold on."""
    if channel == _PROXIMITY_CHANNEL:
        return spec.proximity_gain > 0.0 and spec.proximity_threshold == reading
    return spec.force_gain > 0.0 and spec.force_threshold == reading


def _latency_metrics(found: list[Reaction], unanswered: int) -> dict[str, Any]:
    if not found:
        return {"reaction.count": 0, "reaction.unanswered": unanswered}
    t_ms = np.array([reaction[2:] for reaction in found], dtype=np.float64) * 1e-6
    parts = np.diff(t_ms, axis=1)
    total = t_ms[:, -1] - t_ms[:, 0]
    metrics: dict[str, Any] = {"reaction.count": len(found), "reaction.unanswered": unanswered}
    for name, values in (
        ("latency_ms", total),
        ("sampling_ms", parts[:, 0]),
        ("network_ms", parts[:, 1]),
        ("control_ms", parts[:, 2]),
        ("actuation_ms", parts[:, 3]),
    ):
        metrics[f"reaction.{name}.p50"] = float(np.percentile(values, 50))
        metrics[f"reaction.{name}.p99"] = float(np.percentile(values, 99))
    return metrics


def _force_metrics(body: ProcessResult) -> dict[str, Any]:
    """Peak force of the touches that follow a path; those under force control set it themselves."""
    pushed = [touch["peak_force_n"] for touch in body.facts["touches"] if touch["depth_controlled"]]
    return {"contact.peak_force_n": max(pushed)} if pushed else {}


def _guidance_metrics(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> dict[str, Any]:
    """Commanded and measured joint velocity while a single force cell holds a reading of 0.14 [M14, VI.B]."""
    t_ns, touch = (
        controller.arrays["tactile_input_t_ns"],
        controller.arrays["tactile_input"].astype(np.float64),
    )
    if not len(t_ns):
        return {}
    ticks = np.searchsorted(controller.arrays["t_ns"], t_ns)
    velocity = controller.arrays["velocity_rad_s"][ticks].astype(np.float64)
    held = np.zeros(len(t_ns), dtype=np.bool_)
    for span in stage_intervals(deployment, controller, "guide"):
        stage = span.spec
        if stage.force_gain == 0.0 or stage.proximity_gain != 0.0:
            continue
        within = (t_ns >= span.start_ns) & (t_ns < span.end_ns)
        force = touch[:, :, :_PROXIMITY_CHANNEL].reshape(len(t_ns), -1)
        alone = (force > stage.force_threshold).sum(axis=1) == 1
        held |= within & alone & (np.abs(force.max(axis=1, initial=0.0) - _HELD_READING) < _HELD_TOLERANCE)
    if not held.any():
        return {}
    force = touch[held, :, :_PROXIMITY_CHANNEL].reshape(int(held.sum()), -1)
    measured = _measured_velocity(body, t_ns[held])
    return {
        "guidance.reading": float(np.mean(force.max(axis=1))),
        "guidance.velocity_rad_s": float(np.median(np.linalg.norm(velocity[held], axis=1))),
        "guidance.largest_dof_rad_s": float(np.median(np.abs(velocity[held]).max(axis=1))),
        "guidance.measured_rad_s": float(np.median(np.linalg.norm(measured, axis=1))),
        "guidance.ticks": int(held.sum()),
    }


def _measured_velocity(body: ProcessResult, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Joint velocities (n, D) [rad/s] at `t_ns`, from the positions 50 ms before and after."""
    trace_ns, trace_rad = body.arrays["joint_t_ns"], body.arrays["joint_rad"].astype(np.float64)
    half_ns = 50_000_000
    last = len(trace_ns) - 1
    before = np.clip(np.searchsorted(trace_ns, t_ns - half_ns), 0, last)
    after = np.clip(np.searchsorted(trace_ns, t_ns + half_ns), 0, last)
    elapsed_s = np.maximum(trace_ns[after] - trace_ns[before], 1) * 1e-9
    velocity: NDArray[np.float64] = (trace_rad[after] - trace_rad[before]) / elapsed_s[:, None]
    return velocity


def _proximity_metrics(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> dict[str, Any]:
    """Proximity guidance: joint motion before contact, contacts, and peak force of the finger."""
    spans = stage_intervals(deployment, controller, "guide")
    stages = {span.name for span in spans if span.spec.proximity_gain > 0.0}
    touches = [touch for touch in body.facts["touches"] if touch["stage"] in stages]
    if not touches:
        return {}
    trace_ns, trace_rad = body.arrays["joint_t_ns"], body.arrays["joint_rad"].astype(np.float64)
    moved = []
    for touch in touches:
        until_ns = touch["contact_ns"] or touch["end_ns"] or int(trace_ns[-1])
        a, b = np.searchsorted(trace_ns, [touch["begin_ns"], until_ns])
        window = trace_rad[a : b + 1]
        moved.append(float(np.abs(window - window[:1]).max()) if len(window) else 0.0)
    return {
        "proximity.touches": len(touches),
        "proximity.moved_before_contact_rad.min": min(moved),
        "proximity.contacts": sum(touch["contact_ns"] is not None for touch in touches),
        "proximity.peak_force_n": max(touch["peak_force_n"] for touch in touches),
    }
