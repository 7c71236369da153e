"""Findings on gravity, the robot's base, and joints that the exploration of the structure cannot judge."""

import math

import numpy as np

from skinnet.body.model_file import gravity_m_s2
from skinnet.body.robot_tree import RobotTree, ancestors, sine_to_gravity
from skinnet.body.simulation import BodySimulation
from skinnet.deployment import Deployment
from skinnet.diagnosis.finding import Finding, Severity, listed

__all__ = ["base_findings"]

_EARTH_M_S2 = 9.81
_MAX_TILT_RAD = math.radians(1.0)
_MAX_RELATIVE_ERROR = 0.05
"""Relative difference from the gravity of the earth, which varies by 0.5 %: beyond it units are wrong."""
_LEVEL = '<option gravity="0 0 -9.81"/>'


def base_findings(deployment: Deployment, body: BodySimulation, tree: RobotTree) -> list[Finding]:
    """Findings on gravity, base, axes along gravity and limits near home, of the body at home."""
    findings = [*_gravity(body), *_free_base(body, tree)]
    kinds = {deployment.controller.stages[name].kind for name in deployment.controller.program}
    if "structure" in kinds:
        findings += _axes_along_gravity(deployment, body)
        findings += _limits_near_home(deployment, body)
    return findings


def _gravity(body: BodySimulation) -> list[Finding]:
    acts_m_s2 = gravity_m_s2(body.model.mj)
    size_m_s2 = float(np.sqrt((acts_m_s2**2).sum()))
    if size_m_s2 < 1e-9:
        text = "the model has none, so accelerometers at rest read zero and nothing has weight"
        mend = f'set {_LEVEL} in the model, and no flag gravity="disable"'
        return [Finding("error", "gravity_zero", "gravity", text, mend)]
    tilt_rad = math.acos(min(max(-float(acts_m_s2[2]) / size_m_s2, -1.0), 1.0))
    if tilt_rad <= _MAX_TILT_RAD and abs(size_m_s2 / _EARTH_M_S2 - 1.0) <= _MAX_RELATIVE_ERROR:
        return []
    values = ", ".join(f"{value:g}" for value in acts_m_s2)
    text = f"[{values}] m/s²: {math.degrees(tilt_rad):.1f}° off −z, {size_m_s2:.3g} m/s² in size"
    mend = f"set {_LEVEL}; a robot on a wall is mounted by the pose of its base, lengths are in metres"
    return [Finding("warning", "gravity_tilted", "gravity", text, mend)]


def _free_base(body: BodySimulation, tree: RobotTree) -> list[Finding]:
    mj = body.model.mj
    return [
        Finding(
            "warning",
            "free_base",
            f'body "{mj.body(int(mj.jnt_bodyid[joint])).name}"',
            "the base of the robot is free: it falls, or moves with every motion of a joint",
            "set body.fixed_base = true, or delete the free joint from the model",
        )
        for joint in tree.free_joint_id.tolist()
    ]


def _axes_along_gravity(deployment: Deployment, body: BodySimulation) -> list[Finding]:
    """Hinges whose step tilts nothing: |Δg| ≈ step · sin β stays below the threshold of the structure.

    Joints that were explored before stay at their offset. If one of them carries the axis, and is not along
    gravity itself, the axis has left gravity by then; if none does, the structure cannot see the joint.
    """
    spec, joints = deployment.controller.structure, body.model.joint_id
    sine = sine_to_gravity(body.model.mj, body.data.xaxis[joints])
    if sine is None:
        return []
    least_sine = min(spec.threshold_g / (2.0 * math.sin(0.5 * min(spec.step_rad, math.pi))), 1.0)
    aligned = (sine < least_sine) & (np.array(body.model.joint_units) == "rad")
    unseen: list[str] = []
    tilted: list[str] = []
    for row in np.flatnonzero(aligned).tolist():
        carriers = [
            before
            for before in range(row)
            if _is_carried(body, int(joints[row]), int(joints[before])) and sine[before] >= least_sine
        ]
        (tilted if carriers else unseen).append(deployment.body.joints[row])
    within_deg = math.degrees(math.asin(least_sine))
    text = f"axis within {within_deg:.1f}° of gravity at home, so a step changes no accelerometer at rest"
    mend = "choose a body.home_rad that tilts the axis, or explore a joint that carries it first"
    findings = []
    if unseen:
        alone = f"{text}: the structure cannot see it"
        severity: Severity = "warning"
        if _is_mapped(deployment):
            alone, severity = f"{alone}, but the accelerations of the map tell it", "remark"
        findings.append(Finding(severity, "axis_along_gravity", listed(unseen), alone, mend))
    if tilted:
        later = f"{text}; it is seen only as joints explored before stay offset"
        findings.append(Finding("remark", "axis_along_gravity", listed(tilted), later, mend))
    return findings


def _is_mapped(deployment: Deployment) -> bool:
    """True if a map is explored after the structure, and completes it."""
    kinds = [deployment.controller.stages[name].kind for name in deployment.controller.program]
    return "structure" in kinds and "map" in kinds[kinds.index("structure") :]


def _is_carried(body: BodySimulation, joint: int, by: int) -> bool:
    """True if joint `by` moves the body of `joint`, from further down the chain or before it on one body."""
    mj = body.model.mj
    carrier, at = int(mj.jnt_bodyid[by]), int(mj.jnt_bodyid[joint])
    if at == carrier:
        return by < joint
    return carrier in ancestors(mj, at)


def _limits_near_home(deployment: Deployment, body: BodySimulation) -> list[Finding]:
    model, step_rad = body.model, deployment.controller.structure.step_rad
    home_rad = body.data.qpos[model.qpos_address]
    room_rad = np.column_stack([home_rad - model.range_rad[:, 0], model.range_rad[:, 1] - home_rad])
    blocked = room_rad < step_rad
    names = np.array(deployment.body.joints)
    findings = []
    for severity, which, text in (
        ("warning", blocked.all(axis=1), "no room for a step either way"),
        ("remark", blocked.any(axis=1) & ~blocked.all(axis=1), "a step in one direction meets the limit"),
    ):
        if which.any():
            findings.append(
                Finding(
                    severity,  # type: ignore[arg-type]
                    "limit_near_home",
                    listed(names[which].tolist()),
                    f"home is within {step_rad:g} rad of a limit: {text}",
                    "move body.home_rad away from the limit, or take a smaller controller.structure.step_rad",
                )
            )
    return findings
