"""Touch metrics: reaction latencies, contact forces, tactile guidance."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.analysis.metrics.stages import stage_intervals
from skinnet.deployment import Deployment
from skinnet.deployment.controller.stages import StageSpec
from skinnet.runtime.process_result import ProcessResult

__all__ = [
    "Reaction",
    "actuation_metrics",
    "evasion_metrics",
    "force_metrics",
    "guidance_metrics",
    "proximity_metrics",
    "reaction_metrics",
    "reactions",
    "rows_by_cell_name",
    "touch_metrics",
]

_HELD_READING = 0.14
"""Reading of a noise-free force cell under the held force [M14, VI.B]."""
_HELD_TOLERANCE_N = 0.05
"""Tolerance of the true force that counts as held [N]; the finger's control keeps 2 % (assumed)."""
_PROXIMITY_CHANNEL = 3
_EVADED_M = 0.001
"""Way of a cell [m] from which it has evaded: servos yield to a newton by less (assumed)."""
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
    metrics |= reaction_metrics(*reactions(deployment, controller, body))
    metrics |= actuation_metrics(deployment, controller, body)
    metrics |= force_metrics(deployment, body)
    metrics |= evasion_metrics(deployment, controller, body)
    metrics |= guidance_metrics(deployment, controller, body)
    metrics |= proximity_metrics(deployment, controller, body)
    return metrics


