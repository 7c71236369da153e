"""Findings on the body at home: contact with itself, drift, energy, oscillation, speed of the simulation."""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.robot_tree import RobotTree, contact_distances_m
from skinnet.body.settling import Settled
from skinnet.body.simulation import BodySimulation
from skinnet.body.step_cost import StepCost
from skinnet.deployment import Deployment
from skinnet.diagnosis.finding import Finding, Severity

__all__ = ["collision_findings", "pressed_findings", "settling_findings", "speed_finding"]

Floats = NDArray[np.float64]

_LEAST_FORCE_N = 0.1
"""Force on a cell [N] that its readings tell from idle noise [M14], six times below its contact threshold."""
_PENETRATION_M = 1e-4
"""Depth [m] of rigid contact beyond which links are in each other: MuJoCo's soft contact needs less."""
_HELD_RAD = 0.01
"""Drift [rad, m] up to which a joint holds home: the default tolerance of a posture."""
_LOST_RAD = 0.1
"""Drift [rad, m] from which home is lost: a step of the exploration of the structure [M14]."""
_HELD_BASE_M, _HELD_BASE_RAD = 0.005, 0.01
_MAX_ENERGY_RATIO = 1.01
_OSCILLATION_RAD_S, _OSCILLATION_REVERSALS, _OSCILLATION_DECAY = 0.02, 4, 0.5
"""Speed and reversals of a joint that oscillates, and the decay of one that comes to rest *(assumed)*."""
_MM_PER_M = 1e3


def collision_findings(body: BodySimulation, tree: RobotTree) -> list[Finding]:
    """Pairs of links of the robot that are in each other at home, in rigid contact."""
    mj = body.model.mj
    return [
        Finding(
            "warning",
            "links_collide",
            f'bodies "{mj.body(a).name}" and "{mj.body(b).name}"',
            f"are {-_MM_PER_M * distance_m:.1f} mm inside each other at home, and push against their servos",
            "choose a body.home_rad in which links keep apart, or an <exclude> in the model",
        )
        for (a, b), distance_m in contact_distances_m(mj, body.data).items()
        if distance_m <= -_PENETRATION_M and np.isin([a, b], tree.body_id).all()
    ]


def pressed_findings(body: BodySimulation, force_n: Floats, patch_body_force_n: Floats) -> list[Finding]:
    """Cells that the robot itself, or what stands in the world, presses at rest.

    Args:
        body: The body.
        force_n: (n_cells,) normal force on each cell [N].
        patch_body_force_n: (p, nbody) normal force of each patch on each body [N].
    """
    mj, findings = body.model.mj, []
    moves_freely = np.isin(mj.body_rootid, _roots_of_free_bodies(body)) | (mj.body_mocapid >= 0)
    roots = mj.body_rootid[body.surface.patch_body_id]
    for index, (name, rows) in enumerate(body.cells.items()):
        own = ~moves_freely | (mj.body_rootid == roots[index])
        by_n = np.where(own, patch_body_force_n[index], 0.0)
        pressed = np.flatnonzero(force_n[rows] > _LEAST_FORCE_N)
        if not len(pressed) or by_n.sum() < _LEAST_FORCE_N:
            continue
        worst, other = int(force_n[rows].argmax()), int(by_n.argmax())
        count = f"{len(pressed)} cells" if len(pressed) > 1 else "a cell"
        findings.append(
            Finding(
                "warning",
                "cells_pressed",
                f"patch {name}",
                f'"{mj.body(other).name or other}" presses {count} at rest with '
                f"{by_n[other]:.2g} N in all, most on cell {worst}, {force_n[rows][worst]:.2g} N",
                "choose a body.home_rad in which links keep apart, move the cells, or keep clearance = true",
                tuple(f"{name}/{row}" for row in pressed.tolist()),
            )
        )
    return findings


def _roots_of_free_bodies(body: BodySimulation) -> NDArray[np.int64]:
    mj = body.model.mj
    free: NDArray[np.int64] = mj.body_rootid[mj.jnt_bodyid[mj.jnt_type == 0]]
    return free


def settling_findings(
    deployment: Deployment, body: BodySimulation, tree: RobotTree, settled: Settled
) -> list[Finding]:
    """Findings on a body that has settled: base, joints, energy, oscillation."""
    return [
        *_base_drift(body, tree, settled),
        *_joint_drift(deployment, body, tree, settled),
        *_energy(deployment, body, settled),
        *_oscillation(deployment, settled),
    ]


