"""Implicit step of foam contact: the forces that act in a step, from the velocities at its end.

Forces of the foam at the start of a step make energy from nothing where a body is light for its stiffness k A
and damping c A: above 4 m / h² and 2 m / h. So the step solves

    M̂ (v⁺ - v) = h (Q + Σ Jᵀ f(J v⁺) + J_cᵀ f_c(J_c (v⁺ - v) / h)),    M̂ = M + h B,

for the velocities v⁺ of all coupled joints at once: f from `foam_response`, J of each pair of bodies, f_c and
J_c of MuJoCo's constraints (`constraint_rows`) on these joints, Q all other generalised forces, B the damping
that MuJoCo itself integrates implicitly. Newton's method; one iteration where no point of foam and no
constraint changes its state. MuJoCo then solves for the constraint forces itself, under these forces of the
foam; they are the same where B = 0. (With the constraint forces of the step before, a light plate between
foam and a heavy load swings ever wider: its load changes by almost what the foam's force does, a step late.)
Skin's readings are the forces of the foam at the present state; these acted in the step before.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.constraint_rows import (
    ConstraintRows,
    add_constraints,
    couple_trees,
    no_rows,
    update_forces,
    write_rows,
)
from skinnet.body.contact.contact_problem import ContactProblem
from skinnet.body.contact.foam_response import add_pairs, add_response
from skinnet.body.contact.joint_coupling import (
    CouplingWorkspace,
    Joints,
    couple_dofs,
    factorise,
    fill_columns,
    joints_of,
    no_coupling,
    solve_correction,
    touch_trees,
)
from skinnet.body.contact.line_search import begin_search, continue_search, is_rounding
from skinnet.body.contact.pair_response import PairResponse, no_pairs
from skinnet.body.contact.point_kinematics import Motion
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.compilation import compiled_without_nrt
from skinnet.compiled_reference import reference

__all__ = ["ImplicitContact"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
_MAX_ITERATIONS = 30
_MAX_CURVE_ITERATIONS = 200
"""Of foam with a curve, whose slope may change by orders of magnitude within a step."""
_TOLERANCE = 1e-6
"""Energy of the last correction of velocities, as a fraction of that of the foam's own impulse."""
_NEGLIGIBLE_J = 1e-24
"""Energy of a correction [J] that is one of rounding: foam that is near but without force has no impulse."""
_SIMILAR = 0.05
"""Relative change of the number of loaded points up to which the last matrix serves."""
_SLOW = 1e-2
"""Ratio of the energies of two corrections above which the matrix is computed anew."""


class _StepProblem(NamedTuple):
    """Problem of one step, which compiled code takes as a `reference`.

    Attributes:
        cells: Contact of the cells.
        sheets: Contact of the tactile sheets.
        motion: Poses and velocities now.
        pairs: Response of the foam between pairs of bodies.
        rows: Constraints.
        joints: Joints and their coupling.
        workspace: Scratch arrays.
        smooth: (v,) all forces but those of constraints; those of the foam are added.
        acceleration: (v,) accelerations of the step before, where the search begins.
    """

    cells: ContactProblem
    sheets: ContactProblem
    motion: Motion
    pairs: PairResponse
    rows: ConstraintRows
    joints: Joints
    workspace: CouplingWorkspace
    smooth: Floats
    acceleration: Floats


class ImplicitContact:
    """Implicit step of all foam on one model.

    Attributes:
        n_iterations: Iterations of the last step; 0 without contact.
    """

    def __init__(self, mj: mujoco.MjModel, data: mujoco.MjData, foundations: tuple[Foundation, Foundation]):
        """Couple `foundations` to the state `data` of `mj`."""
        self.n_iterations = 0
        pairs = {
            (int(own), int(other))
            for foundation in foundations
            for own in foundation.surface.patch_body_id
            for other in foundation.scene.body_id
        }
        self._mj, self._data = mj, data
        self._unreferenced = _StepProblem(
            cells=foundations[0].problem,
            sheets=foundations[1].problem,
            motion=foundations[0].motion,
            pairs=no_pairs(mj.nbody, len(pairs)),
            rows=no_rows(0, 0),
            joints=joints_of(mj, data),
            workspace=no_coupling(mj, len(pairs)),
            smooth=data.qfrc_smooth,
            acceleration=data.qacc,
        )
        self._problem = reference(self._unreferenced)
        _solve(self._problem, 0.0)  # compiles; nothing is loaded yet

    def add_forces(self, step_s: float) -> None:
        """Add generalised forces of the foam in the step `step_s` [s] to `qfrc_smooth`, without them before.

        The loaded points and MuJoCo's constraints must be those of the present state.
        """
        if self._data.nefc:
            self._write_rows()
        else:
            self._unreferenced.rows.total[0] = 0
        self.n_iterations = _solve(self._problem, step_s)

    def _write_rows(self) -> None:
        """Write MuJoCo's constraints to the problem, with more space if there are more than ever before."""
        data, rows = self._data, self._unreferenced.rows
        if len(rows.kind) < data.nefc or len(rows.value) < len(data.efc_J):
            rows = no_rows(2 * data.nefc, 2 * len(data.efc_J))
            self._unreferenced = self._unreferenced._replace(rows=rows)
            self._problem = reference(self._unreferenced)
        write_rows(self._mj, data, rows)


