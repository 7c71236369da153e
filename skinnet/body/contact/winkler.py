"""Elastic-foundation (Winkler) contact between the skin and nearby geoms.

MuJoCo's contacts give a cylinder on a box two points; force cells need a pressure field. So the foam of
every cell is sampled (`cell_loading`). Where a solid penetrates its face by the depth d, the pressure is

    p = max(0, k d + c ḋ),    d ≤ thickness.

or with the elastic part k d from a curve with hysteresis (`foam_curve`).
An elastic solid is a second spring in series: k and c are scaled by the foam's fraction of d, the solid's
face recedes by the rest, and d may exceed the thickness by as much. Friction is shear of the foam
(`foam`). Forces act on both bodies, equal and opposite, at the same point. When the foam
is fully compressed, MuJoCo's own contact takes over at the rigid surface.
"""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact.broad_phase import collect_active_cells, keep_active
from skinnet.body.contact.cell_loading import find_loaded_points
from skinnet.body.contact.contact_problem import RAY_START_DEPTH_M, ContactProblem
from skinnet.body.contact.contact_scene import ContactScene, may_intersect_sphere, solids_near_patch
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.point_kinematics import (
    CellFrame,
    CellTwist,
    Motion,
    cell_frame,
    point_above_cell,
    point_velocity,
    to_world,
    twist_in_cell,
)
from skinnet.body.contact.point_loops import Resultant
from skinnet.body.contact.present_forces import press_cell, press_points, release_shear
from skinnet.compilation import compiled_inline, compiled_without_nrt

