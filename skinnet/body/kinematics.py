"""Cell kinematics as ground truth for tests and summaries: poses, Jacobian, activity matrix."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body import evasion
from skinnet.body.simulation import Body

__all__ = ["cell_poses", "jacobian", "moved_by", "put_into"]

Floats = NDArray[np.float64]


def cell_poses(body: Body) -> tuple[Floats, Floats]:
    """Compute cell poses at the configuration of `body.data`, world frame.

    Returns:
        Cell centres on the outer face of the foam (n, 3) [m], and rotations R_world_cell (n, 3, 3).
    """
    return evasion.cell_poses(body.data, body.surface, body.thickness_m)


def jacobian(body: Body) -> Floats:
    """Linear Jacobian of every cell in its own frame, (n, D, 3) [m/rad].

    Component 2 of the last axis is the motion along the outward normal.
    """
    rows = np.arange(len(body.surface.body))
    return evasion.cell_jacobian(body.model, body.data, body.surface, body.thickness_m, rows)


def moved_by(body: Body) -> NDArray[np.bool_]:
    """Activity matrix (n, D), ground truth: True where a DoF moves the body of a cell [M14, (1)]."""
    mj = body.model.mj
    joint_body = mj.jnt_bodyid[body.model.joint]
    above = np.zeros((mj.nbody, mj.nbody), dtype=np.bool_)
    for index in range(1, mj.nbody):
        above[index] = above[mj.body_parentid[index]]
        above[index, index] = True
    moved: NDArray[np.bool_] = above[body.surface.body][:, joint_body]
    return moved


def put_into(body: Body, position_rad: NDArray[np.float64]) -> None:
    """Set joint positions (D,) [rad] of a body that is not being stepped, and run forward kinematics."""
    body.data.qpos[body.model.qpos] = position_rad
    mujoco.mj_forward(body.model.mj, body.data)