@compiled_without_nrt
def _solve(problem: _StepProblem, step_s: float) -> int:
    """Solve for the velocities at the end of the step; add the foam's forces to `problem.smooth`."""
    cells, sheets, pairs, rows = problem.cells, problem.sheets, problem.pairs, problem.rows
    motion, joints, workspace = problem.motion, problem.joints, problem.workspace
    smooth, acceleration = problem.smooth, problem.acceleration
    n_points = cells.points.total[0] + sheets.points.total[0]
    if n_points == 0:
        return 0
    pairs.total[0] = 0
    add_pairs(cells, pairs)
    add_pairs(sheets, pairs)
    touch_trees(pairs, joints, workspace)
    couple_trees(rows, joints, workspace)
    n = couple_dofs(joints, workspace, step_s)
    fill_columns(pairs, motion, joints, workspace)
    coupled, velocity, residual = workspace.coupled, workspace.velocity, workspace.residual
    for i in range(n):
        velocity[i] = joints.velocity[coupled[i]] + step_s * acceleration[coupled[i]]
    known = workspace.contact_of_matrix
    fresh = not _is_same_contact(pairs, workspace, n, n_points)
    last_j, iterations, most, searches = np.inf, 0, _MAX_ITERATIONS, False
    has_curve = len(cells.foam.curve) > 0
    if has_curve:  # its slope changes: no matrix serves for long
        fresh, most = True, _MAX_CURVE_ITERATIONS
    while True:
        state = update_forces(rows, joints, workspace, step_s)
        fresh = fresh or state != known[2]
        _relative_twists(motion, pairs, joints, workspace)
        add_response(cells, pairs, step_s, fresh)
        add_response(sheets, pairs, step_s, fresh)
        if n == 0:
            break
        for i in range(n):
            workspace.impulse[i] = 0.0
            residual[i] = step_s * smooth[coupled[i]]
            for j in range(n):
                change = velocity[j] - joints.velocity[coupled[j]]
                residual[i] -= workspace.inertia[max(i, j), min(i, j)] * change
        if fresh:
            for i in range(n):
                for j in range(i + 1):
                    workspace.matrix[i, j] = workspace.inertia[i, j]
        for p in range(pairs.total[0]):
            _add_pair(pairs, p, workspace, step_s, fresh)
        add_constraints(rows, workspace, step_s, fresh)
        if fresh:
            known[2] = state
            factorise(workspace.matrix, n)
        for i in range(n):
            residual[i] += workspace.impulse[i]
        if searches and continue_search(workspace.line, workspace.step, velocity, residual, n):
            iterations += 1
            searches = iterations < most
            continue
        energy_j = solve_correction(workspace.matrix, residual, n)
        foam_j = solve_correction(workspace.matrix, workspace.impulse, n)
        iterations += 1
        if energy_j <= max(_TOLERANCE * foam_j, _NEGLIGIBLE_J) or iterations >= most:
            break
        if has_curve and is_rounding(energy_j, workspace.inertia, velocity, n):
            break
        # points that changed their state need a new matrix once the old one no longer helps
        was_fresh, fresh = fresh, has_curve or (not fresh and energy_j > _SLOW * last_j)
        if not was_fresh and fresh:
            last_j = np.inf
            continue
        last_j = energy_j
        if has_curve:
            begin_search(workspace.line, workspace.step, residual, n, energy_j)
            searches = True
        for i in range(n):
            velocity[i] += residual[i]
    for p in range(pairs.total[0]):
        pairs.number[pairs.body[p, 0], pairs.body[p, 1]] = -1
        for c in range(workspace.first_column[p], workspace.first_column[p + 1]):
            force = 0.0
            for q in range(6):
                force += workspace.axis[c, q] * pairs.wrench[p, q]
            smooth[coupled[workspace.used[c]]] += force
    return iterations


@compiled_without_nrt
def _is_same_contact(pairs: PairResponse, workspace: CouplingWorkspace, n: int, n_points: int) -> bool:
    """Return True if pairs and the `n` dofs are those of the last matrix, and the points about as many.

    Else note them. Newton's method converges with the matrix of a similar contact: most work is saved.
    """
    key, known = 1, workspace.contact_of_matrix
    for p in range(pairs.total[0]):
        key = (key * 8191 + pairs.body[p, 0] * 131071 + pairs.body[p, 1] + 1) % 2147483647
    for i in range(n):
        key = (key * 31 + workspace.coupled[i] + 1) % 2147483647
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
        for c in range(workspace.first_column[p], workspace.first_column[p + 1]):
            for q in range(6):
                pairs.twist[p, q] += workspace.axis[c, q] * workspace.velocity[workspace.used[c]]


@compiled_without_nrt
def _add_pair(
    pairs: PairResponse, p: int, workspace: CouplingWorkspace, step_s: float, with_matrix: bool
) -> None:
    """Add h Jᵀ f of pair `p` to the impulse and, if wanted, h Jᵀ K J to the matrix."""
    axis, used, stiffness = workspace.axis, workspace.used, pairs.stiffness
    first, end = workspace.first_column[p], workspace.first_column[p + 1]
    for i in range(first, end):
        a = used[i]
        for q in range(6):
            workspace.impulse[a] += step_s * axis[i, q] * pairs.wrench[p, q]
        if not with_matrix:
            continue
        for q in range(6):
            product = 0.0
            for r in range(6):
                product += stiffness[p, q, r] * axis[i, r]
            product *= step_s
            for j in range(first, end):
                b = used[j]
                if b <= a:
                    workspace.matrix[a, b] += product * axis[j, q]