__all__ = ["compute_contact"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MIN_APPROACH_M_S = 0.02
"""Speed [m/s] that a body at rest may reach in a step."""
_MAX_REACH_M = 0.01
"""Largest distance [m] from the face of the foam at which solids are sought for the coming step."""


@compiled_without_nrt
def compute_contact(problem: ContactProblem, step_s: float) -> int:
    """Compute contact of all cells with the solids near them; return the number of cells in contact.

    Shear displacement is integrated over `step_s` [s].
    """
    surface, scene, motion, foam = problem.surface, problem.scene, problem.motion, problem.foam
    contact, points, workspace = problem.contact, problem.points, problem.workspace
    points.total[0] = points.lost[0] = points.n_runs[0] = 0
    contact.body_normal_force_n[:] = 0.0
    contact.patch_body_force_n[:] = 0.0
    contact.peak_force_n[0] = 0.0
    contact.force_weighted_slip_n_m[:] = 0.0
    below_m = RAY_START_DEPTH_M + scene.largest_indentation_m
    face_m = foam.thickness_m + _reach_m(scene, motion, step_s)
    half_m = 0.5 * (face_m + below_m)
    corner_m = 0.0  # distance of the outline from the centre of the cell
    for s in range(surface.grid.n_corners):
        corner_m = max(corner_m, pinned_math.hypot(surface.grid.x_m[s], surface.grid.y_m[s]))
    ball_m = pinned_math.hypot(corner_m, half_m)
    reach_m = abs(half_m - below_m) + ball_m
    touching = 0
    for p in range(len(surface.patch_body_id)):
        near, active = workspace.near, workspace.active
        n_near = solids_near_patch(surface, scene, motion, p, reach_m, near)
        n_active = collect_active_cells(surface, scene, motion, p, reach_m, near, n_near, active)
        for row in range(n_active):
            i = active.row[row]
            n_close = _collect_close_solids(problem, i, n_near, half_m - below_m, ball_m)
            if n_close == 0 and not contact.in_contact[i]:
                continue
            _compute_cell_contact(problem, step_s, face_m, p, i, n_close)
            if contact.in_contact[i]:
                touching += 1
                keep_active(active, p, i)
    return touching


@compiled_without_nrt
def _collect_close_solids(
    problem: ContactProblem, cell: int, n_near: int, height_m: float, radius_m: float
) -> int:
    """Collect those of the solids near the patch that may be close to `cell`; return their number.

    Close is what may intersect the ball of `radius_m` about the point `height_m` above the cell [m].
    """
    scene, motion, near = problem.scene, problem.motion, problem.workspace.near
    x, y, z = point_above_cell(problem.surface, motion, cell, height_m)
    n_close = 0
    for j in range(n_near):
        if may_intersect_sphere(scene, motion, near[j], x, y, z, radius_m):
            problem.workspace.close[n_close] = near[j]
            n_close += 1
    return n_close


@compiled_inline
def _reach_m(scene: ContactScene, motion: Motion, step_s: float) -> float:
    """Distance [m] from the face of the foam within which a solid may come into contact in the next step."""
    fastest_m_s = _MIN_APPROACH_M_S
    for k in range(len(scene.geom_id)):
        b = scene.body_id[k]
        vx, vy, vz = point_velocity(motion, b, motion.xipos[b, 0], motion.xipos[b, 1], motion.xipos[b, 2])
        wx, wy, wz = motion.cvel[b, 0], motion.cvel[b, 1], motion.cvel[b, 2]
        spin = math.sqrt(wx * wx + wy * wy + wz * wz) * scene.bounding_radius_m[k]
        fastest_m_s = max(fastest_m_s, math.sqrt(vx * vx + vy * vy + vz * vz) + spin)
    return min(2.0 * fastest_m_s * step_s, _MAX_REACH_M)


@compiled_without_nrt
def _compute_cell_contact(
    problem: ContactProblem, step_s: float, face_m: float, patch: int, cell: int, n_close: int
) -> None:
    """Compute contact forces of cell `cell`, of patch `patch`, with the solids close to it.

    Solids are sought up to the height `face_m` [m], which the step may bring into contact.
    """
    contact, points, is_whole = problem.contact, problem.points, False
    cell_first = first = points.total[0]
    if n_close > 0:
        is_whole = find_loaded_points(problem, cell, n_close, face_m)
    last = points.total[0]
    if first == last and not contact.in_contact[cell]:
        return
    contact.in_contact[cell] = False
    contact.contact_temperature_c[cell] = math.nan
    for e in range(problem.surface.n_taxels):
        contact.force_n[cell, e] = 0.0
    area_m2, temperature_c = 0.0, math.nan
    if not is_whole or len(problem.foam.curve) > 0:
        release_shear(problem, cell, first, last)
    while first < last:
        other = problem.scene.body_id[points.solid[first]]
        end = last if is_whole else first + 1
        while end < last and problem.scene.body_id[points.solid[end]] == other:
            end += 1
        _add_run(points, cell, other, is_whole, first)
        pressed_m2 = _add_forces(problem, step_s, patch, cell, other, is_whole, cell_first, first, end)
        if pressed_m2 > 0.0:
            area_m2 += pressed_m2
            other_c = problem.temperature_c[other]
            known_c = temperature_c if area_m2 > pressed_m2 else other_c
            temperature_c = known_c + (other_c - known_c) * pressed_m2 / area_m2
        first = end
    if area_m2 > 0.0:
        contact.in_contact[cell] = True
        contact.contact_temperature_c[cell] = temperature_c
        for e in range(problem.surface.n_taxels):
            contact.peak_force_n[0] = max(contact.peak_force_n[0], contact.force_n[cell, e])


@compiled_without_nrt
def _add_run(points: LoadedPoints, cell: int, other: int, is_whole: bool, first: int) -> None:
    """Add a run of points, from `first` on, of `cell` against body `other`."""
    r = points.n_runs[0]
    points.run_first[r], points.run_first[r + 1] = first, points.total[0]
    points.run_cell[r], points.run_body[r], points.run_is_whole[r] = cell, other, is_whole
    points.n_runs[0] = r + 1


@compiled_without_nrt
def _add_forces(
    problem: ContactProblem,
    step_s: float,
    patch: int,
    cell: int,
    other: int,
    is_whole: bool,
    cell_first: int,
    first: int,
    last: int,
) -> float:
    """Add the forces at points `first` to `last`, a run of `cell` against body `other`.

    The points of the cell begin with `cell_first`.

    Returns:
        Area that is pressed [m²].
    """
    surface, motion, contact = problem.surface, problem.motion, problem.contact
    own, f = surface.body_id[cell], cell_frame(surface, motion, cell)
    twist = _relative_twist(motion, f, own, other)
    if is_whole and len(problem.foam.curve) == 0:
        total, slid_n_m = press_cell(problem, twist, step_s, cell, first, last)
    else:
        total, slid_n_m = press_points(problem, twist, step_s, cell, cell_first, first, last)
    contact.body_normal_force_n[other] += total.force_z
    contact.patch_body_force_n[patch, other] += total.force_z
    contact.force_weighted_slip_n_m[other] += slid_n_m
    _add_wrenches(problem, f, total, own, other)
    return total.pressed_m2


@compiled_without_nrt
def _relative_twist(motion: Motion, f: CellFrame, own: int, other: int) -> CellTwist:
    """Twist of body `other` relative to a cell of body `own`, at the centre of its frame `f`."""
    twist = motion.cvel
    vx, vy, vz = point_velocity(motion, other, f.x, f.y, f.z)
    ux, uy, uz = point_velocity(motion, own, f.x, f.y, f.z)
    return twist_in_cell(
        f,
        vx - ux,
        vy - uy,
        vz - uz,
        twist[other, 0] - twist[own, 0],
        twist[other, 1] - twist[own, 1],
        twist[other, 2] - twist[own, 2],
    )


@compiled_without_nrt
def _add_wrenches(problem: ContactProblem, f: CellFrame, total: Resultant, own: int, other: int) -> None:
    """Add a resultant in the frame `f` of a cell to the wrench of body `other`, the opposite to `own`'s."""
    fx, fy, fz = to_world(f, total.force_x, total.force_y, total.force_z)
    mx, my, mz = to_world(f, total.moment_x, total.moment_y, total.moment_z)
    wrench, xipos = problem.wrench, problem.motion.xipos
    for side in range(2):
        b, sign = (other, 1.0) if side == 0 else (own, -1.0)
        rx, ry, rz = f.x - xipos[b, 0], f.y - xipos[b, 1], f.z - xipos[b, 2]
        wrench[b, 0] += sign * fx
        wrench[b, 1] += sign * fy
        wrench[b, 2] += sign * fz
        wrench[b, 3] += sign * (mx + ry * fz - rz * fy)
        wrench[b, 4] += sign * (my + rz * fx - rx * fz)
        wrench[b, 5] += sign * (mz + rx * fy - ry * fx)
