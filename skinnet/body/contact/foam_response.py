"""Response of loaded foam to the velocity of bodies: forces at the end of a step, and their derivative.

With the relative closing velocity u of a point at the end of a step h, its depth is d + h u, and

    p = max(0, k (d + h u) + c' u),    c' = max(0, c - h k).

This is the backward Euler method: the foam takes at least the energy that it stores, whatever the step. The
method damps by h k of its own, which c' leaves out of c: so the damping in all is the foam's.
A point that the step brings into contact (d < 0) is damped for that part of the step only in which it is in
contact, (d + h u) / (h u): p = max(0, (k + c' / h) (d + h u)). Shear is strained likewise.
Where foam has a curve (`foam_curve`), its elastic pressure at the end of the step stands for k (d + h u).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact.contact_problem import ContactProblem
from skinnet.body.contact.foam import SHEAR_STIFFNESS_RATIO
from skinnet.body.contact.foam_curve import closing_response, stored_energy_j_per_m2
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.point_kinematics import cell_axis, point_above_cell
from skinnet.compilation import compiled_without_nrt

__all__ = ["PairResponse", "add_pairs", "add_response", "elastic_energy_j", "no_pairs"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
_N_MOMENTS = 6
"""Moments of a weight over the points of a cell: 1, a, b, a², a b, b² at (a, b) in its plane."""


class PairResponse(NamedTuple):
    """Response of the foam between pairs of bodies, p of them: skin's body and solid's body.

    Twists and wrenches are (linear, angular) and (force, moment) about one origin O, world.

    Attributes:
        total: (1,) p.
        number: (nbody, nbody) number of the pair, by body of the skin and of the solid; -1 for none.
        body: (·, 2) the bodies of each pair.
        origin_m: (3,) O [m].
        twist: (·, 6) twist of the solid's body relative to the skin's [m/s, rad/s].
        wrench: (·, 6) wrench on the solid's body; the opposite acts on the skin's [N, N m].
        stiffness: (·, 6, 6) negative derivative of the wrench with respect to the twist.
        moments: (4, 6) moments of normal and shear derivatives (normal, xx, xy, yy) of a cell, scratch.
        local: (6, 6) derivative in the frame of a cell, scratch.
        to_cell: (6, 6) transform of twists into the frame of a cell, scratch.
        product: (6, 6) scratch.
    """

    total: Indices
    number: Indices
    body: Indices
    origin_m: Floats
    twist: Floats
    wrench: Floats
    stiffness: Floats
    moments: Floats
    local: Floats
    to_cell: Floats
    product: Floats


def no_pairs(n_bodies: int, capacity: int) -> PairResponse:
    """Return an empty response for at most `capacity` pairs among `n_bodies` bodies."""
    return PairResponse(
        total=np.zeros(1, dtype=np.int64),
        number=np.full((n_bodies, n_bodies), -1, dtype=np.int64),
        body=np.zeros((capacity, 2), dtype=np.int64),
        origin_m=np.zeros(3),
        twist=np.zeros((capacity, 6)),
        wrench=np.zeros((capacity, 6)),
        stiffness=np.zeros((capacity, 6, 6)),
        moments=np.zeros((4, _N_MOMENTS)),
        local=np.zeros((6, 6)),
        to_cell=np.zeros((6, 6)),
        product=np.zeros((6, 6)),
    )


@compiled_without_nrt
def add_pairs(problem: ContactProblem, pairs: PairResponse) -> None:
    """Add the pairs of bodies between which `problem` has loaded points; the first point sets the origin."""
    points = problem.points
    for m in range(points.total[0]):
        own = problem.surface.body_id[points.cell[m]]
        other = problem.scene.body_id[points.solid[m]]
        if pairs.number[own, other] >= 0:
            continue
        p = pairs.total[0]
        if p == 0:
            x, y, z = point_above_cell(problem.surface, problem.motion, points.cell[m], 0.0)
            pairs.origin_m[0], pairs.origin_m[1], pairs.origin_m[2] = x, y, z
        pairs.number[own, other] = p
        pairs.body[p, 0], pairs.body[p, 1] = own, other
        pairs.total[0] = p + 1


@compiled_without_nrt
def add_response(problem: ContactProblem, pairs: PairResponse, step_s: float, with_stiffness: bool) -> None:
    """Add wrenches, and stiffnesses if wanted, of all loaded points at the relative twists of `pairs`."""
    points = problem.points
    first, count = 0, points.total[0]
    while first < count:
        cell, body = points.cell[first], problem.scene.body_id[points.solid[first]]
        last = first + 1
        while (
            last < count and points.cell[last] == cell and problem.scene.body_id[points.solid[last]] == body
        ):
            last += 1
        p = pairs.number[problem.surface.body_id[cell], body]
        _add_cell_response(problem, points, pairs, p, first, last, step_s, with_stiffness)
        first = last


@compiled_without_nrt
def _add_cell_response(
    problem: ContactProblem,
    points: LoadedPoints,
    pairs: PairResponse,
    p: int,
    first: int,
    last: int,
    step_s: float,
    with_stiffness: bool,
) -> None:
    """Add the response of points `first` to `last`, all of one cell and against one body, to pair `p`."""
    surface, motion, foam, contact = problem.surface, problem.motion, problem.foam, problem.contact
    cell = points.cell[first]
    twist, moments = pairs.twist, pairs.moments
    x, y, z = point_above_cell(surface, motion, cell, 0.0)
    rx, ry, rz = x - pairs.origin_m[0], y - pairs.origin_m[1], z - pairs.origin_m[2]
    axis_xx, axis_xy, axis_xz = cell_axis(surface, motion, cell, 0)
    axis_yx, axis_yy, axis_yz = cell_axis(surface, motion, cell, 1)
    nx, ny, nz = cell_axis(surface, motion, cell, 2)
    u, v, w = twist[p, 3], twist[p, 4], twist[p, 5]
    wx, wy, wz = (
        u * axis_xx + v * axis_xy + w * axis_xz,
        u * axis_yx + v * axis_yy + w * axis_yz,
        u * nx + v * ny + w * nz,
    )
    u, v, w = twist[p, 0] + v * rz - w * ry, twist[p, 1] + w * rx - u * rz, twist[p, 2] + u * ry - v * rx
    vx, vy, vz = (
        u * axis_xx + v * axis_xy + w * axis_xz,
        u * axis_yx + v * axis_yy + w * axis_yz,
        u * nx + v * ny + w * nz,
    )
    if with_stiffness:
        for i in range(4):
            for j in range(_N_MOMENTS):
                moments[i, j] = 0.0
    force_x = force_y = force_z = moment_x = moment_y = moment_z = height_m = 0.0
    stiffness_pa_per_m = foam.stiffness_pa_per_m
    slope_pa_s_per_m = max(foam.damping_pa_s_per_m, step_s * stiffness_pa_per_m)
    damping_pa_s_per_m = slope_pa_s_per_m - step_s * stiffness_pa_per_m
    entry_pa_per_m, has_curve = slope_pa_s_per_m / step_s, len(foam.curve) > 0
    for m in range(first, last):
        a, b = points.x_m[m], points.y_m[m]
        d, h = points.depth_m[m], points.height_m[m]
        area = points.area_m2[m] * problem.scene.foam_fraction[points.solid[m]]
        closing = -(vz + wx * b - wy * a)
        elastic_pa = d * (stiffness_pa_per_m if d >= 0.0 else entry_pa_per_m)
        pressure_pa, normal_slope = elastic_pa + slope_pa_s_per_m * closing, area * slope_pa_s_per_m
        shear_slope = SHEAR_STIFFNESS_RATIO * normal_slope
        height_m += h
        if has_curve:
            pressure_pa, slope = closing_response(
                foam,
                d,
                closing,
                step_s,
                problem.scene.foam_fraction[points.solid[m]],
                contact.play_m,
                cell,
                points.sample[m],
            )
            normal_slope = area * slope
        if pressure_pa <= 0.0:
            continue
        normal_n = area * pressure_pa
        slip_x, slip_y = vx + wy * h - wz * b, vy + wz * a - wx * h
        shear_x = contact.shear_m[cell, points.sample[m], 0] + step_s * slip_x
        shear_y = contact.shear_m[cell, points.sample[m], 1] + step_s * slip_y
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
        if not with_stiffness:
            continue
        for i, weight in enumerate((normal_slope, xx, xy, yy)):
            moments[i, 0] += weight
            moments[i, 1] += weight * a
            moments[i, 2] += weight * b
            moments[i, 3] += weight * a * a
            moments[i, 4] += weight * a * b
            moments[i, 5] += weight * b * b
    u = force_x * axis_xx + force_y * axis_yx + force_z * nx
    v = force_x * axis_xy + force_y * axis_yy + force_z * ny
    w = force_x * axis_xz + force_y * axis_yz + force_z * nz
    wrench = pairs.wrench
    wrench[p, 0] += u
    wrench[p, 1] += v
    wrench[p, 2] += w
    wrench[p, 3] += moment_x * axis_xx + moment_y * axis_yx + moment_z * nx + ry * w - rz * v
    wrench[p, 4] += moment_x * axis_xy + moment_y * axis_yy + moment_z * ny + rz * u - rx * w
    wrench[p, 5] += moment_x * axis_xz + moment_y * axis_yz + moment_z * nz + rx * v - ry * u
    if with_stiffness:
        _derivative_of_moments(moments, height_m / (last - first), pairs.local)
        _set_axis(pairs.to_cell, 0, axis_xx, axis_xy, axis_xz, rx, ry, rz)
        _set_axis(pairs.to_cell, 1, axis_yx, axis_yy, axis_yz, rx, ry, rz)
        _set_axis(pairs.to_cell, 2, nx, ny, nz, rx, ry, rz)
        _add_stiffness(pairs, p)


@compiled_without_nrt
def _set_axis(to_cell: Floats, i: int, u: float, v: float, w: float, rx: float, ry: float, rz: float) -> None:
    """Set the rows of axis `i`, (u, v, w) in the world, of a cell at (rx, ry, rz) [m] from the origin.

    They take a twist about the origin to one about the cell: rows (Rᵀ, -Rᵀ [r]) and (0, Rᵀ).
    """
    to_cell[i, 0], to_cell[i, 1], to_cell[i, 2] = u, v, w
    to_cell[i, 3], to_cell[i, 4], to_cell[i, 5] = ry * w - rz * v, rz * u - rx * w, rx * v - ry * u
    to_cell[i + 3, 3], to_cell[i + 3, 4], to_cell[i + 3, 5] = u, v, w


@compiled_without_nrt
def _add_stiffness(pairs: PairResponse, p: int) -> None:
    """Add the derivative in the frame of a cell to pair `p`: Tᵀ K T, where T has no entries lower left."""
    local, to_cell, product = pairs.local, pairs.to_cell, pairs.product
    for i in range(6):
        for j in range(3):
            product[i, j] = (
                local[i, 0] * to_cell[0, j] + local[i, 1] * to_cell[1, j] + local[i, 2] * to_cell[2, j]
            )
            product[i, j + 3] = (
                local[i, 0] * to_cell[0, j + 3]
                + local[i, 1] * to_cell[1, j + 3]
                + local[i, 2] * to_cell[2, j + 3]
                + local[i, 3] * to_cell[3, j + 3]
                + local[i, 4] * to_cell[4, j + 3]
                + local[i, 5] * to_cell[5, j + 3]
            )
    for i in range(6):
        for j in range(i + 1):
            total = (
                to_cell[0, i] * product[0, j] + to_cell[1, i] * product[1, j] + to_cell[2, i] * product[2, j]
            )
            if i >= 3:
                total += (
                    to_cell[3, i] * product[3, j]
                    + to_cell[4, i] * product[4, j]
                    + to_cell[5, i] * product[5, j]
                )
            pairs.stiffness[p, i, j] += total
            if i != j:
                pairs.stiffness[p, j, i] += total


@compiled_without_nrt
def _derivative_of_moments(moments: Floats, h: float, derivative: Floats) -> None:
    """Fill the derivative (6, 6) of a cell's wrench, its frame; shear acts at the mean height `h` [m].

    Rows of a point's Jacobian: normal (0, 0, 1, b, -a, 0), x (1, 0, 0, 0, h, -b), y (0, 1, 0, -h, 0, a).
    """
    k, m = derivative, moments
    k[:, :] = 0.0
    k[0, 0], k[0, 1], k[1, 1] = m[1, 0], m[2, 0], m[3, 0]
    k[2, 2], k[2, 3], k[2, 4] = m[0, 0], m[0, 2], -m[0, 1]
    k[0, 3], k[0, 4], k[0, 5] = -h * m[2, 0], h * m[1, 0], m[2, 1] - m[1, 2]
    k[1, 3], k[1, 4], k[1, 5] = -h * m[3, 0], h * m[2, 0], m[3, 1] - m[2, 2]
    k[3, 3] = m[0, 5] + h * h * m[3, 0]
    k[4, 4] = m[0, 3] + h * h * m[1, 0]
    k[5, 5] = m[1, 5] + m[3, 3] - 2.0 * m[2, 4]
    k[3, 4] = -m[0, 4] - h * h * m[2, 0]
    k[3, 5] = h * (m[2, 2] - m[3, 1])
    k[4, 5] = h * (m[2, 1] - m[1, 2])
    for i in range(6):
        for j in range(i):
            k[i, j] = k[j, i]


@compiled_without_nrt
def elastic_energy_j(problem: ContactProblem) -> float:
    """Elastic energy [J] of all loaded points: compression and shear of the foam, and of solids in series."""
    points, energy_j = problem.points, 0.0
    for m in range(points.total[0]):
        area = points.area_m2[m] * problem.scene.foam_fraction[points.solid[m]]
        if points.depth_m[m] <= 0.0:
            continue
        shear = problem.contact.shear_m
        x, y = shear[points.cell[m], points.sample[m], 0], shear[points.cell[m], points.sample[m], 1]
        stretch_m2 = SHEAR_STIFFNESS_RATIO * (x * x + y * y)
        if len(problem.foam.curve):
            fraction, play_m = problem.scene.foam_fraction[points.solid[m]], problem.contact.play_m
            energy_j += area * stored_energy_j_per_m2(
                problem.foam, points.depth_m[m], fraction, play_m, points.cell[m], points.sample[m]
            )
        else:
            stretch_m2 += points.square_m2[m]
        energy_j += 0.5 * problem.foam.stiffness_pa_per_m * area * stretch_m2
    return energy_j
