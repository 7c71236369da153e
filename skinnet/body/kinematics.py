"""Where cells really are and how joints really move them: truth for tests and summaries, not for control."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body import evasion
from skinnet.body.simulation import Body

__all__ = ["cell_poses", "jacobian", "moved_by", "put_into"]

Floats = NDArray[np.float64]


def cell_poses(body: Body) -> tuple[Floats, Floats]:
    """Poses of all cells at the pose of `body.data`, world.

    Returns:
        Middles of the cells on the face of the foam (n, 3) [m], and rotations R_world_cell (n, 3, 3).
    """
    return evasion.cell_poses(body.data, body.surface, body.thickness_m)


def jacobian(body: Body) -> Floats:
    """Velocity of every cell per velocity of every controlled DoF, (n, D, 3) [m/rad], frames of the cells.

    Column 2 of the last axis is the motion along the outward normal.
    """
    rows = np.arange(len(body.surface.body))
    return evasion.cell_jacobian(body.model, body.data, body.surface, body.thickness_m, rows)


def moved_by(body: Body) -> NDArray[np.bool_]:
    """Does a DoF move the body that carries a cell? (n, D): the true activity matrix [M14, (1)]."""
    mj = body.model.mj
    joint_body = mj.jnt_bodyid[body.model.joint]
    above = np.zeros((mj.nbody, mj.nbody), dtype=np.bool_)
    for index in range(1, mj.nbody):
        above[index] = above[mj.body_parentid[index]]
        above[index, index] = True
    moved: NDArray[np.bool_] = above[body.surface.body][:, joint_body]
    return moved


def put_into(body: Body, position_rad: NDArray[np.float64]) -> None:
    """Puts the controlled joints of a body that does not run into a pose (D,) [rad]."""
    body.data.qpos[body.model.qpos] = position_rad
    mujoco.mj_forward(body.model.mj, body.data)
