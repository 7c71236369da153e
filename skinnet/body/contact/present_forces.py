"""Forces of the foam at the present positions and velocities, on the points of one cell against one body."""

from skinnet.body.contact.contact_problem import ContactProblem
from skinnet.body.contact.foam import SHEAR_STIFFNESS_RATIO, friction_force, limited_friction
from skinnet.body.contact.foam_curve import compressed_state
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.point_kinematics import CellTwist
from skinnet.body.contact.point_loops import (
    Resultant,
    any_slips,
    fill_heights,
    fill_normal_forces,
    sum_forces,
)
from skinnet.compilation import compiled_inline, compiled_without_nrt

__all__ = ["press_cell", "press_points", "release_shear"]


@compiled_inline
def release_shear(problem: ContactProblem, cell: int, first: int, last: int) -> None:
    """Forget shear and memory of the samples of cell `cell` that none of points `first` to `last` presses."""
    shear_m, points, m = problem.contact.shear_m, problem.points, first
    for s in range(problem.surface.grid.n_samples):
        is_pressed = False
        while m < last and points.sample[m] == s:
            is_pressed = is_pressed or points.depth_m[m] > 0.0
            m += 1
        if not is_pressed:
            shear_m[cell, 0, s] = shear_m[cell, 1, s] = 0.0
            if problem.foam.reversal_m > 0.0:
                problem.contact.play_m[cell, s] = -problem.foam.reversal_m


