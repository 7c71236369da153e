"""Motion of joints that follow others by equality constraints, as ground truth: mimic joints and loops."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import matmul, solve

__all__ = ["followed_motion", "settle_followers"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_REGULARISATION = 1e-12
"""Share of the trace that is added to J Jᵀ, for constraints that no following joint can change."""
_MAX_ITERATIONS = 20
_CLOSED = 1e-10
"""Residual [m, rad] of the constraints at which they count as fulfilled."""


def followed_motion(mj: mujoco.MjModel, data: mujoco.MjData, controlled: Indices) -> Floats:
    """Motion of all DoFs per motion of each controlled DoF `controlled` (D,), (nv, D).

    The other DoFs move as the equality constraints ask, and no farther: dq = −J⁺ J_c, with the Jacobian J of
    the constraints in them; without constraints they rest.
    """
    motion = np.zeros((mj.nv, len(controlled)))
    motion[controlled, np.arange(len(controlled))] = 1.0
    if mj.neq == 0 or data.ne == 0:
        return motion
    jacobian = _equality_jacobian(mj, data)
    following = _following(mj, controlled)
    motion[following] = _least_motion(jacobian[:, following], -jacobian[:, controlled])
    return motion


def settle_followers(mj: mujoco.MjModel, data: mujoco.MjData, controlled: Indices) -> None:
    """Move the DoFs that are not controlled until the equality constraints hold; run forward kinematics."""
    mujoco.mj_forward(mj, data)
    if mj.neq == 0:
        return
    following = _following(mj, controlled)
    for _ in range(_MAX_ITERATIONS):
        residual = data.efc_pos[: data.ne].copy()
        if not len(residual) or np.abs(residual).max() < _CLOSED:
            return
        step = np.zeros((mj.nv, 1))
        step[following] = _least_motion(_equality_jacobian(mj, data)[:, following], -residual[:, None])
        mujoco.mj_integratePos(mj, data.qpos, step[:, 0], 1.0)
        mujoco.mj_forward(mj, data)


def _following(mj: mujoco.MjModel, controlled: Indices) -> Indices:
    return np.setdiff1d(np.arange(mj.nv), controlled)


def _least_motion(jacobian: Floats, change: Floats) -> Floats:
    """Least motion (n, m) with `jacobian` (k, n) times it equal to `change` (k, m)."""
    gram = matmul(jacobian, jacobian.T)
    gram[np.diag_indices_from(gram)] += _REGULARISATION * max(float(np.trace(gram)), _REGULARISATION)
    return matmul(jacobian.T.copy(), solve(gram, change))


def _equality_jacobian(mj: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Jacobian (ne, nv) of the equality constraints, which are MuJoCo's first rows."""
    if not mujoco.mj_isSparse(mj):
        jacobian: Floats = data.efc_J[: data.ne * mj.nv].reshape(data.ne, mj.nv).copy()
        return jacobian
    dense = np.zeros((data.ne, mj.nv))
    for row in range(data.ne):
        begin, count = data.efc_J_rowadr[row], data.efc_J_rownnz[row]
        dense[row, data.efc_J_colind[begin : begin + count]] = data.efc_J[begin : begin + count]
    return dense
