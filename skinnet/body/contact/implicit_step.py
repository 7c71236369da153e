"""Implicit step of foam contact: the forces that act in a step, from the velocities at its end.

Forces of the foam at the start of a step make energy from nothing where a body is light for its stiffness k A
and damping c A: above 4 m / h² and 2 m / h. So the step solves

    M̂ (v⁺ - v) = h (Q + Σ Jᵀ f(J v⁺)),    M̂ = M + h B,

for the velocities v⁺ of all coupled joints at once: f from `foam_response`, J of each pair of bodies, Q all
other generalised forces with MuJoCo's constraint forces of the step before, B the damping that MuJoCo itself
integrates implicitly. Newton's method; one iteration where no point of foam changes its state. Skin's
readings are the forces of the foam at the present state, which are those that acted in the step before.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.foam_response import PairResponse, add_pairs, add_response, no_pairs
from skinnet.body.contact.point_kinematics import Motion
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.contact.winkler import ContactProblem
from skinnet.compilation import compiled_without_nrt

__all__ = ["ImplicitContact"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
_MAX_ITERATIONS = 30
_TOLERANCE = 1e-6
"""Energy of the last correction of velocities, as a fraction of that of the foam's own impulse."""
_SIMILAR = 0.05
"""Relative change of the number of loaded points up to which the last matrix serves."""
_SLOW = 1e-2
"""Ratio of the energies of two corrections above which the matrix is computed anew."""


class _Joints(NamedTuple):
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


class _Workspace(NamedTuple):
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
    axis: Floats
    used: Indices


