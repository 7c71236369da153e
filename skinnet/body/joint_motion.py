"""Motion of a model per controlled joint: followers of equality constraints move with it, all others rest.

Mimic joints, coupled tendons and closed loops are equality constraints of a model. With g the velocity of all
DoFs at unit velocity of one controlled joint, the joint feels the inertia gᵀ M g and the load gᵀ f.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import dot, matmul, symmetric_eigen

__all__ = ["close_equalities", "felt_damping", "felt_inertia", "joint_motion"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_EQUALITIES = (
    mujoco.mjtEq.mjEQ_CONNECT,
    mujoco.mjtEq.mjEQ_WELD,
    mujoco.mjtEq.mjEQ_JOINT,
    mujoco.mjtEq.mjEQ_TENDON,
)
_RANK = 1e-10
"""Eigenvalues below this part of the largest count as zero: redundant rows of a closed loop."""
_FOLLOWS = 1e-6
"""Largest speed that a constraint may keep, of that of the joint, for the joint to be able to move."""
_MAX_NEWTON_STEPS = 50
_CLOSED = 1e-9
"""Residual of all equality constraints [m, rad] at which a posture meets them."""


def joint_motion(mj: mujoco.MjModel, qpos: Floats, dof: Indices) -> Floats:
    """Velocities (k, nv) of all DoFs at unit velocity of each DoF in `dof` (k,), those with a servo.

    The others of `dof` rest. Of the DoFs without a servo only those move that equality constraints carry
    along, as little as these allow. A joint that the others block moves alone.

    Args:
        mj: The model.
        qpos: (nq,) its configuration.
        dof: All DoFs with a servo.
    """
    motion = np.zeros((len(dof), mj.nv))
    motion[np.arange(len(dof)), dof] = 1.0
    free = np.setdiff1d(np.arange(mj.nv), dof)
    if not mj.neq or not len(free):
        return motion
    jacobian, _ = _equality_rows(mj, mujoco.MjData(mj), qpos)
    follow = _least_norm(jacobian[:, free], -jacobian[:, dof])
    kept = np.abs(matmul(jacobian[:, free], follow) + jacobian[:, dof]).max(axis=0, initial=0.0)
    followed = np.flatnonzero(kept <= _FOLLOWS)
    motion[np.ix_(followed, free)] = follow[:, followed].T
    return motion


def felt_inertia(mj: mujoco.MjModel, data: mujoco.MjData, motion: Floats) -> Floats:
    """Inertia gᵀ M g (k,) [kg·m², kg] along each row g of `motion` (k, nv), after `mj_fwdPosition`."""
    momentum, inertia = np.empty(mj.nv), np.empty(len(motion))
    for i, velocity in enumerate(motion):
        mujoco.mj_mulM(mj, data, momentum, velocity)
        inertia[i] = dot(velocity, momentum)
    return inertia


def felt_damping(mj: mujoco.MjModel, motion: Floats) -> Floats:
    """Linear viscous damping (k,) [Nm·s/rad, N·s/m] of the joints along each row of `motion` (k, nv)."""
    return matmul(motion * motion, mj.dof_damping.reshape(mj.nv, -1)[:, 0])


def close_equalities(mj: mujoco.MjModel, qpos: Floats, held: Indices) -> float:
    """Move `qpos` (nq,), in place, to where all equality constraints are met; the DoFs `held` stay.

    Newton's method, each step of least norm.

    Returns:
        The largest residual that is left [m, rad].
    """
    if not mj.neq:
        return 0.0
    data = mujoco.MjData(mj)
    free = np.setdiff1d(np.arange(mj.nv), held)
    residual = 0.0
    for _ in range(_MAX_NEWTON_STEPS):
        jacobian, error = _equality_rows(mj, data, qpos)
        residual = float(np.abs(error).max(initial=0.0))
        if residual <= _CLOSED or not len(free):
            break
        step = np.zeros(mj.nv)
        step[free] = _least_norm(jacobian[:, free], -error[:, None])[:, 0]
        mujoco.mj_integratePos(mj, qpos, step, 1.0)
    return residual


def _equality_rows(mj: mujoco.MjModel, scratch: mujoco.MjData, qpos: Floats) -> tuple[Floats, Floats]:
    """Jacobian (n, nv) and residual (n,) of the active equality constraints of bodies, joints and tendons.

    `scratch` has no contacts.
    """
    data = scratch
    data.qpos[:] = qpos
    mujoco.mj_kinematics(mj, data)
    mujoco.mj_comPos(mj, data)
    mujoco.mj_tendon(mj, data)
    mujoco.mj_makeConstraint(mj, data)
    equality = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    rows = np.flatnonzero(equality)
    rows = rows[np.isin(mj.eq_type[data.efc_id[rows]], _EQUALITIES)]
    dense = np.zeros((data.nefc, mj.nv))
    if data.nefc and mujoco.mj_isSparse(mj):
        mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
    elif data.nefc:
        dense = data.efc_J.reshape(data.nefc, mj.nv)
    return dense[rows].copy(), data.efc_pos[rows].copy()


def _least_norm(a: Floats, b: Floats) -> Floats:
    """Solution (m, k) of least norm of `a` (n, m) x = `b` (n, k) in the sense of least squares."""
    values, vectors = symmetric_eigen(matmul(a, a.T))
    kept = values > _RANK * values.max(initial=0.0)
    basis = vectors[:, kept]
    solution: Floats = matmul(a.T, matmul(basis, matmul(basis.T, b) / values[kept, None]))
    return solution
