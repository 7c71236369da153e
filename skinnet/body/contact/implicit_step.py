"""Implicit step of foam contact: the forces that act in a step, from the velocities at its end.

Forces of the foam at the start of a step make energy from nothing where a body is light for its stiffness k A
and damping c A: above 4 m / h² and 2 m / h. So the step solves

    M̂ (v⁺ - v) = h (Q + Σ Jᵀ f(J v⁺)),    M̂ = M + h B,

for the velocities v⁺ of all coupled joints at once: f from `foam_response`, J of each pair of bodies, Q all
other generalised forces with MuJoCo's constraint forces of the step before, B the damping that MuJoCo itself
integrates implicitly. Newton's method; one iteration where no point of foam changes its state. Skin's
readings are the forces of the foam at the present state, which are those that acted in the step before.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_problem import ContactProblem
from skinnet.body.contact.foam_response import PairResponse, add_pairs, add_response, no_pairs
from skinnet.body.contact.joint_coupling import (
    CouplingWorkspace,
    Joints,
    couple_dofs,
    factorise,
    implicit_damping,
    last_dof_of_bodies,
    pair_columns,
    solve_correction,
)
from skinnet.body.contact.point_kinematics import Motion
from skinnet.body.contact.skin_foundation import Foundation
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
        self._joints = Joints(
            tree=mj.dof_treeid.astype(np.int64),
            parent=mj.dof_parentid.astype(np.int64),
            last_of_body=last_dof_of_bodies(mj),
            root_body=mj.body_rootid.astype(np.int64),
            motion_axis=data.cdof,
            row=mj.M_rowadr.astype(np.int64),
            n_row=mj.M_rownnz.astype(np.int64),
            column=mj.M_colind.astype(np.int64),
            inertia=data.M,
            damping=implicit_damping(mj),
            velocity=data.qvel,
        )
        self._workspace = CouplingWorkspace(
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
        problems = tuple(each.problem for each in self._foundations if each.problem.points.total[0])
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


@compiled_without_nrt
def _solve(
    problems: tuple[ContactProblem, ...],
    motion: Motion,
    pairs: PairResponse,
    joints: Joints,
    workspace: CouplingWorkspace,
    forces: tuple[Floats, Floats, Floats],
    step_s: float,
) -> int:
    """Solve for the velocities at the end of the step; add the foam's forces to the first of `forces`.

    The others are the constraint forces and the accelerations of the step before, where the search begins.
    """
    smooth, constraint, acceleration = forces
    pairs.total[0], n_points = 0, 0
    for problem in problems:
        add_pairs(problem, pairs)
        n_points += problem.points.total[0]
    n = couple_dofs(pairs, joints, workspace, step_s)
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
        for p in range(pairs.total[0]):
            _add_pair(pairs, p, motion, joints, workspace, step_s, fresh)
        if fresh:
            factorise(workspace.matrix, n)
        for i in range(n):
            residual[i] += workspace.impulse[i]
        energy_j = solve_correction(workspace.matrix, residual, n)
        foam_j = solve_correction(workspace.matrix, workspace.impulse, n)
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
    for p in range(pairs.total[0]):
        pairs.number[pairs.body[p, 0], pairs.body[p, 1]] = -1
        columns = pair_columns(pairs, p, motion, joints, workspace)
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
    for p in range(pairs.total[0]):
        key = (key * 8191 + pairs.body[p, 0] * 131071 + pairs.body[p, 1] + 1) % 2147483647
    same = key == known[0] and abs(n_points - known[1]) <= _SIMILAR * known[1]
    if not same:
        known[0], known[1] = key, n_points
    return bool(same)


@compiled_without_nrt
def _relative_twists(
    motion: Motion, pairs: PairResponse, joints: Joints, workspace: CouplingWorkspace
) -> None:
    """Fill the relative twists of all pairs at the present iterate; clear wrenches and stiffnesses.

    Bodies without dofs move as MuJoCo's `cvel` says: a finger is led.
    """
    for p in range(pairs.total[0]):
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
        columns = pair_columns(pairs, p, motion, joints, workspace)
        for i in range(columns):
            dof = workspace.used[i]
            for q in range(6):
                pairs.twist[p, q] += workspace.axis[dof, q] * workspace.velocity[dof]


@compiled_without_nrt
def _add_pair(
    pairs: PairResponse,
    p: int,
    motion: Motion,
    joints: Joints,
    workspace: CouplingWorkspace,
    step_s: float,
    with_matrix: bool,
) -> None:
    """Add h Jᵀ f of pair `p` to the impulse and, if wanted, h Jᵀ K J to the matrix."""
    columns = pair_columns(pairs, p, motion, joints, workspace)
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
