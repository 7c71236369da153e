"""Link kinematics of a robot: forward kinematics at given joint positions, without dynamics.

Only joint feedback enters: sway, servo deflection and free bodies are left out, and uncontrolled joints stay
at home, or where equality constraints hold them.
"""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.body.model import load_model, require_body_id
from skinnet.deployment.deployment import Deployment
from skinnet.pinned_linalg import matmul

__all__ = ["WORLD_FRAME", "LinkKinematics", "LinkPoses"]

Floats = NDArray[np.float64]
WORLD_FRAME = "world"
"""Name of the world frame."""


class LinkPoses(NamedTuple):
    """Link poses, in the order of the links.

    Attributes:
        position_m: (n, 3) origins, world [m].
        R_world_link: (n, 3, 3) rotations.
        offset_m: (n, 3) origins in the frame of the parent [m].
        quaternion: (n, 4) rotations in the frame of the parent, (w, x, y, z) with w ≥ 0.
    """

    position_m: Floats
    R_world_link: Floats
    offset_m: Floats
    quaternion: Floats


class LinkKinematics:
    """Links of a robot and of fixtures in the world, parents before children.

    Attributes:
        names: Name of each link.
        parent_index: Index of each link's parent, −1 for the world.
        has_controlled_joint: (n,) True where a controlled joint moves the link relative to its parent.
    """

    def __init__(self, deployment: Deployment, base_dir: Path) -> None:
        """Compile the model of `deployment`.

        Raises:
            ModelError: the model does not compile or lacks what the deployment names.
            DeploymentError: there is no such model.
        """
        self._model = load_model(deployment, base_dir, with_environment=False)
        mj = self._model.mj
        self._data = mujoco.MjData(mj)
        self._data.qpos[:] = self._model.home_qpos
        moved = {int(body) for body in mj.jnt_bodyid[self._model.joint_id]}
        named = {deployment.body.reference_body, *(patch.body for patch in deployment.patches)}
        named |= {surface.body for surface in deployment.surfaces}
        robot = moved | {require_body_id(mj, name, "body", deployment.body.model) for name in named}
        self._body_id = [body for body in range(1, mj.nbody) if self._is_robot_or_fixture(body, robot)]
        number = {body: i for i, body in enumerate(self._body_id)}
        self.names = [mj.body(body).name or f"body{body}" for body in self._body_id]
        self.parent_index = [number.get(int(mj.body_parentid[body]), -1) for body in self._body_id]
        self.has_controlled_joint = np.array([body in moved for body in self._body_id])

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""
        return len(self._model.joint_id)

    def poses(self, position_rad: ArrayLike) -> LinkPoses:
        """Compute link poses at the positions (D,) [rad] of the controlled joints."""
        data = self._data
        data.qpos[self._model.qpos_address] = np.asarray(position_rad, dtype=np.float64)
        self._model.follow(data.qpos)
        mujoco.mj_kinematics(self._model.mj, data)
        position_m = data.xpos[self._body_id].copy()
        rotation = data.xmat[self._body_id].reshape(-1, 3, 3).copy()
        # the world's pose is appended after the last link, where index −1 finds it
        above_m = np.vstack([position_m, np.zeros((1, 3))])[self.parent_index]
        R_world_parent = np.concatenate([rotation, np.eye(3)[None]])[self.parent_index]
        R_parent_world = R_world_parent.transpose(0, 2, 1)
        offset_m = np.einsum("nij,nj->ni", R_parent_world, position_m - above_m)
        return LinkPoses(position_m, rotation, offset_m, _quaternions(matmul(R_parent_world, rotation)))

    def _is_robot_or_fixture(self, body: int, robot: set[int]) -> bool:
        """Test that a body belongs to the robot or is fixed in the world, not a free or mocap body."""
        mj = self._model.mj
        root = int(mj.body_rootid[body])
        tree = [b for b in range(1, mj.nbody) if mj.body_rootid[b] == root]
        if robot.intersection(tree):
            return True
        return mj.body_mocapid[root] < 0 and not any(mj.body_jntnum[b] for b in tree)


def _quaternions(rotation: Floats) -> Floats:
    """Convert rotation matrices (n, 3, 3) to quaternions (n, 4), (w, x, y, z) with w ≥ 0."""
    found = np.empty((len(rotation), 4))
    for quaternion, matrix in zip(found, rotation, strict=True):
        mujoco.mju_mat2Quat(quaternion, matrix.ravel())
    found[found[:, 0] < 0.0] *= -1.0
    return found
