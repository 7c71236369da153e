"""Coupling of joints by contact: inertia, Jacobians of pairs of bodies, linear solver."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.pair_response import PairResponse
from skinnet.body.contact.point_kinematics import Motion
from skinnet.body.model_file import ONE_DOF
from skinnet.compilation import compiled_without_nrt

__all__ = [
    "CouplingWorkspace",
    "Joints",
    "couple_dofs",
    "factorise",
    "fill_columns",
    "joints_of",
    "no_coupling",
    "solve_correction",
    "touch_trees",
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
    """Scratch arrays: for the n ≤ v dofs of coupled trees, and for the pairs of bodies.

    Attributes:
        touched: (ntree,) True for trees in contact, and for those coupled to them by constraints.
        local: (v,) number of a dof among the coupled ones; -1 for none.
        coupled: (v,) the coupled dofs.
        velocity: (v,) velocities at the end of the step, present iterate.
        inertia: (v, v) M̂ of coupled dofs, lower triangle.
        matrix: (v, v) M̂ + h Jᵀ K J, then its Cholesky factor, which serves later steps as well.
        contact_of_matrix: (3,) the contact for which it was computed: key of pairs and dofs, number of
            points, key of the states of constraints.
        residual: (v,) residual, then correction.
        impulse: (v,) impulse of the foam, then the change of velocity that it makes.
        first_column: (·,) where the columns of each pair's J begin, then their number.
        step: (v,) correction of the velocities that is searched along (`line_search`).
        line: (7,) state of that search.
        axis: (·, 6) columns, the pair's relative twist about the origin per dof.
        used: (·,) the dof of each column, numbered among the coupled ones.
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
    first_column: Indices
    step: Floats
    line: Floats
    axis: Floats
    used: Indices


def no_coupling(mj: mujoco.MjModel, n_pairs: int) -> CouplingWorkspace:
    """Return scratch arrays for at most `n_pairs` pairs of bodies of `mj`."""
    v, n_columns = mj.nv, 2 * n_pairs * _longest_chain(mj)
    return CouplingWorkspace(
        touched=np.zeros(mj.ntree, dtype=np.bool_),
        local=np.zeros(v, dtype=np.int64),
        coupled=np.zeros(v, dtype=np.int64),
        velocity=np.zeros(v),
        inertia=np.zeros((v, v)),
        matrix=np.zeros((v, v)),
        contact_of_matrix=np.zeros(3, dtype=np.int64),
        residual=np.zeros(v),
        impulse=np.zeros(v),
        first_column=np.zeros(n_pairs + 1, dtype=np.int64),
        step=np.zeros(v),
        line=np.zeros(7),
        axis=np.zeros((n_columns, 6)),
        used=np.zeros(n_columns, dtype=np.int64),
    )


def joints_of(mj: mujoco.MjModel, data: mujoco.MjData) -> Joints:
    """Joints of `mj`, with views of the arrays of `data`."""
    return Joints(
        tree=mj.dof_treeid.astype(np.int64),
        parent=mj.dof_parentid.astype(np.int64),
        last_of_body=_last_dof_of_bodies(mj),
        root_body=mj.body_rootid.astype(np.int64),
        motion_axis=data.cdof,
        row=mj.M_rowadr.astype(np.int64),
        n_row=mj.M_rownnz.astype(np.int64),
        column=mj.M_colind.astype(np.int64),
        inertia=data.M,
        damping=_implicit_damping(mj),
        velocity=data.qvel,
    )


def _longest_chain(mj: mujoco.MjModel) -> int:
    """Largest number of dofs that move one body."""
    above = np.zeros(mj.nv, dtype=np.int64)
    for dof, parent in enumerate(mj.dof_parentid):
        above[dof] = 1 + (above[parent] if parent >= 0 else 0)
    return int(above.max(initial=0))


def _last_dof_of_bodies(mj: mujoco.MjModel) -> Indices:
    """Last dof (nbody,) that moves each body; -1 for fixed ones."""
    last = np.full(mj.nbody, -1, dtype=np.int64)
    for body in range(1, mj.nbody):
        n = int(mj.body_dofnum[body])
        last[body] = mj.body_dofadr[body] + n - 1 if n else last[mj.body_parentid[body]]
    return last


def _implicit_damping(mj: mujoco.MjModel) -> Floats:
    """Damping (v,) that MuJoCo integrates implicitly, diagonal: of joints and of servos on joints."""
    damping: Floats = mj.dof_damping.reshape(mj.nv, -1)[:, 0].copy()
    for actuator in range(mj.nu):
        if mj.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
            joint = int(mj.actuator_trnid[actuator, 0])
            if int(mj.jnt_type[joint]) in ONE_DOF:  # no NumPy integer equals a member of an enumeration
                gear = float(mj.actuator_gear[actuator, 0])
                damping[mj.jnt_dofadr[joint]] -= float(mj.actuator_biasprm[actuator, 2]) * gear * gear
    return np.maximum(damping, 0.0)


@compiled_without_nrt
def touch_trees(pairs: PairResponse, joints: Joints, workspace: CouplingWorkspace) -> None:
    """Mark the trees of all pairs as touched."""
    workspace.touched[:] = False
    for p in range(pairs.total[0]):
        for side in range(2):
            last = joints.last_of_body[pairs.body[p, side]]
            if last >= 0:
                workspace.touched[joints.tree[last]] = True


@compiled_without_nrt
def couple_dofs(joints: Joints, workspace: CouplingWorkspace, step_s: float) -> int:
    """Collect dofs of all touched trees and their M̂; return their number."""
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
def fill_columns(pairs: PairResponse, motion: Motion, joints: Joints, workspace: CouplingWorkspace) -> None:
    """Fill the columns of J of all pairs."""
    n = 0
    for p in range(pairs.total[0]):
        workspace.first_column[p] = first = n
        n = _add_columns(motion, joints, pairs, workspace, pairs.body[p, 0], -1.0, first, n)
        n = _add_columns(motion, joints, pairs, workspace, pairs.body[p, 1], 1.0, first, n)
    workspace.first_column[pairs.total[0]] = n


@compiled_without_nrt
def _add_columns(
    motion: Motion,
    joints: Joints,
    pairs: PairResponse,
    workspace: CouplingWorkspace,
    body: int,
    sign: float,
    first: int,
    end: int,
) -> int:
    """Add the motion of `body`, with a sign, to a pair's columns `first` to `end`; return the new end."""
    root = joints.root_body[body]
    rx = pairs.origin_m[0] - motion.subtree_com_m[root, 0]
    ry = pairs.origin_m[1] - motion.subtree_com_m[root, 1]
    rz = pairs.origin_m[2] - motion.subtree_com_m[root, 2]
    dof = joints.last_of_body[body]
    axis, motion_axis, used = workspace.axis, joints.motion_axis, workspace.used
    while dof >= 0:
        i, c = workspace.local[dof], first
        while c < end and used[c] != i:
            c += 1
        if c == end:
            used[c] = i
            end += 1
            for q in range(6):
                axis[c, q] = 0.0
        wx, wy, wz = motion_axis[dof, 0], motion_axis[dof, 1], motion_axis[dof, 2]
        axis[c, 0] += sign * (motion_axis[dof, 3] + wy * rz - wz * ry)
        axis[c, 1] += sign * (motion_axis[dof, 4] + wz * rx - wx * rz)
        axis[c, 2] += sign * (motion_axis[dof, 5] + wx * ry - wy * rx)
        axis[c, 3] += sign * wx
        axis[c, 4] += sign * wy
        axis[c, 5] += sign * wz
        dof = joints.parent[dof]
    return end


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
