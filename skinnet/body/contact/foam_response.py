"""Response of loaded foam to the velocity of bodies: forces at the end of a step, and their derivative.

With the relative closing velocity u of a point at the end of a step h, its depth is d + h u, and

    p = max(0, k (d + h u) + c' u),    c' = max(0, c - h k).

This is the backward Euler method: the foam takes at least the energy that it stores, whatever the step. The
method damps by h k of its own, which c' leaves out of c: so the damping in all is the foam's.
A point that the step brings into contact (d < 0) is damped for that part of the step only in which it is in
contact, (d + h u) / (h u): p = max(0, (k + c' / h) (d + h u)). Shear is strained likewise.
Where foam has a curve (`foam_curve`), its elastic pressure at the end of the step stands for k (d + h u).
"""

from skinnet import pinned_math
from skinnet.body.contact.contact_problem import ContactProblem
from skinnet.body.contact.foam import SHEAR_STIFFNESS_RATIO
from skinnet.body.contact.foam_curve import closing_response, stored_energy_j_per_m2
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.pair_response import PairResponse, add_moments, add_stiffness
from skinnet.body.contact.point_kinematics import (
    CellFrame,
    CellTwist,
    cell_frame,
    point_above_cell,
    to_world,
    twist_in_cell,
)
from skinnet.body.contact.point_loops import Resultant, any_slips, sum_forces
from skinnet.compilation import compiled_without_nrt

__all__ = ["add_pairs", "add_response", "elastic_energy_j"]


@compiled_without_nrt
def add_pairs(problem: ContactProblem, pairs: PairResponse) -> None:
    """Add the pairs of bodies between which `problem` has loaded points; the first point sets the origin."""
    points = problem.points
    for r in range(points.n_runs[0]):
        own, other = problem.surface.body_id[points.run_cell[r]], points.run_body[r]
        if pairs.number[own, other] >= 0:
            continue
        p = pairs.total[0]
        if p == 0:
            x, y, z = point_above_cell(problem.surface, problem.motion, points.run_cell[r], 0.0)
            pairs.origin_m[0], pairs.origin_m[1], pairs.origin_m[2] = x, y, z
        pairs.number[own, other] = p
        pairs.body[p, 0], pairs.body[p, 1] = own, other
        pairs.total[0] = p + 1


@compiled_without_nrt
def add_response(problem: ContactProblem, pairs: PairResponse, step_s: float, with_stiffness: bool) -> None:
    """Add wrenches, and stiffnesses if wanted, of all loaded points at the relative twists of `pairs`."""
    points, body_id = problem.points, problem.surface.body_id
    for r in range(points.n_runs[0]):
        p = pairs.number[body_id[points.run_cell[r]], points.run_body[r]]
        _add_run_response(problem, pairs, p, r, step_s, with_stiffness)


@compiled_without_nrt
def _add_run_response(
    problem: ContactProblem, pairs: PairResponse, p: int, r: int, step_s: float, with_stiffness: bool
) -> None:
    """Add the response of run `r` of points, all of one cell and against one body, to pair `p`."""
    points, wrench = problem.points, pairs.wrench
    f = cell_frame(problem.surface, problem.motion, points.run_cell[r])
    rx, ry, rz = f.x - pairs.origin_m[0], f.y - pairs.origin_m[1], f.z - pairs.origin_m[2]
    twist = _twist_of_pair(pairs, p, f, rx, ry, rz)
    n, space = points.run_first[r + 1] - points.run_first[r], problem.workspace.at_point.shape[1]
    if n <= space and len(problem.foam.curve) == 0 and not with_stiffness:
        total = _press_linear(problem, twist, r, step_s)
    else:
        total = _press_points(problem, pairs, twist, r, step_s, with_stiffness)
    u, v, w = to_world(f, total.force_x, total.force_y, total.force_z)
    mx, my, mz = to_world(f, total.moment_x, total.moment_y, total.moment_z)
    wrench[p, 0] += u
    wrench[p, 1] += v
    wrench[p, 2] += w
    wrench[p, 3] += mx + ry * w - rz * v
    wrench[p, 4] += my + rz * u - rx * w
    wrench[p, 5] += mz + rx * v - ry * u
    if with_stiffness:
        add_stiffness(pairs, p, f, _mean_height_m(points, r))


