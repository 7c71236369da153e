"""Coupling of joints by contact: inertia, Jacobians of pairs of bodies, linear solver."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.foam_response import PairResponse
from skinnet.body.contact.point_kinematics import Motion
from skinnet.compilation import compiled_without_nrt

__all__ = [
    "CouplingWorkspace",
    "Joints",
    "couple_dofs",
    "factorise",
    "implicit_damping",
    "last_dof_of_bodies",
    "pair_columns",
    "solve_correction",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class Joints(NamedTuple):
    """Joints of the model and their coupling; MuJoCo's arrays, v degrees of freedom (dofs).

    Attributes:
        tree: (v,) kinematic tree of each dof.
        parent: (v,) parent dof; -1 for none.
        last_of_body: (nbody,) last dof that moves each body; -1 for fixed ones.
        root_body: (nbody,) root of each body's kinematic tree.
        motion_axis: (v, 6) angular and linear motion per dof (`cdof`), about the tree's centre of mass.
        row: (v,) first entry of each row of the inertia matrix M.
        n_row: (v,) number of entries of each row, lower triangle.
        column: Columns of the entries.
        inertia: Entries of M.
        damping: (v,) diagonal of B.
        velocity: (v,) velocities now.
    """

    tree: Indices
    parent: Indices
    last_of_body: Indices
    root_body: Indices
    motion_axis: Floats
    row: Indices
    n_row: Indices
    column: Indices
    inertia: Floats
    damping: Floats
    velocity: Floats


class CouplingWorkspace(NamedTuple):
    """Scratch arrays: for the n ≤ v dofs of coupled trees, and for one pair.

    Attributes:
        touched: (ntree,) True for trees in contact.
        local: (v,) number of a dof among the coupled ones; -1 for none.
        coupled: (v,) the coupled dofs.
        velocity: (v,) velocities at the end of the step, present iterate.
        inertia: (v, v) M̂ of coupled dofs, lower triangle.
        matrix: (v, v) M̂ + h Jᵀ K J, then its Cholesky factor, which serves later steps as well.
        contact_of_matrix: (2,) the contact for which it was computed: key of the pairs, number of points.
        residual: (v,) residual, then correction.
        impulse: (v,) impulse of the foam, then the change of velocity that it makes.
        step: (v,) correction of the velocities that is searched along (`line_search`).
        line: (7,) state of that search.
        axis: (v, 6) columns of one pair's J, relative twist about the origin per dof.
        used: (v,) dofs with a column.
    """

    touched: NDArray[np.bool_]
    local: Indices
    coupled: Indices
    velocity: Floats
    inertia: Floats
    matrix: Floats
    contact_of_matrix: Indices
    residual: Floats
    impulse: Floats
    step: Floats
    line: Floats
    axis: Floats
    used: Indices


def last_dof_of_bodies(mj: mujoco.MjModel) -> Indices:
    """Last dof (nbody,) that moves each body; -1 for fixed ones."""
    last = np.full(mj.nbody, -1, dtype=np.int64)
    for body in range(1, mj.nbody):
        n = int(mj.body_dofnum[body])
        last[body] = mj.body_dofadr[body] + n - 1 if n else last[mj.body_parentid[body]]
    return last


def implicit_damping(mj: mujoco.MjModel) -> Floats:
    """Damping (v,) that MuJoCo integrates implicitly, diagonal: of joints and of servos on joints."""
    damping: Floats = mj.dof_damping.reshape(mj.nv, -1)[:, 0].copy()
    for actuator in range(mj.nu):
        if mj.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
            joint = int(mj.actuator_trnid[actuator, 0])
            if mj.jnt_type[joint] in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                gear = float(mj.actuator_gear[actuator, 0])
                damping[mj.jnt_dofadr[joint]] -= float(mj.actuator_biasprm[actuator, 2]) * gear * gear
    return np.maximum(damping, 0.0)


@compiled_without_nrt
def couple_dofs(pairs: PairResponse, joints: Joints, workspace: CouplingWorkspace, step_s: float) -> int:
    """Collect dofs of all trees in contact and their M̂; return their number."""
    workspace.touched[:] = False
    for p in range(pairs.total[0]):
        for side in range(2):
            last = joints.last_of_body[pairs.body[p, side]]
            if last >= 0:
                workspace.touched[joints.tree[last]] = True
    n = 0
    for dof in range(len(joints.tree)):
        workspace.local[dof] = -1
        if workspace.touched[joints.tree[dof]]:
            workspace.local[dof] = n
            workspace.coupled[n] = dof
            n += 1
    inertia = workspace.inertia
    for i in range(n):
        for j in range(i + 1):
            inertia[i, j] = 0.0
        dof = workspace.coupled[i]
        for entry in range(joints.row[dof], joints.row[dof] + joints.n_row[dof]):
            inertia[i, workspace.local[joints.column[entry]]] = joints.inertia[entry]
        inertia[i, i] += step_s * joints.damping[dof]
    return n


@compiled_without_nrt
def _add_axis(
    motion: Motion,
    joints: Joints,
    pairs: PairResponse,
    workspace: CouplingWorkspace,
    body: int,
    sign: float,
    n: int,
) -> int:
    """Add the columns of body `body`, with a sign, to the pair's J, which has `n`; return their number."""
    root = joints.root_body[body]
    rx = pairs.origin_m[0] - motion.subtree_com_m[root, 0]
    ry = pairs.origin_m[1] - motion.subtree_com_m[root, 1]
    rz = pairs.origin_m[2] - motion.subtree_com_m[root, 2]
    dof = joints.last_of_body[body]
    axis, motion_axis = workspace.axis, joints.motion_axis
    while dof >= 0:
        i = workspace.local[dof]
        found = False
        for m in range(n):
            found = found or workspace.used[m] == i
        if not found:
            workspace.used[n] = i
            n += 1
            for q in range(6):
                axis[i, q] = 0.0
        wx, wy, wz = motion_axis[dof, 0], motion_axis[dof, 1], motion_axis[dof, 2]
        axis[i, 0] += sign * (motion_axis[dof, 3] + wy * rz - wz * ry)
        axis[i, 1] += sign * (motion_axis[dof, 4] + wz * rx - wx * rz)
        axis[i, 2] += sign * (motion_axis[dof, 5] + wx * ry - wy * rx)
        axis[i, 3] += sign * wx
        axis[i, 4] += sign * wy
        axis[i, 5] += sign * wz
        dof = joints.parent[dof]
    return n