def reactions(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> tuple[list[Reaction], int]:
    """Reactions to true threshold crossings: the first sample after each crossing that drove the robot.

    Samples before the crossing do not count, though noise lets some of them react early. Return also the
    number of crossings without a reaction, because the touch ended before a sample exceeded the threshold, or
    the run before the command came into effect. The body says when that was.
    """
    stages = [deployment.controller.stages[name] for name, _ in controller.facts["stages"]]
    spans = stage_intervals(deployment, controller, "guide")
    drives = controller.arrays["reaction_log"]
    effect_of_tick = dict(body.arrays["command_ns"].tolist())
    found = []
    unanswered = 0
    for t_ns, cell, channel, reading in body.facts["threshold_crossings"]:
        if not any(s.start_ns <= t_ns < s.end_ns and _has_threshold(s.spec, channel, reading) for s in spans):
            continue
        mine = drives[(drives["cell"] == cell) & (drives["channel"] == channel)]
        after = mine[(mine["t_sampled_ns"] >= t_ns) & (mine["t_sampled_ns"] < t_ns + _MAX_REACTION_NS)]
        after = [d for d in after if _has_threshold(stages[d["stage"]], channel, reading)]
        first = min(after, key=lambda drive: int(drive["t_sampled_ns"]), default=None)
        if first is None or int(first["tick_ns"]) not in effect_of_tick:
            unanswered += 1
            continue
        sampled_ns, delivered_ns = int(first["t_sampled_ns"]), int(first["t_delivered_ns"])
        tick_ns = int(first["tick_ns"])
        effect_ns = effect_of_tick[tick_ns]
        found.append(Reaction(cell, channel, t_ns, sampled_ns, delivered_ns, tick_ns, effect_ns))
    return found, unanswered


def _has_threshold(spec: StageSpec, channel: int, reading: float) -> bool:
    """Test whether a stage reacts to a channel from exactly this threshold on."""
    if channel == _PROXIMITY_CHANNEL:
        return spec.proximity_gain > 0.0 and spec.proximity_threshold == reading
    return spec.force_gain > 0.0 and spec.force_threshold == reading


def reaction_metrics(found: list[Reaction], unanswered: int) -> dict[str, Any]:
    """Latency of reactions from the true crossing until the command is in effect, and its parts.

    What is left of `latency_ms` beside its parts is `controller.command_delay_ms`, a setting.
    """
    if not found:
        return {"reaction.count": 0, "reaction.unanswered": unanswered}
    t_ms = np.array([reaction[2:] for reaction in found], dtype=np.float64) * 1e-6
    parts = np.diff(t_ms, axis=1)
    total = t_ms[:, -1] - t_ms[:, 0]
    metrics: dict[str, Any] = {
        "reaction.count": len(found),
        "reaction.unanswered": unanswered,
    }
    for name, values in (
        ("latency_ms", total),
        ("sampling_ms", parts[:, 0]),
        ("network_ms", parts[:, 1]),
        ("control_ms", parts[:, 2]),
    ):
        metrics[f"reaction.{name}.p50"] = float(np.percentile(values, 50))
        metrics[f"reaction.{name}.p99"] = float(np.percentile(values, 99))
    return metrics


def actuation_metrics(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> dict[str, Any]:
    """Time from a command's effect to the first true motion, for commands that found the robot at rest.

    Of all that begin in guide stages, since the first command of a reaction is often one to noise.
    """
    spans = stage_intervals(deployment, controller, "guide")
    moved_ms = [
        1e-6 * (moved_ns - effect_ns)
        for effect_ns, moved_ns in body.facts.get("motion_onsets", ())
        if moved_ns is not None and any(span.start_ns <= effect_ns < span.end_ns for span in spans)
    ]
    if not moved_ms:
        return {}
    return {
        "reaction.motions_from_rest": len(moved_ms),
        "reaction.actuation_ms.p50": float(np.percentile(moved_ms, 50)),
        "reaction.actuation_ms.p99": float(np.percentile(moved_ms, 99)),
    }


def force_metrics(deployment: Deployment, body: ProcessResult) -> dict[str, Any]:
    """Peak force of the touches that follow a path, and what the skin feels of a force that is held.

    Touches under force control set their own peak. The felt error is that of the sum over all cells, each
    along its normal, against the force of the finger, both along its line of approach, as a fraction, in the
    hold phases of touches of cells as a whole.
    """
    touches, specs = body.facts["touches"], deployment.teacher.touches
    pushed = [touch["peak_force_n"] for touch in touches if touch["depth_controlled"]]
    metrics = {"contact.peak_force_n": max(pushed)} if pushed else {}
    errors = [
        abs(touch["mean_felt_force_n"] / touch["mean_gauge_force_n"] - 1.0)
        for touch in touches
        if touch["hold_ns"] is not None
        and not touch["depth_controlled"]
        and specs[touch["touch"]].force_cell is None
        and touch["mean_gauge_force_n"] > 0.0
    ]
    if errors:
        metrics["contact.felt_error.p50"] = float(np.median(errors))
        metrics["contact.felt_error.max"] = max(errors)
    return metrics


def evasion_metrics(deployment: Deployment, controller: ProcessResult, body: ProcessResult) -> dict[str, Any]:
    """Ways of touched cells along their inward normals, in stages that react to force.

    A cell that moves inwards by more than what a stiff servo yields has evaded; one that moves towards the
    finger shows a wrong sign.
    """
    spans = stage_intervals(deployment, controller, "guide")
    stages = {span.name for span in spans if span.spec.force_gain > 0.0}
    ways_m = [
        touch["evaded_m"]
        for touch in body.facts["touches"]
        if touch["stage"] in stages and touch["evaded_m"] is not None
    ]
    if not ways_m:
        return {}
    return {
        "evasion.touches": len(ways_m),
        "evasion.inwards": sum(way_m > _EVADED_M for way_m in ways_m),
        "evasion.outwards": sum(way_m < -_EVADED_M for way_m in ways_m),
        "evasion.way_mm.p50": 1e3 * float(np.median(ways_m)),
    }


def guidance_metrics(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> dict[str, Any]:
    """Reading, commanded and measured joint velocity while a single force cell is held [M14, VI.B].

    The ticks are chosen by the true force that gives a reading of 0.14 without noise, never by the reading.
    """
    held_ns, reading = _held_readings(deployment, controller, body)
    if not len(held_ns):
        return {}
    ticks = np.searchsorted(controller.arrays["t_ns"], held_ns)
    velocity = controller.arrays["velocity_rad_s"][ticks].astype(np.float64)
    measured = _measured_velocity(body, held_ns)
    return {
        "guidance.reading": float(np.mean(reading)),
        "guidance.velocity_rad_s": float(np.median(np.linalg.norm(velocity, axis=1))),
        "guidance.largest_dof_rad_s": float(np.median(np.abs(velocity).max(axis=1))),
        "guidance.measured_rad_s": float(np.median(np.linalg.norm(measured, axis=1))),
        "guidance.ticks": len(held_ns),
    }


def _held_readings(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Ticks (n,) [ns] at which a force cell truly bears the held force, and its readings there (n,)."""
    t_ns = controller.arrays["tactile_input_t_ns"]
    calibration = deployment.cells.force
    held_n = np.interp(_HELD_READING, calibration.calibration_reading, calibration.calibration_n)
    trace_ns, trace_n = body.arrays["peak_force_t_ns"], body.arrays["peak_force_n"]
    if not len(trace_ns):
        return np.empty(0, dtype=np.int64), np.empty(0)
    # the trace gives the largest force of the period that ends at each of its times
    index = np.minimum(np.searchsorted(trace_ns, t_ns), len(trace_ns) - 1)
    is_held = np.abs(trace_n[index] - held_n) <= _HELD_TOLERANCE_N
    spans = [
        span
        for span in stage_intervals(deployment, controller, "guide")
        if span.spec.force_gain > 0.0 and span.spec.proximity_gain == 0.0
    ]
    rows = rows_by_cell_name(deployment)
    found_ns, readings = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for touch in body.facts["touches"]:
        force_cell = deployment.teacher.touches[touch["touch"]].force_cell
        if touch["depth_controlled"] or force_cell is None or touch["hold_ns"] is None:
            continue
        begin_ns, end_ns = touch["hold_ns"], touch["end_ns"] or int(trace_ns[-1]) + 1
        within = np.zeros(len(t_ns), dtype=np.bool_)
        for span in spans:
            within |= (t_ns >= max(begin_ns, span.start_ns)) & (t_ns < min(end_ns, span.end_ns))
        chosen = np.flatnonzero(within & is_held)
        found_ns.append(t_ns[chosen])
        told = controller.arrays["tactile_input"][chosen, rows[touch["cell"]], force_cell]
        readings.append(told.astype(np.float64))
    return np.concatenate(found_ns), np.concatenate(readings)


def rows_by_cell_name(deployment: Deployment) -> dict[str, int]:
    """Row of each cell in the stimulus, by its name `patch/number`."""
    names = [f"{patch.name}/{cell}" for patch in deployment.patches for cell in range(patch.n_cells)]
    return {name: row for row, name in enumerate(names)}


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


def proximity_metrics(
    deployment: Deployment, controller: ProcessResult, body: ProcessResult
) -> dict[str, Any]:
    """Proximity guidance: true gap when the robot begins to move, motion before contact, contacts."""
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
    gaps_mm = [1e3 * touch["onset_gap_m"] for touch in touches if touch["onset_gap_m"] is not None]
    metrics: dict[str, Any] = {
        "proximity.touches": len(touches),
        "proximity.unanswered": len(touches) - len(gaps_mm),
        "proximity.moved_before_contact_rad.min": min(moved),
        "proximity.contacts": sum(touch["contact_ns"] is not None for touch in touches),
        "proximity.peak_force_n": max(touch["peak_force_n"] for touch in touches),
    }
    if gaps_mm:
        metrics["proximity.onset_distance_mm.min"] = min(gaps_mm)
        metrics["proximity.onset_distance_mm.max"] = max(gaps_mm)
    return metrics
