"""Position servos of the deployment, added to a model whatever its file says about actuators."""

from pathlib import Path

import mujoco

from skinnet.body.added_elements import builtin_defaults
from skinnet.deployment.robot import BodySpec
from skinnet.errors import ModelError

__all__ = ["add_servos", "enable_servos"]

_SWAY_STIFFNESS_RATIO = 10.0
"""Stiffness ratio of sway joints, which model a balancing lower body, to the arms' servos (assumed)."""
_SERVO_GROUP = 0
_STABLE_INTEGRATORS = (
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    mujoco.mjtIntegrator.mjINT_IMPLICIT,
)
"""Integrators with implicit velocity terms, which stiff servos on light links need."""


def add_servos(spec: mujoco.MjSpec, body: BodySpec) -> None:
    """Add the servos of the controlled joints and, stiffer and without a torque limit, of the sway joints."""
    servo = body.servo
    for joint in body.joints:
        _add_servo(spec, joint, servo.kp_nm_per_rad, servo.kv_nm_s_per_rad, servo.torque_limit_nm)
    for joint in body.sway.joints:
        _add_servo(
            spec,
            joint,
            _SWAY_STIFFNESS_RATIO * servo.kp_nm_per_rad,
            _SWAY_STIFFNESS_RATIO * servo.kv_nm_s_per_rad,
        )


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


def _add_servo(
    spec: mujoco.MjSpec, joint: str, kp: float, kv: float, torque_limit_nm: float | None = None
) -> None:
    actuator = spec.add_actuator(
        builtin_defaults(spec), name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    actuator.set_to_position(kp=kp, kv=kv)
    actuator.group = _SERVO_GROUP
    unlimited = mujoco.mjtLimited.mjLIMITED_FALSE
    actuator.ctrllimited = actuator.actlimited = actuator.forcelimited = unlimited
    if torque_limit_nm is not None:
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.forcerange = [-torque_limit_nm, torque_limit_nm]
