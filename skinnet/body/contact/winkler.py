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
from skinnet.body.contact.foam import friction_force
from skinnet.body.contact.foam_curve import compressed_state
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.point_kinematics import Motion, cell_axis, point_above_cell, point_velocity
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
    points.total[0] = points.lost[0] = 0
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
    contact, points = problem.contact, problem.points
    first = points.total[0]
    if n_close > 0:
        find_loaded_points(problem, cell, n_close, face_m)
    contact.in_contact[cell] = False
    contact.contact_temperature_c[cell] = math.nan
    for e in range(problem.surface.n_taxels):
        contact.force_n[cell, e] = 0.0
    area_m2, temperature_c = 0.0, math.nan
    last = points.total[0]
    _release_shear(problem, cell, first, last)
    while first < last:
        other = problem.scene.body_id[points.solid[first]]
        end = first + 1
        while end < last and problem.scene.body_id[points.solid[end]] == other:
            end += 1
        pressed_m2 = _add_forces(problem, step_s, patch, cell, other, first, end)
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


@compiled_inline
def _release_shear(problem: ContactProblem, cell: int, first: int, last: int) -> None:
    """Forget shear and memory of the samples of cell `cell` that none of points `first` to `last` presses."""
    shear_m, points, m = problem.contact.shear_m, problem.points, first
    for s in range(problem.surface.grid.n_samples):
        is_pressed = False
        while m < last and points.sample[m] == s:
            is_pressed = is_pressed or points.depth_m[m] > 0.0
            m += 1
        if not is_pressed:
            shear_m[cell, s, 0] = shear_m[cell, s, 1] = 0.0
            if problem.foam.reversal_m > 0.0:
                problem.contact.play_m[cell, s] = -problem.foam.reversal_m


