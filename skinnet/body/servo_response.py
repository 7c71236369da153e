"""Response of the servos at home: frequency, damping ratio and sag per joint, by linear dynamics."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.actuation import Actuation
from skinnet.body.joint_motion import felt_damping, felt_inertia
from skinnet.body.model import BodyModel
from skinnet.body.model_file import ONE_DOF
from skinnet.pinned_linalg import matmul, norm

__all__ = ["MAX_SAG_HOME", "MAX_SAG_PUSHED", "MIN_FREQUENCY_HZ", "ServoResponse", "servo_response"]

Floats = NDArray[np.float64]

MIN_FREQUENCY_HZ = 8.0
"""Least frequency of a servo: the map's sine of 4 Hz then reaches the joint with little lag."""
MAX_SAG_HOME = 1e-3
"""Largest sag of a servo at home [rad, m]."""
MAX_SAG_PUSHED = 20e-3
"""Largest deflection of a servo by 10 N on its link [rad, m]."""
_PUSH_N = 10.0
"""Force on a link that tells how far its servo gives way [N]."""


@dataclass(frozen=True)
class ServoResponse:
    """Response of the servos of the controlled joints at home, each while the others hold theirs.

    Of slide joints angles are positions in m and torques forces in N.

    Attributes:
        joints: (D) their names.
        units: (D) units of their positions, "rad" or "m".
        frequency_hz: (D,) undamped natural frequency √(k/M) / 2π of the closed loop.
        damping_ratio: (D,) its damping ratio, the joint's own damping included.
        load_nm: (D,) load of gravity and springs at home, which the servo carries.
        sag_home_rad: (D,) distance from home at which the servo comes to rest; infinite if the load is beyond
            its torque.
        sag_pushed_rad: (D,) deflection by 10 N on the link that the joint moves, where and in the direction
            in which it is largest; infinite if that is beyond its torque.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    frequency_hz: Floats
    damping_ratio: Floats
    load_nm: Floats
    sag_home_rad: Floats
    sag_pushed_rad: Floats


def servo_response(model: BodyModel, *, is_compensated: bool) -> ServoResponse:
    """Compute the response of the servos of `model`; `is_compensated`: the load is fed forward.

    The stiffness k is that of the servo, and of the joint's spring unless its force is fed forward; the
    inertia M is that along the motion of the model per joint (`joint_motion`), followers included.
    """
    mj, motion, (kp, kv) = model.mj, model.joint_motion, model.gains
    data = mujoco.MjData(mj)
    data.qpos[:] = model.home_qpos
    mujoco.mj_forward(mj, data)
    inertia, stiffness = felt_inertia(mj, data, motion), kp.copy()
    if not is_compensated:
        stiffness += matmul(motion * motion, _spring_stiffness(mj))
    omega_rad_s = np.sqrt(stiffness / inertia)
    actuation = Actuation(model, data, is_compensated)
    actuation.compensate()
    load_nm = matmul(motion, data.qfrc_bias - data.qfrc_spring - data.qfrc_gravcomp)
    asked_nm = kp * (data.ctrl[model.actuator_id] - data.qpos[model.qpos_address])
    low_nm, high_nm = model.torque_range_nm.T
    missing_nm = np.abs(load_nm - np.clip(asked_nm, low_nm, high_nm))
    can_hold = (low_nm <= load_nm) & (load_nm <= high_nm)
    pushed_nm = _PUSH_N * np.array([_lever(mj, data, joint) for joint in model.joint_id.tolist()])
    can_resist = (low_nm <= load_nm - pushed_nm) & (load_nm + pushed_nm <= high_nm)
    return ServoResponse(
        joints=tuple(mj.joint(joint).name for joint in model.joint_id.tolist()),
        units=model.joint_units,
        frequency_hz=omega_rad_s / (2.0 * np.pi),
        damping_ratio=(kv + felt_damping(mj, motion)) / (2.0 * omega_rad_s * inertia),
        load_nm=load_nm,
        sag_home_rad=np.where(can_hold, missing_nm / stiffness, np.inf),
        sag_pushed_rad=np.where(can_resist, pushed_nm / stiffness, np.inf),
    )


def _spring_stiffness(mj: mujoco.MjModel) -> Floats:
    """Linear stiffness (nv,) of the springs of hinge and slide joints [Nm/rad, N/m]."""
    one_dof = np.isin(mj.jnt_type, ONE_DOF)
    stiffness = np.zeros(mj.nv)
    stiffness[mj.jnt_dofadr[one_dof]] = mj.jnt_stiffness.reshape(mj.njnt, -1)[one_dof, 0]
    return stiffness


def _lever(mj: mujoco.MjModel, data: mujoco.MjData, joint: int) -> float:
    """Largest torque per force [m] of a force on the link of a hinge; 1 for a slide joint.

    The link is the body with all that is welded to it; its points are the corners of the boxes around its
    geoms.
    """
    if mj.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
        return 1.0
    axis, anchor_m, lever_m = data.xaxis[joint], data.xanchor[joint], 0.0
    on_link = mj.body_weldid[mj.geom_bodyid] == mj.body_weldid[mj.jnt_bodyid[joint]]
    for geom in np.flatnonzero(on_link).tolist():
        centre_m, half_m = mj.geom_aabb[geom, :3], mj.geom_aabb[geom, 3:]
        for signs in np.ndindex(2, 2, 2):
            corner_m = centre_m + (2.0 * np.array(signs) - 1.0) * half_m
            R_world_geom = data.geom_xmat[geom].reshape(3, 3)
            arm_m = data.geom_xpos[geom] + matmul(R_world_geom, corner_m) - anchor_m
            lever_m = max(lever_m, norm(np.cross(axis, arm_m)))
    return lever_m
