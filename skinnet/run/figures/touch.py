"""Touch: how soon the robot reacts, how hard it is touched, how it is led."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment import Deployment
from skinnet.deployment.schema import StageSpec
from skinnet.part import Part

__all__ = ["Reaction", "reactions", "touch_figures"]

_HELD_READING = 0.14
_HELD_WITHIN = 0.005
_PROXIMITY_CHANNEL = 3
_EARLIEST_NS = 20_000_000
"""Noise can make a cell sample above the threshold a little before the stimulus truly crosses it."""


class Reaction(NamedTuple):
    """One way from a stimulus to a command [ns]: it crossed, was sampled, delivered, used, took effect."""

    cell: int
    channel: int
    crossed_ns: int
    sampled_ns: int
    delivered_ns: int
    tick_ns: int
    effect_ns: int


def touch_figures(deployment: Deployment, controller: Part, body: Part) -> dict[str, Any]:
    """Latencies of reactions with their parts, peak forces, guidance."""
    figures: dict[str, Any] = {}
    figures |= _latency_figures(reactions(controller, body))
    figures |= _force_figures(body)
    figures |= _guidance_figures(deployment, controller, body)
    figures |= _proximity_figures(deployment, controller, body)
    return figures


def reactions(controller: Part, body: Part) -> list[Reaction]:
    """Onsets of reactions, each with the true crossing of its threshold that caused it.

    An onset belongs to the last crossing of the same channel before its sample. An onset without one (a
    channel that hovers about the threshold) is left out.
    """
    crossed: dict[tuple[int, int], list[int]] = {}
    for t_ns, cell, channel in body.facts["reaction_crossings"]:
        crossed.setdefault((cell, channel), []).append(t_ns)
    delay_ns = controller.facts["command_delay_ns"]
    found = []
    used: set[tuple[int, int, int]] = set()
    for _, cell, channel, sampled_ns, delivered_ns, tick_ns in controller.facts["onsets"]:
        times = [t for t in crossed.get((cell, channel), []) if t <= sampled_ns + _EARLIEST_NS]
        if times and (cell, channel, times[-1]) not in used:
            used.add((cell, channel, times[-1]))
            effect_ns = tick_ns + delay_ns
            found.append(Reaction(cell, channel, times[-1], sampled_ns, delivered_ns, tick_ns, effect_ns))
    return found


def _latency_figures(found: list[Reaction]) -> dict[str, Any]:
    if not found:
        return {"reaction.count": 0}
    t_ms = np.array([reaction[2:] for reaction in found], dtype=np.float64) * 1e-6
    parts = np.diff(t_ms, axis=1)
    total = t_ms[:, -1] - t_ms[:, 0]
    figures: dict[str, Any] = {"reaction.count": len(found)}
    for name, values in (
        ("latency_ms", total),
        ("sampling_ms", parts[:, 0]),
        ("network_ms", parts[:, 1]),
        ("control_ms", parts[:, 2]),
        ("actuation_ms", parts[:, 3]),
    ):
        figures[f"reaction.{name}.p50"] = float(np.percentile(values, 50))
        figures[f"reaction.{name}.p99"] = float(np.percentile(values, 99))
    return figures


def _force_figures(body: Part) -> dict[str, Any]:
    """Peak force of the touches that push on a path; those that hold a force choose it themselves."""
    pushed = [touch["peak_n"] for touch in body.facts["touches"] if touch["by_depth"]]
    return {"contact.peak_force_n": max(pushed)} if pushed else {}


def _guidance_figures(deployment: Deployment, controller: Part, body: Part) -> dict[str, Any]:
    """Commanded and measured joint velocity while a single force cell holds a reading of 0.14 [M14, VI.B]."""
    t_ns, touch = controller.arrays["touch_t_ns"], controller.arrays["touch"].astype(np.float64)
    if not len(t_ns):
        return {}
    ticks = np.searchsorted(controller.arrays["t_ns"], t_ns)
    velocity = controller.arrays["velocity_rad_s"][ticks].astype(np.float64)
    held = np.zeros(len(t_ns), dtype=np.bool_)
    for name, start_ns, end_ns, stage in _guide_stages(deployment, controller):
        del name
        if stage.force_gain == 0.0 or stage.proximity_gain != 0.0:
            continue
        within = (t_ns >= start_ns) & (t_ns < end_ns)
        force = touch[:, :, :_PROXIMITY_CHANNEL].reshape(len(t_ns), -1)
        alone = (force > stage.force_threshold).sum(axis=1) == 1
        held |= within & alone & (np.abs(force.max(axis=1, initial=0.0) - _HELD_READING) < _HELD_WITHIN)
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


def _guide_stages(deployment: Deployment, controller: Part) -> list[tuple[str, int, int, StageSpec]]:
    log = controller.facts["stages"]
    ends = [t_ns for _, t_ns in log[1:]] + [controller.facts["end_ns"]]
    specs = deployment.controller.stages
    return [
        (name, start, end, specs[name])
        for (name, start), end in zip(log, ends, strict=True)
        if specs[name].kind == "guide"
    ]


def _measured_velocity(body: Part, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n, D) [rad/s] joint velocities at `t_ns`, from the positions 50 ms before and after."""
    trace_ns, trace_rad = body.arrays["joint_t_ns"], body.arrays["joint_rad"].astype(np.float64)
    half_ns = 50_000_000
    last = len(trace_ns) - 1
    before = np.clip(np.searchsorted(trace_ns, t_ns - half_ns), 0, last)
    after = np.clip(np.searchsorted(trace_ns, t_ns + half_ns), 0, last)
    elapsed_s = np.maximum(trace_ns[after] - trace_ns[before], 1) * 1e-9
    velocity: NDArray[np.float64] = (trace_rad[after] - trace_rad[before]) / elapsed_s[:, None]
    return velocity


def _proximity_figures(deployment: Deployment, controller: Part, body: Part) -> dict[str, Any]:
    """How far the arm had moved when the finger, held off by proximity guidance, touched or came closest."""
    stages = {
        name for name, _, _, stage in _guide_stages(deployment, controller) if stage.proximity_gain > 0.0
    }
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
        "proximity.peak_force_n": max(touch["peak_n"] for touch in touches),
    }
