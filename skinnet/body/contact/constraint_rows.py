"""Constraints of MuJoCo as the implicit step sees them: contacts, joint limits, friction loss, equalities.

MuJoCo states each constraint as a row J of a Jacobian with a reference acceleration a* and a stiffness D (its
documentation, "Computation"). With r = J v̇ - a*, its force along J is

    linear (equality)       f = -D r
    friction loss           f = -D r, at most the loss
    unilateral              f = max(0, -D r)
    elliptic cone           f = -D r in the dual cone, zero in the cone, else on its surface

all of which are derivatives of one convex function. v̇ is the change of velocity in the step, over its length.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.joint_coupling import CouplingWorkspace, Joints
from skinnet.compilation import compiled_without_nrt

__all__ = ["ConstraintRows", "add_constraints", "couple_trees", "no_rows", "update_forces", "write_rows"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_LINEAR, _FRICTION_LOSS, _UNILATERAL, _CONE = 0, 1, 2, 3
_KIND = np.array([_LINEAR, _FRICTION_LOSS, _FRICTION_LOSS, *4 * [_UNILATERAL], _CONE], dtype=np.int64)
"""Kind of each `mjtConstraint`."""
_FREE, _STUCK, _SLIDING = 0, 1, 2
"""States: no force; force linear in r; force limited (friction loss) or on the surface of its cone."""
_MAX_CONE = 6


class ConstraintRows(NamedTuple):
    """Constraint rows of the present step, r of them; a cone has several, one after the other.

    Attributes:
        total: (1,) r.
        kind: (r,) linear, friction loss, unilateral or cone.
        size: (r,) number of rows of a cone at its first row, 0 at its others; 1 for all other kinds.
        first: (r + 1,) where the entries of each row of J begin.
        dof: Degrees of freedom of the entries.
        value: Values of the entries.
        stiffness: (r,) D.
        reference: (r,) a*.
        limit: (r,) friction loss; of cones μ of the regularised cone, then the friction coefficients.
        is_coupled: (r,) True for rows that act on trees in contact with foam, or on what these act on.
        state: (r,) free, stuck or sliding.
        residual: (r,) r.
        force: (r,) f.
        curvature: (6, 6) of one cone: negative derivative of f with respect to r, scratch.
    """

    total: Indices
    kind: Indices
    size: Indices
    first: Indices
    dof: Indices
    value: Floats
    stiffness: Floats
    reference: Floats
    limit: Floats
    is_coupled: NDArray[np.bool_]
    state: Indices
    residual: Floats
    force: Floats
    curvature: Floats


def no_rows(n_rows: int, n_entries: int) -> ConstraintRows:
    """Return no rows, with space for `n_rows` rows of `n_entries` entries in all."""
    return ConstraintRows(
        total=np.zeros(1, dtype=np.int64),
        kind=np.zeros(n_rows, dtype=np.int64),
        size=np.zeros(n_rows, dtype=np.int64),
        first=np.zeros(n_rows + 1, dtype=np.int64),
        dof=np.zeros(n_entries, dtype=np.int64),
        value=np.zeros(n_entries),
        stiffness=np.zeros(n_rows),
        reference=np.zeros(n_rows),
        limit=np.zeros(n_rows),
        is_coupled=np.zeros(n_rows, dtype=np.bool_),
        state=np.zeros(n_rows, dtype=np.int64),
        residual=np.zeros(n_rows),
        force=np.zeros(n_rows),
        curvature=np.zeros((_MAX_CONE, _MAX_CONE)),
    )


def write_rows(mj: mujoco.MjModel, data: mujoco.MjData, rows: ConstraintRows) -> None:
    """Write the constraints of `data`, after `mj_fwdVelocity`, to `rows`, which must have the space."""
    n = data.nefc
    rows.total[0] = n
    kind = _KIND[data.efc_type]
    rows.kind[:n], rows.size[:n] = kind, 1
    rows.stiffness[:n], rows.reference[:n] = data.efc_D, data.efc_aref
    rows.limit[:n] = data.efc_frictionloss
    if mujoco.mj_isSparse(mj):
        rows.first[:n], rows.first[n] = data.efc_J_rowadr, data.nJ
        rows.dof[: data.nJ], rows.value[: data.nJ] = data.efc_J_colind, data.efc_J
    else:
        rows.first[: n + 1] = mj.nv * np.arange(n + 1)
        rows.dof[: n * mj.nv], rows.value[: n * mj.nv] = np.tile(np.arange(mj.nv), n), data.efc_J
    if (kind == _CONE).any():
        contacts = data.contact
        for first, size, mu, friction in zip(
            contacts.efc_address, contacts.dim, contacts.mu, contacts.friction, strict=True
        ):
            if first >= 0 and kind[first] == _CONE:
                rows.size[first : first + size] = 0
                rows.size[first], rows.limit[first] = size, mu
                rows.limit[first + 1 : first + size] = friction[: size - 1]


@compiled_without_nrt
def couple_trees(rows: ConstraintRows, joints: Joints, workspace: CouplingWorkspace) -> None:
    """Mark as touched all trees that constraints couple to touched ones, and their rows as coupled."""
    touched, tree = workspace.touched, joints.tree
    for i in range(rows.total[0]):
        rows.is_coupled[i] = False
    has_grown = True
    while has_grown:
        has_grown = False
        for i in range(rows.total[0]):
            if rows.is_coupled[i] or rows.size[i] == 0:
                continue
            first, end = rows.first[i], rows.first[i + rows.size[i]]
            for m in range(first, end):
                if rows.value[m] != 0.0 and touched[tree[rows.dof[m]]]:
                    rows.is_coupled[i] = True
                    break
            if rows.is_coupled[i]:
                for m in range(first, end):
                    if rows.value[m] != 0.0 and not touched[tree[rows.dof[m]]]:
                        touched[tree[rows.dof[m]]] = has_grown = True


@compiled_without_nrt
def update_forces(rows: ConstraintRows, joints: Joints, workspace: CouplingWorkspace, step_s: float) -> int:
    """Update states and forces of coupled rows at the present iterate; return a key of their states."""
    key = 1
    for i in range(rows.total[0]):
        if not rows.is_coupled[i]:
            continue
        for j in range(i, i + rows.size[i]):
            change = 0.0
            for m in range(rows.first[j], rows.first[j + 1]):
                local = workspace.local[rows.dof[m]]
                if local >= 0:
                    change += rows.value[m] * (workspace.velocity[local] - joints.velocity[rows.dof[m]])
            rows.residual[j] = change / step_s - rows.reference[j]
        if rows.kind[i] == _CONE:
            _update_cone(rows, i)
        else:
            _update_row(rows, i)
        key = (key * 31 + 3 * i + rows.state[i] + 1) % 2147483647
    return key


@compiled_without_nrt
def _update_row(rows: ConstraintRows, i: int) -> None:
    """Update state and force of row `i`, which is none of a cone."""
    force, limit = -rows.stiffness[i] * rows.residual[i], rows.limit[i]
    rows.state[i] = _STUCK
    if rows.kind[i] == _UNILATERAL and force <= 0.0:
        rows.state[i], force = _FREE, 0.0
    elif rows.kind[i] == _FRICTION_LOSS and abs(force) >= limit:
        rows.state[i], force = _SLIDING, limit if force > 0.0 else -limit
    rows.force[i] = force


@compiled_without_nrt
def _update_cone(rows: ConstraintRows, i: int) -> None:
    """Update state and forces of the elliptic cone at row `i`.

    With u₀ = μ r₀ and uⱼ = μⱼ rⱼ, u is in the cone for u₀ ≥ μ |u'|, in the dual cone for μ u₀ ≤ -|u'|.
    Between, the force is the negative gradient of ½ D₀ (u₀ - μ |u'|)² / (μ² (1 + μ²)).
    """
    mu, normal = rows.limit[i], rows.limit[i] * rows.residual[i]
    slip = _slip(rows, i)
    rows.state[i] = _SLIDING
    if normal >= mu * slip:
        rows.state[i] = _FREE
    elif mu * normal + slip <= 0.0:
        rows.state[i] = _STUCK
    outside = rows.stiffness[i] / (mu * mu * (1.0 + mu * mu)) * (normal - mu * slip)
    for j in range(i, i + rows.size[i]):
        if rows.state[i] == _FREE:
            rows.force[j] = 0.0
        elif rows.state[i] == _STUCK:
            rows.force[j] = -rows.stiffness[j] * rows.residual[j]
        elif j == i:
            rows.force[j] = -outside * mu
        else:
            rows.force[j] = outside * mu * rows.limit[j] * rows.limit[j] * rows.residual[j] / slip


@compiled_without_nrt
def _slip(rows: ConstraintRows, i: int) -> float:
    """Length |u'| of the tangential part of the cone at row `i`."""
    square = 0.0
    for j in range(i + 1, i + rows.size[i]):
        scaled = rows.limit[j] * rows.residual[j]
        square += scaled * scaled
    return float(np.sqrt(square))


@compiled_without_nrt
def _fill_curvature(rows: ConstraintRows, i: int) -> None:
    """Fill the curvature of the elliptic cone at row `i`, which slides: that of its convex function."""
    mu, slip, curvature = rows.limit[i], _slip(rows, i), rows.curvature
    scale = rows.stiffness[i] / (mu * mu * (1.0 + mu * mu))
    outside = mu * rows.residual[i] - mu * slip
    for j in range(rows.size[i]):
        along = rows.limit[i + j] * rows.limit[i + j] * rows.residual[i + j] / slip
        gradient = mu if j == 0 else -mu * along
        for k in range(j + 1):
            other = rows.limit[i + k] * rows.limit[i + k] * rows.residual[i + k] / slip
            entry = gradient * (mu if k == 0 else -mu * other)
            if k > 0:
                bend = (rows.limit[i + j] * rows.limit[i + j] if j == k else 0.0) - along * other
                entry -= mu * outside * bend / slip
            curvature[j, k] = curvature[k, j] = scale * entry


@compiled_without_nrt
def add_constraints(
    rows: ConstraintRows, workspace: CouplingWorkspace, step_s: float, with_matrix: bool
) -> None:
    """Add h Jᵀ f of coupled rows to the residual and, if wanted, Jᵀ (-df/dr) J to the matrix."""
    for i in range(rows.total[0]):
        if not rows.is_coupled[i] or rows.state[i] == _FREE:
            continue
        end = i + rows.size[i]
        for j in range(i, end):
            for m in range(rows.first[j], rows.first[j + 1]):
                local = workspace.local[rows.dof[m]]
                if local >= 0:
                    workspace.residual[local] += step_s * rows.value[m] * rows.force[j]
        if not with_matrix:
            continue
        if rows.state[i] == _STUCK:
            for j in range(i, end):
                _add_product(rows, workspace, j, j, rows.stiffness[j])
        elif rows.kind[i] == _CONE:
            _fill_curvature(rows, i)
            for j in range(i, end):
                for k in range(i, end):
                    _add_product(rows, workspace, j, k, rows.curvature[j - i, k - i])


@compiled_without_nrt
def _add_product(rows: ConstraintRows, workspace: CouplingWorkspace, j: int, k: int, weight: float) -> None:
    """Add the product of rows `j` and `k` of J, times `weight`, to the matrix."""
    for m in range(rows.first[j], rows.first[j + 1]):
        a = workspace.local[rows.dof[m]]
        if a < 0 or rows.value[m] == 0.0:
            continue
        for q in range(rows.first[k], rows.first[k + 1]):
            b = workspace.local[rows.dof[q]]
            if 0 <= b <= a:
                workspace.matrix[a, b] += weight * rows.value[m] * rows.value[q]