class ImplicitContact:
    """Implicit step of all foam on one model.

    Attributes:
        n_iterations: Iterations of the last step; 0 without contact.
    """

    def __init__(self, mj: mujoco.MjModel, data: mujoco.MjData, foundations: tuple[Foundation, Foundation]):
        """Couple `foundations` to the state `data` of `mj`."""
        self.n_iterations = 0
        self._mj, self._data, self._foundations = mj, data, foundations
        self._motion = foundations[0].motion
        pairs = {
            (int(own), int(other))
            for foundation in foundations
            for own in foundation.surface.patch_body_id
            for other in foundation.scene.body_id
        }
        self._pairs = no_pairs(mj.nbody, len(pairs))
        v = mj.nv
        self._joints = _Joints(
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
        self._workspace = _Workspace(
            touched=np.zeros(mj.ntree, dtype=np.bool_),
            local=np.zeros(v, dtype=np.int64),
            coupled=np.zeros(v, dtype=np.int64),
            velocity=np.zeros(v),
            inertia=np.zeros((v, v)),
            matrix=np.zeros((v, v)),
            contact_of_matrix=np.zeros(2, dtype=np.int64),
            residual=np.zeros(v),
            impulse=np.zeros(v),
            axis=np.zeros((v, 6)),
            used=np.zeros(v, dtype=np.int64),
        )

    def add_forces(self, step_s: float) -> None:
        """Add generalised forces of the foam in the step `step_s` [s] to `qfrc_smooth`, without them before.

        The loaded points must be those of the present state.
        """
        self.n_iterations = 0
        problems = tuple(each.problem for each in self._foundations if each.problem.points.count[0])
        if not problems:
            return
        data = self._data
        self.n_iterations = _solve(
            problems,
            self._motion,
            self._pairs,
            self._joints,
            self._workspace,
            (data.qfrc_smooth, data.qfrc_constraint, data.qacc),
            step_s,
        )


def _last_dof_of_bodies(mj: mujoco.MjModel) -> Indices:
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
            if mj.jnt_type[joint] in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                gear = float(mj.actuator_gear[actuator, 0])
                damping[mj.jnt_dofadr[joint]] -= float(mj.actuator_biasprm[actuator, 2]) * gear * gear
    return np.maximum(damping, 0.0)


@compiled_without_nrt
def _solve(
    problems: tuple[ContactProblem, ...],
    motion: Motion,
    pairs: PairResponse,
    joints: _Joints,
    workspace: _Workspace,
    forces: tuple[Floats, Floats, Floats],
    step_s: float,
) -> int:
    """Solve for the velocities at the end of the step; add the foam's forces to the first of `forces`.

    The others are the constraint forces and the accelerations of the step before, where the search begins.
    """
    smooth, constraint, acceleration = forces
    pairs.count[0], n_points = 0, 0
    for problem in problems:
        add_pairs(problem, pairs)
        n_points += problem.points.count[0]
    n = _couple_dofs(pairs, joints, workspace, step_s)
    coupled, velocity, residual = workspace.coupled, workspace.velocity, workspace.residual
    for i in range(n):
        velocity[i] = joints.velocity[coupled[i]] + step_s * acceleration[coupled[i]]
    fresh = not _is_same_contact(pairs, workspace.contact_of_matrix, n_points)
    last_j, iterations = np.inf, 0
    while True:
        _relative_twists(motion, pairs, joints, workspace)
        for problem in problems:
            add_response(problem, pairs, step_s, fresh)
        if n == 0:
            break
        for i in range(n):
            workspace.impulse[i] = 0.0
            residual[i] = step_s * (smooth[coupled[i]] + constraint[coupled[i]])
            for j in range(n):
                change = velocity[j] - joints.velocity[coupled[j]]
                residual[i] -= workspace.inertia[max(i, j), min(i, j)] * change
        if fresh:
            for i in range(n):
                for j in range(i + 1):
                    workspace.matrix[i, j] = workspace.inertia[i, j]
        for p in range(pairs.count[0]):
            _add_pair(pairs, p, motion, joints, workspace, step_s, fresh)
        if fresh:
            _factorise(workspace.matrix, n)
        for i in range(n):
            residual[i] += workspace.impulse[i]
        energy_j = _correction(workspace.matrix, residual, n)
        foam_j = _correction(workspace.matrix, workspace.impulse, n)
        iterations += 1
        if energy_j <= _TOLERANCE * foam_j or iterations >= _MAX_ITERATIONS:
            break
        # points that changed their state need a new matrix once the old one no longer helps
        was_fresh, fresh = fresh, not fresh and energy_j > _SLOW * last_j
        if not was_fresh and fresh:
            last_j = np.inf
            continue
        last_j = energy_j
        for i in range(n):
            velocity[i] += residual[i]
    for p in range(pairs.count[0]):
        pairs.number[pairs.body[p, 0], pairs.body[p, 1]] = -1
        columns = _pair_columns(pairs, p, motion, joints, workspace)
        for i in range(columns):
            dof, force = workspace.used[i], 0.0
            for q in range(6):
                force += workspace.axis[dof, q] * pairs.wrench[p, q]
            smooth[coupled[dof]] += force
    return iterations


@compiled_without_nrt
def _is_same_contact(pairs: PairResponse, known: Indices, n_points: int) -> bool:
    """Return True if pairs are those of the last matrix, and about as many points; else note them in `known`.

    Newton's method converges with the matrix of a similar contact, which saves most of its work.
    """
    key = 1
    for p in range(pairs.count[0]):
        key = (key * 8191 + pairs.body[p, 0] * 131071 + pairs.body[p, 1] + 1) % 2147483647
    same = key == known[0] and abs(n_points - known[1]) <= _SIMILAR * known[1]
    if not same:
        known[0], known[1] = key, n_points
    return bool(same)


@compiled_without_nrt
def _couple_dofs(pairs: PairResponse, joints: _Joints, workspace: _Workspace, step_s: float) -> int:
    """Collect dofs of all trees in contact and their M̂; return their number."""
    workspace.touched[:] = False
    for p in range(pairs.count[0]):
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
    joints: _Joints,
    pairs: PairResponse,
    workspace: _Workspace,
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
def _pair_columns(pairs: PairResponse, p: int, motion: Motion, joints: _Joints, workspace: _Workspace) -> int:
    """Fill the columns of J of pair `p`; return their number."""
    n = _add_axis(motion, joints, pairs, workspace, pairs.body[p, 0], -1.0, 0)
    return _add_axis(motion, joints, pairs, workspace, pairs.body[p, 1], 1.0, n)


@compiled_without_nrt
def _relative_twists(motion: Motion, pairs: PairResponse, joints: _Joints, workspace: _Workspace) -> None:
    """Fill the relative twists of all pairs at the present iterate; clear wrenches and stiffnesses.

    Bodies without dofs move as MuJoCo's `cvel` says: a finger is led.
    """
    for p in range(pairs.count[0]):
        for q in range(6):
            pairs.twist[p, q] = pairs.wrench[p, q] = 0.0
            for r in range(6):
                pairs.stiffness[p, q, r] = 0.0
        for side in range(2):
            body, sign = pairs.body[p, side], -1.0 if side == 0 else 1.0
            if joints.last_of_body[body] >= 0:
                continue
            root, twist = joints.root_body[body], motion.cvel
            rx = pairs.origin_m[0] - motion.subtree_com_m[root, 0]
            ry = pairs.origin_m[1] - motion.subtree_com_m[root, 1]
            rz = pairs.origin_m[2] - motion.subtree_com_m[root, 2]
            wx, wy, wz = twist[body, 0], twist[body, 1], twist[body, 2]
            pairs.twist[p, 0] += sign * (twist[body, 3] + wy * rz - wz * ry)
            pairs.twist[p, 1] += sign * (twist[body, 4] + wz * rx - wx * rz)
            pairs.twist[p, 2] += sign * (twist[body, 5] + wx * ry - wy * rx)
            pairs.twist[p, 3] += sign * wx
            pairs.twist[p, 4] += sign * wy
            pairs.twist[p, 5] += sign * wz
        columns = _pair_columns(pairs, p, motion, joints, workspace)
        for i in range(columns):
            dof = workspace.used[i]
            for q in range(6):
                pairs.twist[p, q] += workspace.axis[dof, q] * workspace.velocity[dof]


@compiled_without_nrt
def _add_pair(
    pairs: PairResponse,
    p: int,
    motion: Motion,
    joints: _Joints,
    workspace: _Workspace,
    step_s: float,
    with_matrix: bool,
) -> None:
    """Add h Jᵀ f of pair `p` to the impulse and, if wanted, h Jᵀ K J to the matrix."""
    columns = _pair_columns(pairs, p, motion, joints, workspace)
    axis, stiffness = workspace.axis, pairs.stiffness
    for i in range(columns):
        a = workspace.used[i]
        for q in range(6):
            workspace.impulse[a] += step_s * axis[a, q] * pairs.wrench[p, q]
        if not with_matrix:
            continue
        for q in range(6):
            product = 0.0
            for r in range(6):
                product += stiffness[p, q, r] * axis[a, r]
            product *= step_s
            for j in range(columns):
                b = workspace.used[j]
                if b <= a:
                    workspace.matrix[a, b] += product * axis[b, q]


@compiled_without_nrt
def _factorise(matrix: Floats, n: int) -> None:
    """Factorise `matrix`, lower triangle, by Cholesky's method, in place."""
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for q in range(j):
                total -= matrix[i, q] * matrix[j, q]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@compiled_without_nrt
def _correction(factor: Floats, residual: Floats, n: int) -> float:
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
