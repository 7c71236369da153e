"""How a cell's evasion moves the joints: as a teacher expects it, until he has seen it.

A perfect sensory-motor map by equation (2) of [M14, III.B]: the weight of a DoF is the share of the cell's
normal in the motion that the DoF gives the cell, along the cell's own axes; positive weights move the cell
inwards, and a cell's weights have norm one.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import BodyModel
from skinnet.body.surface import Surface

__all__ = ["Evasion", "cell_jacobian", "cell_poses", "evading_weights"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_LEAST_NORM = 0.1
"""A cell with a shorter vector cannot move along its normal, as in the robot's own map (assumed)."""
_LEAST_LEVER_M = 1e-3
"""A DoF that gives a cell less motion than this per radian does not move it (assumed)."""
_TELLING_RAD = 0.02
"""A motion of the joints that shows how a cell evades (assumed)."""
_AT_LIMIT_RAD = 0.005
"""A joint this near to its limit goes no further."""


def cell_poses(data: mujoco.MjData, surface: Surface, thickness_m: float) -> tuple[Floats, Floats]:
    """Poses of all cells on foam of `thickness_m`, world.

    Returns:
        Middles of the cells on the face of the foam (n, 3) [m], and rotations R_world_cell (n, 3, 3).
    """
    R_world_body = data.xmat[surface.body].reshape(-1, 3, 3)
    R_world_cell = R_world_body @ surface.R_body_cell
    on_surface_m = data.xpos[surface.body] + np.einsum("nij,nj->ni", R_world_body, surface.position_m)
    return on_surface_m + thickness_m * R_world_cell[:, :, 2], R_world_cell


def cell_jacobian(
    model: BodyModel, data: mujoco.MjData, surface: Surface, thickness_m: float, rows: Indices
) -> Floats:
    """Velocity of the cells `rows` (r,) per velocity of every DoF, (r, D, 3) [m/rad], their frames.

    Column 2 of the last axis is the motion along the outward normal.
    """
    position_m, R_world_cell = cell_poses(data, surface, thickness_m)
    result = np.empty((len(rows), len(model.dof), 3))
    linear = np.empty((3, model.mj.nv))
    for index, row in enumerate(rows.tolist()):
        mujoco.mj_jac(model.mj, data, linear, None, position_m[row], int(surface.body[row]))
        result[index] = linear[:, model.dof].T @ R_world_cell[row]
    return result


def evading_weights(jacobian_m: Floats) -> Floats:
    """Perfect sensory-motor map (n, D) of cells that DoFs move by `jacobian_m` (n, D, 3), their frames.

    Rows have norm one, or zero where a cell cannot move along its normal.
    """
    total = np.abs(jacobian_m).sum(axis=2)
    shares = np.divide(-jacobian_m[:, :, 2], total, out=np.zeros(total.shape), where=total > _LEAST_LEVER_M)
    norm = np.linalg.norm(shares, axis=1, keepdims=True)
    weights: Floats = np.divide(shares, norm, out=np.zeros_like(shares), where=norm > _LEAST_NORM)
    return weights


class Evasion:
    """How each cell's evasion moves the joints: as expected until it was seen."""

    def __init__(self, model: BodyModel, data: mujoco.MjData, surface: Surface, thickness_m: float) -> None:
        """Expects a robot with a perfect map, of cells on foam of `thickness_m`."""
        self._model, self._data, self._surface, self._thickness_m = model, data, surface, thickness_m
        self._seen: dict[int, Floats] = {}

    def position_rad(self) -> Floats:
        """(D,) positions of the controlled joints [rad]."""
        position_rad: Floats = self._data.qpos[self._model.qpos]
        return position_rad

    def directions(self, rows: Indices) -> Floats:
        """(r, D) joint motion by the evasion of each of `rows` at present, of norm one, less at a limit."""
        model, data = self._model, self._data
        result = evading_weights(cell_jacobian(model, data, self._surface, self._thickness_m, rows))
        for index, row in enumerate(rows.tolist()):
            result[index] = self._seen.get(row, result[index])
        position_rad, (lowest, highest) = self.position_rad(), model.range_rad.T
        up = np.where(position_rad > highest - _AT_LIMIT_RAD, 0.0, np.inf)
        down = np.where(position_rad < lowest + _AT_LIMIT_RAD, 0.0, -np.inf)
        return np.clip(result, down, up)

    def see(self, row: int, moved_rad: Floats) -> bool:
        """Takes in the joint motion (D,) since the finger came to a cell; returns whether that tells."""
        rows = np.array([row])
        jacobian_m = cell_jacobian(self._model, self._data, self._surface, self._thickness_m, rows)[0]
        its_own_rad = np.where(jacobian_m.any(axis=1), moved_rad, 0.0)
        length_rad = float(np.linalg.norm(its_own_rad))
        if length_rad < _TELLING_RAD:
            return False
        self._seen[row] = its_own_rad / length_rad
        return True

    def forget(self, row: int) -> None:
        """A cell does not evade at all."""
        self._seen[row] = np.zeros(len(self._model.dof))