@compiled_without_nrt
def _twist_of_pair(pairs: PairResponse, p: int, f: CellFrame, rx: float, ry: float, rz: float) -> CellTwist:
    """Relative twist of pair `p` at a cell of frame `f`, (rx, ry, rz) [m] from the origin."""
    twist = pairs.twist
    u, v, w = twist[p, 3], twist[p, 4], twist[p, 5]
    return twist_in_cell(
        f,
        twist[p, 0] + v * rz - w * ry,
        twist[p, 1] + w * rx - u * rz,
        twist[p, 2] + u * ry - v * rx,
        u,
        v,
        w,
    )


@compiled_without_nrt
def _mean_height_m(points: LoadedPoints, r: int) -> float:
    """Mean height [m] of the points of run `r`."""
    height_m, first, last = 0.0, points.run_first[r], points.run_first[r + 1]
    for m in range(first, last):
        height_m += points.height_m[m]
    return float(height_m / (last - first))


@compiled_without_nrt
def _slopes_of(problem: ContactProblem, step_s: float) -> tuple[float, float, float]:
    """Slopes of linear foam: k h + c' [Pa s/m], c' [Pa s/m], and (k h + c') / h before contact [Pa/m]."""
    foam = problem.foam
    spring_pa_s_per_m = step_s * foam.stiffness_pa_per_m
    slope_pa_s_per_m = max(foam.damping_pa_s_per_m, spring_pa_s_per_m)
    return slope_pa_s_per_m, slope_pa_s_per_m - spring_pa_s_per_m, slope_pa_s_per_m / step_s


@compiled_without_nrt
def _press_linear(problem: ContactProblem, twist: CellTwist, r: int, step_s: float) -> Resultant:
    """Resultant of run `r` of linear foam, as of `_press_points`, in loops of `point_loops`."""
    foam, points, scratch = problem.foam, problem.points, problem.workspace.at_point
    first, last, cell = points.run_first[r], points.run_first[r + 1], points.run_cell[r]
    share = problem.scene.foam_fraction[points.solid[first]]
    x_m, y_m, area_m2 = points.x_m[first:last], points.y_m[first:last], points.area_m2[first:last]
    depth_m, height_m = points.depth_m[first:last], points.height_m[first:last]
    x_n, y_n, normal_n = scratch[0, : last - first], scratch[1, : last - first], scratch[2, : last - first]
    shear_x_m, shear_y_m = problem.contact.shear_m[cell, 0], problem.contact.shear_m[cell, 1]
    if not points.run_is_whole[r]:  # of each point, not of each sample
        shear_x_m, shear_y_m = scratch[3, : last - first], scratch[4, : last - first]
        sample = points.sample[first:last]
        for i in range(len(sample)):
            shear_x_m[i] = problem.contact.shear_m[cell, 0, sample[i]]
            shear_y_m[i] = problem.contact.shear_m[cell, 1, sample[i]]
    vx, vy, vz, wx, wy, wz = twist
    slope, damping, entry = _slopes_of(problem, step_s)
    stiffness = foam.stiffness_pa_per_m
    for i in range(len(depth_m)):
        closing = -(vz + wx * y_m[i] - wy * x_m[i])
        pressure_pa = depth_m[i] * (stiffness if depth_m[i] >= 0.0 else entry) + slope * closing
        pressed_n = area_m2[i] * share * pressure_pa
        normal_n[i] = pressed_n if pressure_pa > 0.0 else 0.0
    k, c = SHEAR_STIFFNESS_RATIO * stiffness, SHEAR_STIFFNESS_RATIO * damping
    for i in range(len(depth_m)):
        slip_x, area = vx + wy * height_m[i] - wz * y_m[i], area_m2[i] * share
        sheared_n = -area * (k * (shear_x_m[i] + step_s * slip_x) + c * slip_x)
        x_n[i] = sheared_n if normal_n[i] > 0.0 else 0.0
    for i in range(len(depth_m)):
        slip_y, area = vy + wz * x_m[i] - wx * height_m[i], area_m2[i] * share
        sheared_n = -area * (k * (shear_y_m[i] + step_s * slip_y) + c * slip_y)
        y_n[i] = sheared_n if normal_n[i] > 0.0 else 0.0
    if any_slips(foam.friction, normal_n, x_n, y_n):
        for i in range(len(depth_m)):
            limit_n = foam.friction * normal_n[i]
            if abs(x_n[i]) + abs(y_n[i]) > limit_n:
                tried_n = pinned_math.hypot(x_n[i], y_n[i])
                if tried_n > limit_n:
                    x_n[i], y_n[i] = limit_n * (x_n[i] / tried_n), limit_n * (y_n[i] / tried_n)
    return sum_forces(x_m, y_m, height_m, depth_m, area_m2, normal_n, x_n, y_n)


