"""Forward kinematics and Jacobians of surface points on the controller's own model of the robot.

The model may differ from the simulated body by joint offsets and link displacements (calibration errors).
This module has no access to the body's state.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import skinnet.mujoco_loading  # noqa: F401 -- before MuJoCo, which may lack its renderer
from skinnet.pinned_linalg import matmul

# isort: split
import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ModelError
from skinnet.random_streams import StreamName, generator

__all__ = ["Kinematics", "MjModel", "ModelErrors", "Poses", "SurfacePoint", "draw_model_errors"]

Floats = NDArray[np.float64]
MjModel: TypeAlias = mujoco.MjModel
_ONE_DOF_JOINTS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


class SurfacePoint(NamedTuple):
    """Surface point with its frame, fixed to a body of the model."""

    body: str
    position_m: Floats
    """Position (3,), body frame [m]."""
    R_body_surface: Floats
    """Surface frame (3, 3) in the body frame."""


class Poses(NamedTuple):
    """Poses of C surface points, world frame, and their Jacobians for N joints."""

    position_m: Floats
    """Positions (C, 3), T_x of equation (2) [R11] [m]."""
    R_world_surface: Floats
    """Rotations (C, 3, 3), T_R of equation (2) [R11]."""
    J_x: Floats
    """Translational Jacobians (C, 3, N), equation (14) [m/rad, m/m for a slide]."""
    J_w: Floats
    """Rotational Jacobians (C, 3, N) [rad/rad]."""


@dataclass(frozen=True)
class ModelErrors:
    """Kinematic errors of the controller's model: joint offsets and link displacements."""

    joint_offset_rad: Mapping[str, float] = field(default_factory=dict)
    """Offset added to a joint's measured position to get the model's joint angle, by joint [rad]."""
    link_offset_m: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """Displacement of a body relative to its parent, parent frame, by body [m]."""


class Kinematics:
    """Forward kinematics and Jacobians of the controlled joints, in their order.

    Other joints of the model stay at `home_qpos`.
    """

    def __init__(
        self,
        mj: MjModel,
        joints: Sequence[str],
        errors: ModelErrors | None = None,
        home_qpos: Floats | None = None,
    ) -> None:
        """Copy `mj` and apply the errors.

        Args:
            mj: Compiled model of the robot; not modified.
            joints: Names of N hinge or slide joints, the columns of all Jacobians.
            errors: Errors of the copy relative to `mj`.
            home_qpos: (nq,) configuration of the other joints; `qpos0` by default.

        Raises:
            ModelError: a joint or a body is unknown, a joint is neither hinge nor slide, or is named twice.
        """
        errors = errors or ModelErrors()
        self.joints = tuple(joints)
        ids = [_joint(mj, name) for name in self.joints]
        if len(set(ids)) != len(ids):
            raise ModelError(f"joints {', '.join(self.joints)}: duplicate joint; name each once")
        self.mj = copy.copy(mj)
        for name, offset_m in errors.link_offset_m.items():
            self.mj.body_pos[_body(mj, name)] += offset_m
        if unknown := [name for name in errors.joint_offset_rad if name not in self.joints]:
            raise ModelError(
                f"joint offset of {unknown[0]}: unknown joint; allowed are {', '.join(self.joints)}"
            )
        self._offset = np.array([errors.joint_offset_rad.get(name, 0.0) for name in self.joints])
        limited = mj.jnt_limited[ids].astype(bool)[:, None]
        self.joint_range: Floats = (
            np.where(limited, mj.jnt_range[ids], [-np.inf, np.inf]) - self._offset[:, None]
        )
        """Joint range (N, 2) of measured positions, infinite without limit [rad, m for a slide]."""
        self.dofs: NDArray[np.int64] = mj.jnt_dofadr[ids].astype(np.int64)
        """Degree-of-freedom indices (N,) of the joints in the model."""
        self._qpos = mj.jnt_qposadr[ids]
        self._home_qpos: Floats = (mj.qpos0 if home_qpos is None else home_qpos).copy()
        self._bodies = {mj.body(i).name: i for i in range(1, mj.nbody) if mj.body(i).name}
        self._data = mujoco.MjData(self.mj)

    def __len__(self) -> int:
        """Number of joints N."""
        return len(self.joints)

    def has_body(self, body: str) -> bool:
        """Return True if the model has a body of this name."""
        return body in self._bodies

    def moved_bodies(self) -> tuple[str, ...]:
        """Return the names of all bodies that the controlled joints move, parents first."""
        moved = np.zeros(self.mj.nbody, dtype=np.bool_)
        moved[self.mj.dof_bodyid[self.dofs]] = True
        for index in range(1, self.mj.nbody):
            moved[index] |= moved[self.mj.body_parentid[index]]
        return tuple(name for name, index in self._bodies.items() if moved[index])

    def full_qpos(self, q: Floats) -> Floats:
        """Return the model configuration (nq,) at measured positions `q` (N,), other joints at home."""
        qpos = self._home_qpos.copy()
        qpos[self._qpos] = q + self._offset
        return qpos

    def surface_poses(self, q: Floats, points: Sequence[SurfacePoint]) -> Poses:
        """Compute poses and Jacobians of `points` at measured joint positions `q` (N,) [rad].

        Raises:
            ModelError: a point is on a body that the model does not have.
        """
        data, n, count = self._data, len(self), len(points)
        data.qpos[:] = self.full_qpos(q)
        mujoco.mj_kinematics(self.mj, data)
        mujoco.mj_comPos(self.mj, data)
        result = Poses(
            np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3, n)), np.empty((count, 3, n))
        )
        linear, angular = np.empty((3, self.mj.nv)), np.empty((3, self.mj.nv))
        for c, point in enumerate(points):
            body = _body(self.mj, point.body)
            R_world_body = data.xmat[body].reshape(3, 3)
            position_m = data.xpos[body] + matmul(R_world_body, point.position_m)
            mujoco.mj_jac(self.mj, data, linear, angular, position_m, body)
            result.position_m[c] = position_m
            result.R_world_surface[c] = matmul(R_world_body, point.R_body_surface)
            result.J_x[c], result.J_w[c] = linear[:, self.dofs], angular[:, self.dofs]
        return result


def draw_model_errors(
    seed: int, kinematics: Kinematics, sigma_joint_rad: float, sigma_link_m: float
) -> ModelErrors:
    """Draw normally distributed errors of every controlled joint and every body moved, along each axis.

    Each joint and body has a random stream of its own name, so that adding one does not shift the others.
    """

    def offset_m(body: str) -> tuple[float, float, float]:
        x, y, z = (
            sigma_link_m
            * generator(seed, StreamName.MODEL_ERROR, StreamName.MODEL_ERROR_LINK, body).standard_normal(3)
        ).tolist()
        return x, y, z

    return ModelErrors(
        {
            name: sigma_joint_rad
            * float(
                generator(seed, StreamName.MODEL_ERROR, StreamName.MODEL_ERROR_JOINT, name).standard_normal()
            )
            for name in kinematics.joints
        },
        {name: offset_m(name) for name in kinematics.moved_bodies()},
    )


def _joint(mj: MjModel, name: str) -> int:
    index = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_JOINT, name)
    if index < 0 or mujoco.mjtJoint(mj.jnt_type[index]) not in _ONE_DOF_JOINTS:
        raise ModelError(f'joint "{name}": the controller\'s model has no hinge or slide joint of this name')
    return int(index)


def _body(mj: MjModel, name: str) -> int:
    index = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        raise ModelError(f'body "{name}": the controller\'s model has no body of this name')
    return int(index)
