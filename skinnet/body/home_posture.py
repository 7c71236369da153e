"""Home posture of a robot: reference position of its model, `body.home_rad`, and joints that follow."""

import math
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.joint_motion import close_equalities
from skinnet.body.model_file import ONE_DOF
from skinnet.deployment.robot import BodySpec
from skinnet.errors import DeploymentError, ModelError

__all__ = ["MAX_GAP", "home_posture"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
MAX_GAP = 1e-4
"""Largest residual of equality constraints, joints that follow or close loops, at home [m, rad]."""


def home_posture(mj: mujoco.MjModel, body: BodySpec, path: Path, held: Indices) -> Floats:
    """Configuration (nq,) at the start of a run.

    Joints stand where `body.home_rad` says, else at the reference position of the model (`qpos0`); those
    without a servo then follow equality constraints, so that mimic joints and closed loops are right.

    Args:
        mj: The compiled model.
        body: The body of the deployment.
        path: File of the model, for errors.
        held: DoFs with a servo, which stay.

    Raises:
        ModelError: a joint is missing, or no posture of the others meets the constraints.
        DeploymentError: a position is beyond the limits of its joint.
    """
    home: Floats = mj.qpos0.copy()
    for name, position in body.home_rad.items():
        index = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_JOINT, name)
        if index < 0 or mujoco.mjtJoint(mj.jnt_type[index]) not in ONE_DOF:
            raise ModelError(f'body.home_rad: {path} has no hinge or slide joint "{name}" that can move')
        lower, upper = mj.jnt_range[index] if mj.jnt_limited[index] else (-math.inf, math.inf)
        if not lower <= position <= upper:
            slides = mj.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE
            moves, unit = ("slides", "m") if slides else ("turns", "rad")
            raise DeploymentError(
                f"body.home_rad.{name} = {position}: the joint {moves} from {lower:g} to {upper:g} {unit}"
            )
        home[mj.jnt_qposadr[index]] = position
    gap = close_equalities(mj, home, held)
    if gap > MAX_GAP:
        raise ModelError(
            f"body.home_rad: no posture of the joints without a servo meets the equality constraints of "
            f"{path}: {gap:.2g} m or rad remain; give controlled joints another home"
        )
    return home
