"""Cell kinematics as ground truth for tests and summaries: poses, Jacobian, activity matrix."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.simulation import BodySimulation
from skinnet.body.teacher import evasion

__all__ = ["activity_matrix", "cell_jacobian", "cell_poses", "set_joint_positions"]

Floats = NDArray[np.float64]


def cell_poses(simulation: BodySimulation) -> tuple[Floats, Floats]:
    """Compute cell poses at the configuration of `simulation.data`, world frame.

    Returns:
        Cell centres on the outer face of the foam (n, 3) [m], and rotations R_world_cell (n, 3, 3).
    """
    return evasion.cell_poses(simulation.data, simulation.surface, simulation.thickness_m)


def cell_jacobian(simulation: BodySimulation) -> Floats:
    """Linear Jacobian of every cell in its own frame, (n, D, 3) [m/rad].

    Component 2 of the last axis is the motion along the outward normal.
    """
    rows = np.arange(len(simulation.surface.body_id))
    return evasion.cell_jacobian(
        simulation.model, simulation.data, simulation.surface, simulation.thickness_m, rows
    )


def activity_matrix(simulation: BodySimulation) -> NDArray[np.bool_]:
    """Activity matrix (n, D), ground truth: True where a DoF moves the body of a cell [M14, (1)]."""
    mj = simulation.model.mj
    joint_body = mj.jnt_bodyid[simulation.model.joint_id]
    above = np.zeros((mj.nbody, mj.nbody), dtype=np.bool_)
    for index in range(1, mj.nbody):
        above[index] = above[mj.body_parentid[index]]
        above[index, index] = True
    moved: NDArray[np.bool_] = above[simulation.surface.body_id][:, joint_body]
    return moved


def set_joint_positions(simulation: BodySimulation, position_rad: NDArray[np.float64]) -> None:
    """Set joint positions (D,) [rad] of a body that is not being stepped, and run forward kinematics."""
    simulation.data.qpos[simulation.model.qpos_address] = position_rad
    mujoco.mj_forward(simulation.model.mj, simulation.data)