@compiled_without_nrt
def press_cell(
    problem: ContactProblem, twist: CellTwist, step_s: float, cell: int, first: int, last: int
) -> tuple[Resultant, float]:
    """As `press_points`, of a whole cell of linear foam; samples that nothing presses forget their shear."""
    foam, scene, points = problem.foam, problem.scene, problem.points
    n_taxels, scratch, n = problem.surface.n_taxels, problem.workspace.at_point, last - first
    share = scene.foam_fraction[points.solid[first]]
    give_m = scene.max_indentation_m[points.solid[first]]
    x_m, y_m, area_m2 = points.x_m[first:last], points.y_m[first:last], points.area_m2[first:last]
    depth_m, height_m = points.depth_m[first:last], points.height_m[first:last]
    shear_x_m, shear_y_m = problem.contact.shear_m[cell, 0], problem.contact.shear_m[cell, 1]
    x_n, y_n, normal_n = scratch[0, :n], scratch[1, :n], scratch[2, :n]
    stiffness = SHEAR_STIFFNESS_RATIO * foam.stiffness_pa_per_m
    damping = SHEAR_STIFFNESS_RATIO * foam.damping_pa_s_per_m
    vx, vy, _, wx, wy, wz = twist
    fill_heights(foam.thickness_m, share, give_m, depth_m, height_m)
    fill_normal_forces(
        twist,
        foam.stiffness_pa_per_m,
        foam.damping_pa_s_per_m,
        share,
        x_m,
        y_m,
        area_m2,
        depth_m,
        normal_n,
    )
    for i in range(len(depth_m)):
        moved_m = shear_x_m[i] + (vx + wy * height_m[i] - wz * y_m[i]) * step_s
        shear_x_m[i] = moved_m if depth_m[i] > 0.0 else 0.0
    for i in range(len(depth_m)):
        moved_m = shear_y_m[i] + (vy + wz * x_m[i] - wx * height_m[i]) * step_s
        shear_y_m[i] = moved_m if depth_m[i] > 0.0 else 0.0
    for i in range(len(depth_m)):
        slip_x, area = vx + wy * height_m[i] - wz * y_m[i], share * area_m2[i]
        sheared_n = -(stiffness * area) * shear_x_m[i] - damping * area * slip_x
        x_n[i] = sheared_n if depth_m[i] > 0.0 else 0.0
    for i in range(len(depth_m)):
        slip_y, area = vy + wz * x_m[i] - wx * height_m[i], share * area_m2[i]
        sheared_n = -(stiffness * area) * shear_y_m[i] - damping * area * slip_y
        y_n[i] = sheared_n if depth_m[i] > 0.0 else 0.0
    slid_n_m = 0.0
    if any_slips(foam.friction, normal_n, x_n, y_n):
        for i in range(len(depth_m)):
            limit_n, area = foam.friction * normal_n[i], share * area_m2[i]
            if abs(x_n[i]) + abs(y_n[i]) > limit_n:
                x_n[i], y_n[i], shear_x_m[i], shear_y_m[i], slid_m = limited_friction(
                    limit_n, stiffness * area, x_n[i], y_n[i], shear_x_m[i], shear_y_m[i]
                )
                slid_n_m += normal_n[i] * slid_m
    for e in range(n_taxels):
        taxel_n = problem.contact.force_n[cell, e]
        taxel = normal_n[e * len(depth_m) // n_taxels : (e + 1) * len(depth_m) // n_taxels]
        for i in range(len(taxel)):
            taxel_n += taxel[i]
        problem.contact.force_n[cell, e] = taxel_n
    return sum_forces(x_m, y_m, height_m, depth_m, area_m2, normal_n, x_n, y_n), slid_n_m


@compiled_without_nrt
def press_points(
    problem: ContactProblem,
    twist: CellTwist,
    step_s: float,
    cell: int,
    cell_first: int,
    first: int,
    last: int,
) -> tuple[Resultant, float]:
    """Press points `first` to `last`, a run of `cell`, whose points begin with `cell_first`.

    Returns:
        Resultant, and the sum of normal force times sliding distance [N m].
    """
    foam, contact, points, scene = problem.foam, problem.contact, problem.points, problem.scene
    per_element = problem.surface.grid.n_samples // problem.surface.n_taxels
    share = scene.foam_fraction[points.solid[first]]
    give_m = scene.max_indentation_m[points.solid[first]]
    vx, vy, vz, wx, wy, wz = twist
    force_x = force_y = force_z = moment_x = moment_y = moment_z = pressed_m2 = slid_n_m = 0.0
    e, has_curve = 0, len(foam.curve) > 0  # force cell of the sample
    for m in range(first, last):
        depth_m, s = points.depth_m[m], points.sample[m]
        if depth_m <= 0.0:
            points.height_m[m] = foam.thickness_m
            continue
        indented_m, elastic_pa = (1.0 - share) * depth_m, foam.stiffness_pa_per_m * depth_m
        damping_pa_s_per_m = foam.damping_pa_s_per_m
        if has_curve:
            indented_m, elastic_pa, damping_pa_s_per_m = compressed_state(
                foam, depth_m, share, contact.play_m, cell, s
            )
        h = foam.thickness_m - depth_m + min(indented_m, give_m)
        points.height_m[m] = h
        a, b, area = points.x_m[m], points.y_m[m], points.area_m2[m]
        rate_m_s = -(vz + wx * b - wy * a)
        normal_n = area * max(0.0, share * (elastic_pa + damping_pa_s_per_m * rate_m_s))
        slip_x, slip_y = vx + wy * h - wz * b, vy + wz * a - wx * h
        passed_s = 0.0 if _has_moved(points, cell_first, m) else step_s
        shear_x = contact.shear_m[cell, 0, s] + slip_x * passed_s
        shear_y = contact.shear_m[cell, 1, s] + slip_y * passed_s
        fx, fy, shear_x, shear_y, slid_m = friction_force(
            foam, share * area, normal_n, slip_x, slip_y, shear_x, shear_y
        )
        contact.shear_m[cell, 0, s], contact.shear_m[cell, 1, s] = shear_x, shear_y
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
    return Resultant(force_x, force_y, force_z, moment_x, moment_y, moment_z, pressed_m2), slid_n_m


@compiled_inline
def _has_moved(points: LoadedPoints, cell_first: int, m: int) -> bool:
    """True if an earlier point of the cell, from `cell_first` on, presses the sample of point `m` as well.

    Its shear went on with that one.
    """
    i = m - 1
    while i >= cell_first and points.sample[i] == points.sample[m]:
        if points.depth_m[i] > 0.0:
            return True
        i -= 1
    return False
