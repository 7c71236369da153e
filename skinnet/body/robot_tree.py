"""Kinematic tree of the robot in its model: its bodies and joints, apart from objects and furniture."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model_file import ONE_DOF
from skinnet.body.simulation import BodySimulation

__all__ = ["RobotTree", "gravity_m_s2", "robot_tree"]

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class RobotTree:
    """Bodies and joints of the robot: of all trees with a controlled joint, or with skin.

    Attributes:
        body_id: (b,) ids of its bodies, ascending.
        free_joint_id: (f,) ids of its free joints, which carry a base.
        passive_joint_id: (u,) ids of its hinge and slide joints without a servo.
    """

    body_id: Indices
    free_joint_id: Indices
    passive_joint_id: Indices


def robot_tree(body: BodySimulation) -> RobotTree:
    """Robot tree of a simulation."""
    mj, model = body.model.mj, body.model
    servos = np.concatenate([model.actuator_id, model.sway_actuator_id])
    own = mj.jnt_bodyid[mj.actuator_trnid[servos, 0]]
    roots = np.setdiff1d(mj.body_rootid[np.concatenate([own, body.surface.patch_body_id])], [0])
    bodies = np.flatnonzero(np.isin(mj.body_rootid, roots))
    joints = np.flatnonzero(np.isin(mj.jnt_bodyid, bodies))
    kind = mj.jnt_type[joints]
    moved = mj.actuator_trnid[mj.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT, 0]
    coupled = mj.eq_obj1id[mj.eq_type == mujoco.mjtEq.mjEQ_JOINT]
    return RobotTree(
        body_id=bodies,
        free_joint_id=joints[kind == mujoco.mjtJoint.mjJNT_FREE],
        passive_joint_id=joints[np.isin(kind, ONE_DOF) & ~np.isin(joints, [*moved, *coupled])],
    )


def gravity_m_s2(mj: mujoco.MjModel) -> NDArray[np.float64]:
    """Gravity (3,) [m/s²] that acts in a model, world; zero if a flag of the model switches it off."""
    if mj.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        return np.zeros(3)
    acts: NDArray[np.float64] = mj.opt.gravity.copy()
    return acts
