"""Elastic-foundation (Winkler) contact between the skin and nearby geoms.

MuJoCo's contacts give a cylinder on a box two points; force cells need a pressure field. So every cell
samples its foam at s points. Where a solid penetrates the face of the foam by the depth d, the pressure is

    p = max(0, k d + c ḋ),    d ≤ thickness.

or with the elastic part k d from a curve with hysteresis (`foam_curve`).
An elastic solid is a second spring in series: k and c are scaled by the foam's fraction of d, the solid's
face recedes by the rest, and d may exceed the thickness by as much. Friction is shear of the foam
(`foam`). Forces act on both bodies, equal and opposite, at the same point. When the foam
is fully compressed, MuJoCo's own contact takes over at the rigid surface.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact.broad_phase import ActiveCells, collect_active_cells, keep_active
from skinnet.body.contact.contact_scene import (
    ContactScene,
    may_intersect_sphere,
    solids_near_patch,
    world_to_solid,
)
from skinnet.body.contact.convex_hull import hull_entry
from skinnet.body.contact.foam import Foam, friction_force
from skinnet.body.contact.foam_curve import compressed_state
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.point_kinematics import (
    Motion,
    cell_axis,
    point_above_cell,
    point_velocity,
    rotate_inverse,
)
from skinnet.body.contact.ray_casting import MESH, entry_distance_m
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt

__all__ = ["RAY_START_DEPTH_M", "ContactProblem", "ContactState", "Workspace", "compute_contact"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

RAY_START_DEPTH_M = 0.004
"""Start of rays [m] below the rigid surface: a solid that penetrates this far still counts as in contact."""
_MIN_APPROACH_M_S = 0.02
"""Speed [m/s] that a body at rest may reach in a step."""
_MAX_REACH_M = 0.01
"""Largest distance [m] from the face of the foam at which solids are sought for the coming step."""


class ContactState(NamedTuple):
    """Contact state of a foundation at the present time.

    Attributes:
        force_n: (n, e) normal force on each force cell [N].
        contact_temperature_c: (n,) mean temperature of the bodies on a cell [°C]; NaN without contact.
        body_normal_force_n: (nbody,) normal force of all cells on each body, sum of magnitudes [N].
        patch_body_force_n: (p, nbody) normal force of each patch on each body, sum of magnitudes [N].
        peak_force_n: (1,) the largest force on any force cell [N].
        force_weighted_slip_n_m: (nbody,) sliding distance of each body over the skin in this step times
            normal force [N m]; μ times this is the work of sliding friction.
        shear_m: (n, s, 2) shear displacement of the foam at each point, plane of the cell [m].
        play_m: (n, s) memory of foam with hysteresis (`foam_curve`) at each point [m]; else without entries.
        in_contact: (n,) True for cells in contact.
    """

    force_n: Floats
    contact_temperature_c: Floats
    body_normal_force_n: Floats
    patch_body_force_n: Floats
    peak_force_n: Floats
    force_weighted_slip_n_m: Floats
    shear_m: Floats
    play_m: Floats
    in_contact: NDArray[np.bool_]


class Workspace(NamedTuple):
    """Scratch arrays of one call: solids near a patch, close to a cell, first hit and distance per point.

    The active cells are those of one patch; between calls they are the cells in contact.
    """

    near: Indices
    active: ActiveCells
    close: Indices
    hit: Indices
    nearest_m: Floats


class ContactProblem(NamedTuple):
    """Contact of a skin with the solids of one simulation: what is given, and what is computed.

    Compiled code takes it as a `reference`.

    Attributes:
        surface: The cells.
        scene: The solids.
        motion: Poses and velocities now.
        foam: Material of the foam.
        temperature_c: (nbody,) temperatures of the bodies [°C].
        contact: Contact state, overwritten; shear is updated.
        wrench: (nbody, 6) forces [N] and moments [N m] on the bodies about their centres of mass; added to.
        points: Loaded points, overwritten.
        start_depth_m: (n,) largest depth below the rigid surface at which rays start [m].
        workspace: Scratch arrays.
    """

    surface: SkinSurface
    scene: ContactScene
    motion: Motion
    foam: Foam
    temperature_c: Floats
    contact: ContactState
    wrench: Floats
    points: LoadedPoints
    start_depth_m: Floats
    workspace: Workspace


@compiled_without_nrt
def compute_contact(problem: ContactProblem, step_s: float) -> int:
    """Compute contact of all cells with the solids near them; return the number of cells in contact.

    Shear displacement is integrated over `step_s` [s].
    """
    surface, scene, motion, foam = problem.surface, problem.scene, problem.motion, problem.foam
    contact, points, workspace = problem.contact, problem.points, problem.workspace
    points.total[0] = 0
    contact.body_normal_force_n[:] = 0.0
    contact.patch_body_force_n[:] = 0.0
    contact.peak_force_n[0] = 0.0
    contact.force_weighted_slip_n_m[:] = 0.0
    below_m = RAY_START_DEPTH_M + scene.largest_indentation_m
    face_m = foam.thickness_m + _reach_m(scene, motion, step_s)
    half_m = 0.5 * (face_m + below_m)
    corner_m = 0.0  # largest distance of a sample point from the centre of the cell
    for s in range(len(surface.sample_m)):
        corner_m = max(corner_m, pinned_math.hypot(surface.sample_m[s, 0], surface.sample_m[s, 1]))
    ball_m = pinned_math.hypot(corner_m, half_m)
    reach_m = abs(half_m - below_m) + ball_m
    touching = 0
    for p in range(len(surface.patch_body_id)):
        near, active = workspace.near, workspace.active
        n_near = solids_near_patch(surface, scene, motion, p, reach_m, near)
        n_active = collect_active_cells(surface, scene, motion, p, reach_m, near, n_near, active)
        for row in range(n_active):
            i, n_close = active.row[row], 0
            if n_near > 0:
                x, y, z = point_above_cell(surface, motion, i, half_m - below_m)
                for j in range(n_near):
                    if may_intersect_sphere(scene, motion, workspace.near[j], x, y, z, ball_m):
                        workspace.close[n_close] = workspace.near[j]
                        n_close += 1
            if n_close == 0 and not contact.in_contact[i]:
                continue
            _compute_cell_contact(problem, step_s, face_m, p, i, n_close)
            if contact.in_contact[i]:
                touching += 1
                keep_active(active, p, i)
    return touching


@compiled_without_nrt
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
def _add_force(
    xipos: Floats, wrench: Floats, b: int, x: float, y: float, z: float, fx: float, fy: float, fz: float
) -> None:
    """Add the force (fx, fy, fz) [N] at the point (x, y, z) [m], world, to the wrench of body `b`."""
    rx, ry, rz = x - xipos[b, 0], y - xipos[b, 1], z - xipos[b, 2]
    wrench[b, 0] += fx
    wrench[b, 1] += fy
    wrench[b, 2] += fz
    wrench[b, 3] += ry * fz - rz * fy
    wrench[b, 4] += rz * fx - rx * fz
    wrench[b, 5] += rx * fy - ry * fx


@compiled_without_nrt
def _cast_rays(
    surface: SkinSurface,
    scene: ContactScene,
    motion: Motion,
    i: int,
    k: int,
    limit_m: float,
    hit: Indices,
    nearest_m: Floats,
) -> None:
    """Cast rays from the points of cell `i` at solid `k`; update `hit` and `nearest_m` where it is nearer.

    Heights count from `RAY_START_DEPTH_M` below the rigid surface; a compliant solid may lie deeper.
    No ray starts below `limit_m` [m], where it would meet what presses the other side of a thin link.
    """
    g, axes, give_m = scene.geom_id[k], motion.geom_xmat, scene.max_indentation_m[k]
    start_m = min(RAY_START_DEPTH_M + give_m, limit_m)
    above_m = RAY_START_DEPTH_M - start_m
    x, y, z = point_above_cell(surface, motion, i, -start_m)
    ox, oy, oz = world_to_solid(scene, motion, k, x, y, z)
    u, v, w = cell_axis(surface, motion, i, 0)
    xx, xy, xz = rotate_inverse(axes, g, u, v, w)
    u, v, w = cell_axis(surface, motion, i, 1)
    yx, yy, yz = rotate_inverse(axes, g, u, v, w)
    u, v, w = cell_axis(surface, motion, i, 2)
    nx, ny, nz = rotate_inverse(axes, g, u, v, w)
    kind, size_a, size_b, size_c = (
        scene.geom_type[k],
        scene.size_m[k, 0],
        scene.size_m[k, 1],
        scene.size_m[k, 2],
    )
    triangle = -1  # where the last ray ended
    for s in range(len(surface.sample_m)):
        a, b = surface.sample_m[s, 0], surface.sample_m[s, 1]
        x, y, z = ox + a * xx + b * yx, oy + a * xy + b * yy, oz + a * xz + b * yz
        if kind == MESH:
            distance_m, triangle = hull_entry(scene.hulls, scene.hull[k], x, y, z, nx, ny, nz, triangle)
        else:
            distance_m = entry_distance_m(kind, size_a, size_b, size_c, x, y, z, nx, ny, nz)
        if distance_m + above_m < nearest_m[s]:
            hit[s], nearest_m[s] = k, distance_m + above_m


@compiled_without_nrt
def _compute_cell_contact(
    problem: ContactProblem, step_s: float, face_m: float, patch: int, cell: int, n_close: int
) -> None:
    """Compute contact forces of cell `cell`, of patch `patch`, with the solids close to it.

    Solids are sought up to the height `face_m` [m], which the step may bring into contact.
    """
    surface, scene, motion, foam = problem.surface, problem.scene, problem.motion, problem.foam
    contact, points, workspace = problem.contact, problem.points, problem.workspace
    temperature_c, wrench = problem.temperature_c, problem.wrench
    hit, nearest_m = workspace.hit, workspace.nearest_m
    hit[:], nearest_m[:] = -1, RAY_START_DEPTH_M + face_m
    limit_m = problem.start_depth_m[cell]
    for j in range(n_close):
        _cast_rays(surface, scene, motion, cell, workspace.close[j], limit_m, hit, nearest_m)
    own = surface.body_id[cell]
    area, per_element = surface.sample_area_m2, len(surface.sample_m) // surface.n_taxels
    ox, oy, oz = point_above_cell(surface, motion, cell, -RAY_START_DEPTH_M)
    xx, xy, xz = cell_axis(surface, motion, cell, 0)
    yx, yy, yz = cell_axis(surface, motion, cell, 1)
    nx, ny, nz = cell_axis(surface, motion, cell, 2)
    contact.force_n[cell, :] = 0.0
    contacts, warmth_c, has_curve = 0, 0.0, len(foam.curve) > 0
    for s in range(len(surface.sample_m)):
        depth_m = RAY_START_DEPTH_M + foam.thickness_m - nearest_m[s]
        if hit[s] < 0 or depth_m <= 0.0:
            contact.shear_m[cell, s, 0] = 0.0
            contact.shear_m[cell, s, 1] = 0.0
            if foam.reversal_m > 0.0:
                contact.play_m[cell, s] = -foam.reversal_m
            if hit[s] >= 0:
                _add_point(points, cell, s, hit[s], depth_m, foam.thickness_m)
            continue
        a, c = surface.sample_m[s, 0], surface.sample_m[s, 1]
        x, y, z = ox + a * xx + c * yx, oy + a * xy + c * yy, oz + a * xz + c * yz
        k = hit[s]
        other, share, give_m = scene.body_id[k], scene.foam_fraction[k], scene.max_indentation_m[k]
        lift_m = max(nearest_m[s], RAY_START_DEPTH_M - give_m)
        depth_m = RAY_START_DEPTH_M + foam.thickness_m - lift_m
        indented_m, elastic_pa = (1.0 - share) * depth_m, foam.stiffness_pa_per_m * depth_m
        damping_pa_s_per_m = foam.damping_pa_s_per_m
        if has_curve:
            indented_m, elastic_pa, damping_pa_s_per_m = compressed_state(
                foam, depth_m, share, contact.play_m, cell, s
            )
        lift_m += min(indented_m, give_m)
        _add_point(points, cell, s, k, depth_m, lift_m - RAY_START_DEPTH_M)
        x, y, z = x + lift_m * nx, y + lift_m * ny, z + lift_m * nz
        vx, vy, vz = point_velocity(motion, other, x, y, z)
        wx, wy, wz = point_velocity(motion, own, x, y, z)
        vx, vy, vz = vx - wx, vy - wy, vz - wz
        rate_m_s = -(vx * nx + vy * ny + vz * nz)
        normal_n = area * max(0.0, share * (elastic_pa + damping_pa_s_per_m * rate_m_s))
        slip_x, slip_y = vx * xx + vy * xy + vz * xz, vx * yx + vy * yy + vz * yz
        shear_x = contact.shear_m[cell, s, 0] + slip_x * step_s
        shear_y = contact.shear_m[cell, s, 1] + slip_y * step_s
        along_x, along_y, shear_x, shear_y, slid_m = friction_force(
            foam, share * area, normal_n, slip_x, slip_y, shear_x, shear_y
        )
        contact.shear_m[cell, s, 0], contact.shear_m[cell, s, 1] = shear_x, shear_y
        fx = normal_n * nx + along_x * xx + along_y * yx
        fy = normal_n * ny + along_x * xy + along_y * yy
        fz = normal_n * nz + along_x * xz + along_y * yz
        _add_force(motion.xipos, wrench, other, x, y, z, fx, fy, fz)
        _add_force(motion.xipos, wrench, own, x, y, z, -fx, -fy, -fz)
        contact.force_n[cell, s // per_element] += normal_n
        contact.body_normal_force_n[other] += normal_n
        contact.patch_body_force_n[patch, other] += normal_n
        contact.force_weighted_slip_n_m[other] += normal_n * slid_m
        warmth_c += temperature_c[other]
        contacts += 1
    for e in range(surface.n_taxels):
        contact.peak_force_n[0] = max(contact.peak_force_n[0], contact.force_n[cell, e])
    contact.in_contact[cell] = contacts > 0
    contact.contact_temperature_c[cell] = warmth_c / contacts if contacts > 0 else math.nan


@compiled_without_nrt
def _add_point(points: LoadedPoints, cell: int, s: int, k: int, depth_m: float, height_m: float) -> None:
    """Add point `s` of cell `cell`, against solid `k`, to the loaded points."""
    m = points.total[0]
    points.cell[m], points.sample[m], points.solid[m] = cell, s, k
    points.depth_m[m], points.height_m[m] = depth_m, height_m
    points.total[0] = m + 1
