"""Cell kinematics as ground truth: poses, Jacobian and activity matrix of the cells of a body."""

from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.body.ground_truth.joint_following import followed_motion, settle_followers
from skinnet.body.model import BodyModel
from skinnet.pinned_linalg import matmul

__all__ = [
    "MovingSkin",
    "SkinState",
    "activity_matrix",
    "cell_jacobian",
    "cell_poses",
    "set_joint_positions",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MIN_MOTION = 1e-6
"""Motion of a following joint per motion of a controlled one above which it counts as moved."""


class SkinState(Protocol):
    """Skin on a body in its present configuration (protocol), a simulation for instance."""

    @property
    def model(self) -> BodyModel:
        """The robot model."""

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state."""

    @property
    def surface(self) -> SkinSurface:
        """All cells, on the bodies that carry them."""

    @property
    def thickness_m(self) -> float:
        """Thickness of the foam under the cells [m]."""


class MovingSkin(NamedTuple):
    """Skin on a moving body, without its simulation; attributes as in `SkinState`."""

    model: BodyModel
    data: mujoco.MjData
    surface: SkinSurface
    thickness_m: float


def cell_poses(skin: SkinState) -> tuple[Floats, Floats]:
    """Compute cell poses at the present configuration, world frame.

    Returns:
        Cell centres on the outer face of the foam (n, 3) [m], and rotations R_world_cell (n, 3, 3).
    """
    data, surface = skin.data, skin.surface
    R_world_body = data.xmat[surface.body_id].reshape(-1, 3, 3)
    R_world_cell = matmul(R_world_body, surface.R_body_cell)
    on_surface_m = data.xpos[surface.body_id] + np.einsum("nij,nj->ni", R_world_body, surface.position_m)
    return on_surface_m + skin.thickness_m * R_world_cell[:, :, 2], R_world_cell


def cell_jacobian(skin: SkinState, rows: Indices | None = None) -> Floats:
    """Linear Jacobian of the cells `rows` (r,) in their own frames, (r, D, 3) [m/rad]; None: of all cells.

    Component 2 of the last axis is the motion along the outward normal. Joints that follow a controlled one
    by an equality constraint belong to it.
    """
    model, body_id = skin.model, skin.surface.body_id
    position_m, R_world_cell = cell_poses(skin)
    wanted = range(len(body_id)) if rows is None else rows.tolist()
    result = np.empty((len(wanted), len(model.dof_address), 3))
    linear = np.empty((3, model.mj.nv))
    motion = followed_motion(model.mj, skin.data, model.dof_address) if model.mj.neq else None
    for index, row in enumerate(wanted):
        mujoco.mj_jac(model.mj, skin.data, linear, None, position_m[row], int(body_id[row]))
        by_dof = linear[:, model.dof_address] if motion is None else matmul(linear, motion)
        result[index] = matmul(by_dof.T, R_world_cell[row])
    return result


def activity_matrix(skin: SkinState) -> NDArray[np.bool_]:
    """Activity matrix (n, D), ground truth: True where a DoF moves the body of a cell [M14, (1)].

    Joints that follow a controlled one by an equality constraint belong to it.
    """
    mj = skin.model.mj
    above = np.zeros((mj.nbody, mj.nbody), dtype=np.bool_)
    for index in range(1, mj.nbody):
        above[index] = above[mj.body_parentid[index]]
        above[index, index] = True
    carried = above[skin.surface.body_id][:, mj.dof_bodyid]
    moving = np.abs(followed_motion(mj, skin.data, skin.model.dof_address)) > _MIN_MOTION
    moved: NDArray[np.bool_] = np.logical_or.reduce(carried[:, :, None] & moving, axis=1)
    return moved


def set_joint_positions(skin: SkinState, position_rad: Floats) -> None:
    """Set joint positions (D,) [rad] of a body that is not being stepped, and run forward kinematics."""
    skin.data.qpos[skin.model.qpos_address] = position_rad
    settle_followers(skin.model.mj, skin.data, skin.model.dof_address)