@compiled_inline
def _add_forces(
    problem: ContactProblem, step_s: float, patch: int, cell: int, other: int, first: int, last: int
) -> float:
    """Add the forces at points `first` to `last`, all of one cell and against body `other`.

    Returns:
        Area that is pressed [m²].
    """
    surface, motion, foam, contact = problem.surface, problem.motion, problem.foam, problem.contact
    points, scene = problem.points, problem.scene
    own, per_element = surface.body_id[cell], surface.grid.n_samples // surface.n_taxels
    x, y, z = point_above_cell(surface, motion, cell, 0.0)
    xx, xy, xz = cell_axis(surface, motion, cell, 0)
    yx, yy, yz = cell_axis(surface, motion, cell, 1)
    nx, ny, nz = cell_axis(surface, motion, cell, 2)
    u, v, w = _relative_spin(motion, own, other)
    wx, wy, wz = u * xx + v * xy + w * xz, u * yx + v * yy + w * yz, u * nx + v * ny + w * nz
    u, v, w = point_velocity(motion, other, x, y, z)
    vx, vy, vz = point_velocity(motion, own, x, y, z)
    u, v, w = u - vx, v - vy, w - vz
    vx, vy, vz = u * xx + v * xy + w * xz, u * yx + v * yy + w * yz, u * nx + v * ny + w * nz
    force_x = force_y = force_z = moment_x = moment_y = moment_z = pressed_m2 = slid_n_m = 0.0
    e, has_curve = 0, len(foam.curve) > 0  # force cell of the sample
    for m in range(first, last):
        depth_m, s, k = points.depth_m[m], points.sample[m], points.solid[m]
        share, give_m = scene.foam_fraction[k], scene.max_indentation_m[k]
        h = foam.thickness_m - depth_m
        if depth_m <= 0.0:
            points.height_m[m] = foam.thickness_m
            continue
        indented_m, elastic_pa = (1.0 - share) * depth_m, foam.stiffness_pa_per_m * depth_m
        damping_pa_s_per_m = foam.damping_pa_s_per_m
        if has_curve:
            indented_m, elastic_pa, damping_pa_s_per_m = compressed_state(
                foam, depth_m, share, contact.play_m, cell, s
            )
        h += min(indented_m, give_m)
        points.height_m[m] = h
        a, b, area = points.x_m[m], points.y_m[m], points.area_m2[m]
        rate_m_s = -(vz + wx * b - wy * a)
        normal_n = area * max(0.0, share * (elastic_pa + damping_pa_s_per_m * rate_m_s))
        slip_x, slip_y = vx + wy * h - wz * b, vy + wz * a - wx * h
        passed_s = 0.0 if _has_moved(points, m) else step_s
        shear_x = contact.shear_m[cell, s, 0] + slip_x * passed_s
        shear_y = contact.shear_m[cell, s, 1] + slip_y * passed_s
        fx, fy, shear_x, shear_y, slid_m = friction_force(
            foam, share * area, normal_n, slip_x, slip_y, shear_x, shear_y
        )
        contact.shear_m[cell, s, 0], contact.shear_m[cell, s, 1] = shear_x, shear_y
        force_x += fx
        force_y += fy
        force_z += normal_n
        moment_x += b * normal_n - h * fy
        moment_y += h * fx - a * normal_n
        moment_z += a * fy - b * fx
        while s >= (e + 1) * per_element:
            e += 1
        contact.force_n[cell, e] += normal_n
        slid_n_m += normal_n * slid_m
        pressed_m2 += area
    contact.body_normal_force_n[other] += force_z
    contact.patch_body_force_n[patch, other] += force_z
    contact.force_weighted_slip_n_m[other] += slid_n_m
    u = force_x * xx + force_y * yx + force_z * nx
    v = force_x * xy + force_y * yy + force_z * ny
    w = force_x * xz + force_y * yz + force_z * nz
    mx = moment_x * xx + moment_y * yx + moment_z * nx
    my = moment_x * xy + moment_y * yy + moment_z * ny
    mz = moment_x * xz + moment_y * yz + moment_z * nz
    _add_wrench(motion.xipos, problem.wrench, other, 1.0, x, y, z, u, v, w, mx, my, mz)
    _add_wrench(motion.xipos, problem.wrench, own, -1.0, x, y, z, u, v, w, mx, my, mz)
    return pressed_m2


@compiled_inline
def _has_moved(points: LoadedPoints, m: int) -> bool:
    """True if an earlier point presses the sample of point `m` as well: its shear went on with that one."""
    i = m - 1
    while i >= 0 and points.cell[i] == points.cell[m] and points.sample[i] == points.sample[m]:
        if points.depth_m[i] > 0.0:
            return True
        i -= 1
    return False


@compiled_without_nrt
def _relative_spin(motion: Motion, own: int, other: int) -> tuple[float, float, float]:
    """Angular velocity [rad/s] of body `other` relative to body `own`, world."""
    twist = motion.cvel
    return (
        twist[other, 0] - twist[own, 0],
        twist[other, 1] - twist[own, 1],
        twist[other, 2] - twist[own, 2],
    )


@compiled_inline
def _add_wrench(
    xipos: Floats,
    wrench: Floats,
    b: int,
    sign: float,
    x: float,
    y: float,
    z: float,
    fx: float,
    fy: float,
    fz: float,
    mx: float,
    my: float,
    mz: float,
) -> None:
    """Add a force [N] at (x, y, z) [m] and a moment [N m], world, with a sign, to the wrench of body `b`."""
    rx, ry, rz = x - xipos[b, 0], y - xipos[b, 1], z - xipos[b, 2]
    wrench[b, 0] += sign * fx
    wrench[b, 1] += sign * fy
    wrench[b, 2] += sign * fz
    wrench[b, 3] += sign * (mx + ry * fz - rz * fy)
    wrench[b, 4] += sign * (my + rz * fx - rx * fz)
    wrench[b, 5] += sign * (mz + rx * fy - ry * fx)