@compiled_without_nrt
def _press_points(
    problem: ContactProblem,
    pairs: PairResponse,
    twist: CellTwist,
    r: int,
    step_s: float,
    with_stiffness: bool,
) -> Resultant:
    """Resultant of run `r` at the twist of its solid relative to its cell; fill `pairs.moments` if wanted."""
    foam, contact, points, moments = problem.foam, problem.contact, problem.points, pairs.moments
    first, last, cell = points.run_first[r], points.run_first[r + 1], points.run_cell[r]
    share = problem.scene.foam_fraction[points.solid[first]]
    vx, vy, vz, wx, wy, wz = twist
    if with_stiffness:
        moments[:, :] = 0.0
    force_x = force_y = force_z = moment_x = moment_y = moment_z = 0.0
    stiffness_pa_per_m, has_curve = foam.stiffness_pa_per_m, len(foam.curve) > 0
    slope_pa_s_per_m, damping_pa_s_per_m, entry_pa_per_m = _slopes_of(problem, step_s)
    for m in range(first, last):
        a, b, s = points.x_m[m], points.y_m[m], points.sample[m]
        d, h = points.depth_m[m], points.height_m[m]
        area = points.area_m2[m] * share
        closing = -(vz + wx * b - wy * a)
        elastic_pa = d * (stiffness_pa_per_m if d >= 0.0 else entry_pa_per_m)
        pressure_pa, normal_slope = elastic_pa + slope_pa_s_per_m * closing, area * slope_pa_s_per_m
        shear_slope = SHEAR_STIFFNESS_RATIO * normal_slope
        if has_curve:
            pressure_pa, slope = closing_response(foam, d, closing, step_s, share, contact.play_m, cell, s)
            normal_slope = area * slope
        if pressure_pa <= 0.0:
            continue
        normal_n = area * pressure_pa
        slip_x, slip_y = vx + wy * h - wz * b, vy + wz * a - wx * h
        shear_x = contact.shear_m[cell, 0, s] + step_s * slip_x
        shear_y = contact.shear_m[cell, 1, s] + step_s * slip_y
        k, c = SHEAR_STIFFNESS_RATIO * stiffness_pa_per_m, SHEAR_STIFFNESS_RATIO * damping_pa_s_per_m
        fx, fy = -area * (k * shear_x + c * slip_x), -area * (k * shear_y + c * slip_y)
        xx = yy = shear_slope
        xy = 0.0
        limit_n = foam.friction * normal_n
        if abs(fx) + abs(fy) > limit_n and pinned_math.hypot(fx, fy) > limit_n:
            tried_n = pinned_math.hypot(fx, fy)
            along_x, along_y = fx / tried_n, fy / tried_n
            fx, fy = limit_n * along_x, limit_n * along_y
            slope = xx * limit_n / tried_n
            xx, xy, yy = (
                slope * (1.0 - along_x * along_x),
                -slope * along_x * along_y,
                slope * (1.0 - along_y * along_y),
            )
        force_x += fx
        force_y += fy
        force_z += normal_n
        moment_x += b * normal_n - h * fy
        moment_y += h * fx - a * normal_n
        moment_z += a * fy - b * fx
        if with_stiffness:
            add_moments(moments, 0, normal_slope, a, b)
            add_moments(moments, 1, xx, a, b)
            add_moments(moments, 2, xy, a, b)
            add_moments(moments, 3, yy, a, b)
    return Resultant(force_x, force_y, force_z, moment_x, moment_y, moment_z, 0.0)


@compiled_without_nrt
def elastic_energy_j(problem: ContactProblem) -> float:
    """Elastic energy [J] of all loaded points: compression and shear of the foam, and of solids in series."""
    points, foam, shear_m, energy_j = problem.points, problem.foam, problem.contact.shear_m, 0.0
    for r in range(points.n_runs[0]):
        cell = points.run_cell[r]
        for m in range(points.run_first[r], points.run_first[r + 1]):
            fraction, s = problem.scene.foam_fraction[points.solid[m]], points.sample[m]
            area = points.area_m2[m] * fraction
            if points.depth_m[m] <= 0.0:
                continue
            x, y = shear_m[cell, 0, s], shear_m[cell, 1, s]
            stretch_m2 = SHEAR_STIFFNESS_RATIO * (x * x + y * y)
            if len(foam.curve):
                energy_j += area * stored_energy_j_per_m2(
                    foam, points.depth_m[m], fraction, problem.contact.play_m, cell, s
                )
            else:
                stretch_m2 += points.square_m2[m]
            energy_j += 0.5 * foam.stiffness_pa_per_m * area * stretch_m2
    return energy_j