def _base_drift(body: BodySimulation, tree: RobotTree, settled: Settled) -> list[Finding]:
    mj, findings = body.model.mj, []
    for joint in tree.free_joint_id.tolist():
        at = slice(int(mj.jnt_qposadr[joint]), int(mj.jnt_qposadr[joint]) + 7)
        start, end = settled.start_qpos[at], settled.end_qpos[at]
        moved_m = float(np.sqrt(((end[:3] - start[:3]) ** 2).sum()))
        cosine = min(abs(float((start[3:] * end[3:]).sum())), 1.0)
        turned_rad = 2.0 * float(np.arccos(cosine))
        if moved_m > _HELD_BASE_M or turned_rad > _HELD_BASE_RAD:
            findings.append(
                Finding(
                    "error",
                    "base_drift",
                    f'body "{mj.body(int(mj.jnt_bodyid[joint])).name}"',
                    f"it moves by {_MM_PER_M * moved_m:.0f} mm at home, and turns by {turned_rad:.2f} rad",
                    "set body.fixed_base = true, or give it a floor and a posture in which it stands",
                )
            )
    return findings


def _joint_drift(
    deployment: Deployment, body: BodySimulation, tree: RobotTree, settled: Settled
) -> list[Finding]:
    mj, findings = body.model.mj, []
    change = settled.end_qpos - settled.start_qpos
    drift = change[body.model.qpos_address].tolist()
    for name, value in zip(deployment.body.joints, drift, strict=True):
        if abs(value) > _HELD_RAD:
            severity: Severity = "error" if abs(value) > _LOST_RAD else "warning"
            text = f"drifts by {value:.3f} (rad, m) from home"
            mend = "give its servo more stiffness and torque, or choose a home without contact"
            findings.append(Finding(severity, "joint_drift", f'joint "{name}"', text, mend))
    for joint in tree.passive_joint_id.tolist():
        value = float(change[mj.jnt_qposadr[joint]])
        if abs(value) > _HELD_RAD:
            name = mj.joint(joint).name or str(joint)
            text = f"has no servo and moves by {value:.3f} (rad, m) at home"
            mend = "add it to body.joints, or to body.locked"
            findings.append(Finding("warning", "passive_joint_drift", f'joint "{name}"', text, mend))
    return findings


def _energy(deployment: Deployment, body: BodySimulation, settled: Settled) -> list[Finding]:
    """Energy that grows, with the joint M whose servo (kp, kv) does most to it in a step h."""
    ratio = settled.metrics["settle.energy_ratio"]
    if ratio is None or ratio <= _MAX_ENERGY_RATIO:
        return []
    mj, model = body.model.mj, body.model
    step_s, inertia = float(mj.opt.timestep), mj.dof_M0[model.dof_address]
    stiffness = step_s**2 * mj.actuator_gainprm[model.actuator_id, 0] / inertia
    damping = -step_s * mj.actuator_biasprm[model.actuator_id, 2] / inertia
    worst = int((stiffness + damping).argmax())
    text = (
        f"the energy of all that moves grows to {ratio:.3g} times that of the start; joint "
        f'"{deployment.body.joints[worst]}" has the least inertia for its servo: kp h²/M = '
        f"{stiffness[worst]:.2g}, kv h/M = {damping[worst]:.2g}"
    )
    mend = "take a shorter body.timestep_ms, softer servos, or armature in the joints of light links"
    return [Finding("warning", "energy_grows", "body", text, mend)]


def _oscillation(deployment: Deployment, settled: Settled) -> list[Finding]:
    last, first = settled.last_speed_rad_s, settled.first_speed_rad_s
    oscillates = (
        (last > _OSCILLATION_RAD_S)
        & (settled.n_reversals >= _OSCILLATION_REVERSALS)
        & (last > _OSCILLATION_DECAY * first)
    )
    return [
        Finding(
            "warning",
            "servo_oscillates",
            f'joint "{deployment.body.joints[row]}"',
            f"swings at up to {last[row]:.2g} rad/s at the end and does not come to rest",
            "give its servo more damping or less stiffness, or take a shorter body.timestep_ms",
        )
        for row in np.flatnonzero(oscillates).tolist()
    ]


_PARTS = {
    "collision_s": ("kinematics and collisions of the model", "take coarser collision meshes, or primitives"),
    "skin_contact_s": ("contact of the skin", "take fewer cells, or fewer geoms near them"),
    "dynamics_s": (
        "dynamics of the model",
        "take a longer body.timestep_ms, or lock joints that are idle",
    ),
    "sensing_s": ("sensing of the cells", "take fewer cells, or a longer body.stimulus_period_ms"),
}


def speed_finding(cost: StepCost) -> Finding:
    """Expected speed of body and sensing on this computer, and the part that costs most."""
    whole_s = sum(cost)
    parts = sorted(cost._asdict().items(), key=lambda part: -part[1])
    shares = ", ".join(f"{_PARTS[name][0]} {100.0 * value / whole_s:.0f} %" for name, value in parts)
    text = (
        f"body and sensing run at {1.0 / whole_s:.2g} × real time on this computer, without network and "
        f"controller: {shares}"
    )
    return Finding("remark", "speed", "simulation", text, f"if that is too slow, {_PARTS[parts[0][0]][1]}")
