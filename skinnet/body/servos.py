"""Position servos of the deployment, added to a model whatever its file says about actuators."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import builtin_defaults
from skinnet.body.joint_motion import felt_damping, felt_inertia, joint_motion
from skinnet.deployment.robot import BodySpec
from skinnet.deployment.servo import ServoSpec
from skinnet.errors import ModelError
from skinnet.pinned_linalg import matmul

__all__ = ["ServoGains", "add_servos", "enable_servos", "equilibrium_targets_rad", "tune_servos"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_SWAY_STIFFNESS_RATIO = 10.0
"""Stiffness ratio of sway joints, which model a balancing lower body, to the arms' servos (assumed)."""
_SERVO_GROUP = 0
_STABLE_INTEGRATORS = (
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    mujoco.mjtIntegrator.mjINT_IMPLICIT,
)
"""Integrators with implicit velocity terms, which stiff servos on light links need."""


class ServoGains(NamedTuple):
    """Gains of servos; slide joints use m where a name says rad, N where it says Nm.

    Attributes:
        kp_nm_per_rad: (k,) position gains.
        kv_nm_s_per_rad: (k,) velocity gains.
    """

    kp_nm_per_rad: Floats
    kv_nm_s_per_rad: Floats


def add_servos(spec: mujoco.MjSpec, body: BodySpec) -> None:
    """Add the servos of the controlled joints and, without a torque limit, of the sway joints.

    Their gains are set by `tune_servos` in the compiled model.
    """
    for joint in body.joints:
        _add_servo(spec, joint, body.servo_of(joint).torque_limit_nm)
    for joint in body.sway.joints:
        _add_servo(spec, joint)


def tune_servos(
    mj: mujoco.MjModel, body: BodySpec, home_qpos: Floats, dofs: Indices
) -> tuple[Floats, ServoGains]:
    """Set the gains of all servos of the compiled model `mj`.

    By frequency: kp = (2πf)² M, kv = 2 ζ 2πf M less the damping of the joint itself, at least 0, with the
    inertia M that the joint feels at home while all other servos hold their joints.

    Args:
        mj: The model.
        body: The body of the deployment.
        home_qpos: (nq,) home posture.
        dofs: (D + W,) DoFs of the servos, those of the controlled joints first, then of the sway joints.

    Returns:
        Motion (D + W, nv) of the model per servo at home (`joint_motion`), and the gains (D,) of the
        controlled joints.
    """
    data = mujoco.MjData(mj)
    data.qpos[:] = home_qpos
    mujoco.mj_fwdPosition(mj, data)
    motion = joint_motion(mj, home_qpos, dofs)
    inertia = felt_inertia(mj, data, motion)
    damping = felt_damping(mj, motion)
    n = len(body.joints)
    gains = _gains([body.servo_of(name) for name in body.joints], inertia[:n], damping[:n])
    of_sway = _gains([body.servo] * len(body.sway.joints), inertia[n:], damping[n:])
    _set_gains(mj, body.joints, gains)
    _set_gains(mj, body.sway.joints, ServoGains(*(_SWAY_STIFFNESS_RATIO * gain for gain in of_sway)))
    return motion, gains


def equilibrium_targets_rad(data: mujoco.MjData, actuator_id: Indices, motion: Floats) -> Floats:
    """Compute gravity-compensating targets (k,) [rad]: the servos `actuator_id` hold the present pose.

    Args:
        data: MuJoCo's state, after `mj_forward`.
        actuator_id: (k,) ids of the servos.
        motion: (k, nv) velocities of all DoFs at unit velocity of each servo's joint (`joint_motion`).
    """
    mj = data.model
    joint = mj.actuator_trnid[actuator_id, 0]
    load_nm = data.qfrc_bias - data.qfrc_passive
    by_actuators = mj.jnt_actgravcomp[mj.dof_jntid].astype(bool)  # else compensation is a passive force
    load_nm -= np.where(by_actuators, data.qfrc_gravcomp, 0.0)
    lag_rad = matmul(motion, load_nm) / mj.actuator_gainprm[actuator_id, 0]
    targets: Floats = data.qpos[mj.jnt_qposadr[joint]] + lag_rad
    return targets


def _gains(servos: Sequence[ServoSpec], inertia: Floats, joint_damping: Floats) -> ServoGains:
    """Gains of `servos` (k) on joints of `inertia` [kg·m², kg] and `joint_damping` [Nm·s/rad, N·s/m]."""
    kp, kv = np.empty(len(servos)), np.empty(len(servos))
    for i, servo in enumerate(servos):
        if servo.frequency_hz is None:
            assert servo.kp_nm_per_rad is not None
            assert servo.kv_nm_s_per_rad is not None
            kp[i], kv[i] = servo.kp_nm_per_rad, servo.kv_nm_s_per_rad
        else:
            assert servo.damping is not None
            omega_rad_s = 2.0 * math.pi * servo.frequency_hz
            kp[i] = omega_rad_s * omega_rad_s * inertia[i]
            kv[i] = max(2.0 * servo.damping * omega_rad_s * inertia[i] - joint_damping[i], 0.0)
    return ServoGains(kp, kv)


def _set_gains(mj: mujoco.MjModel, joints: Sequence[str], gains: ServoGains) -> None:
    for i, joint in enumerate(joints):
        actuator = mj.actuator(joint).id
        mj.actuator_gainprm[actuator, 0] = gains.kp_nm_per_rad[i]
        mj.actuator_biasprm[actuator, 1] = -gains.kp_nm_per_rad[i]
        mj.actuator_biasprm[actuator, 2] = -gains.kv_nm_s_per_rad[i]


def enable_servos(spec: mujoco.MjSpec, path: Path) -> list[str]:
    """Set the options that servos need; list those of the file that this overrides, one a line.

    The integrator of the file stays if it treats velocities implicitly. Euler, MuJoCo's default, is replaced
    without a line.

    Raises:
        ModelError: the file has a flex and asks for the discrete integrator, which its elasticity may need.
    """
    option, left_out = spec.option, []
    if option.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE and spec.flexes:
        raise ModelError(
            f'{path}: flex {spec.flexes[0].name}: integrator="discrete" is not available; use '
            "implicitfast, and an elasticity that does not need it"
        )
    if option.integrator not in _STABLE_INTEGRATORS:
        if option.integrator != mujoco.mjtIntegrator.mjINT_EULER:
            name = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_")
            left_out.append(f'option integrator="{name}": servos need implicit velocity terms (implicitfast)')
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    if option.disableactuator & (1 << _SERVO_GROUP):
        left_out.append(f"option actuatorgroupdisable: group {_SERVO_GROUP} is that of the servos")
    option.disableactuator = 0  # no other actuators are left
    if option.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        left_out.append('option flag actuation="disable": it would switch off the servos')
        option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    # MuJoCo must not reset an unstable step
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return left_out


def _add_servo(spec: mujoco.MjSpec, joint: str, torque_limit_nm: float | None = None) -> None:
    actuator = spec.add_actuator(
        builtin_defaults(spec), name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    actuator.set_to_position(kp=1.0, kv=0.0)
    actuator.group = _SERVO_GROUP
    unlimited = mujoco.mjtLimited.mjLIMITED_FALSE
    actuator.ctrllimited = actuator.actlimited = actuator.forcelimited = unlimited
    if torque_limit_nm is not None:
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.forcerange = [-torque_limit_nm, torque_limit_nm]