@compiled_without_nrt
def pair_columns(
    pairs: PairResponse, p: int, motion: Motion, joints: Joints, workspace: CouplingWorkspace
) -> int:
    """Fill the columns of J of pair `p`; return their number."""
    n = _add_axis(motion, joints, pairs, workspace, pairs.body[p, 0], -1.0, 0)
    return _add_axis(motion, joints, pairs, workspace, pairs.body[p, 1], 1.0, n)


@compiled_without_nrt
def factorise(matrix: Floats, n: int) -> None:
    """Factorise `matrix`, lower triangle, by Cholesky's method, in place."""
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for q in range(j):
                total -= matrix[i, q] * matrix[j, q]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@compiled_without_nrt
def solve_correction(factor: Floats, residual: Floats, n: int) -> float:
    """Solve for a correction x, in place, by a Cholesky factor; return x · residual [J]."""
    energy_j = 0.0
    for i in range(n):
        total = residual[i]
        for q in range(i):
            total -= factor[i, q] * residual[q]
        residual[i] = total / factor[i, i]
        energy_j += residual[i] * residual[i]
    for k in range(n):
        i = n - 1 - k
        total = residual[i]
        for q in range(i + 1, n):
            total -= factor[q, i] * residual[q]
        residual[i] = total / factor[i, i]
    return energy_j
