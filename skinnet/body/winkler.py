"""Elastic-foundation (Winkler) contact between the skin and nearby geoms.

MuJoCo's contacts give a cylinder on a box two points; force cells need a pressure field. So every cell
samples its foam at s points. Where a solid penetrates the face of the foam by the depth d, the pressure is

    p = max(0, k d + c ḋ),    d ≤ thickness.

An elastic solid is a second spring in series: k and c are scaled by the foam's fraction of d, the solid's
face recedes by the rest, and d may exceed the thickness by as much. Friction is shear of the foam: a spring
and damper with half of k and c (the ratio of shear to normal stiffness of a foam with Poisson's ratio 0,
assumed) that slides at μ p. Forces act on both bodies, equal and opposite, at the same point. When the foam
is fully compressed, MuJoCo's own contact takes over at the rigid surface.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.frames import rotated_back
from skinnet.body.geometry import entry_m
from skinnet.body.points import axis, lifted, near_patch, velocity
from skinnet.body.scene import Motion, Scene, into_solid, within
from skinnet.body.surface import Surface
from skinnet.compiled import borrowing

__all__ = ["Foam", "Pressed", "Scratch", "press"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_BELOW_M = 0.004
"""Start of rays [m] below the rigid surface: a solid that penetrates this far still counts as in contact."""
_SHEAR = 0.5


class Foam(NamedTuple):
    """Material of the foam layer, the same for all cells.

    Attributes:
        thickness_m: Distance from the rigid surface to the outer face [m].
        stiffness_pa_per_m: Foundation stiffness k [Pa/m].
        damping_pa_s_per_m: Damping c [Pa s/m].
        friction: Friction coefficient μ.
    """

    thickness_m: float
    stiffness_pa_per_m: float
    damping_pa_s_per_m: float
    friction: float


class Pressed(NamedTuple):
    """Contact state of a foundation at the present time.

    Attributes:
        force_n: (n, e) normal force on each force cell [N].
        touch_c: (n,) mean temperature of the bodies that touch a cell [°C]; NaN without contact.
        on_body_n: (nbody,) normal force of all cells on each body, sum of magnitudes [N].
        by_patch_n: (p, nbody) normal force of each patch on each body, sum of magnitudes [N].
        peak_n: (1,) the largest force on any force cell [N].
        slid_n_m: (nbody,) sliding distance of each body over the skin in this step times normal force [N m];
            μ times this is the work of sliding friction.
        shear_m: (n, s, 2) shear displacement of the foam at each point, plane of the cell [m].
        loaded: (n,) True for cells in contact.
    """

    force_n: Floats
    touch_c: Floats
    on_body_n: Floats
    by_patch_n: Floats
    peak_n: Floats
    slid_n_m: Floats
    shear_m: Floats
    loaded: NDArray[np.bool_]


class Scratch(NamedTuple):
    """Scratch arrays of one call: solids near a patch, close to a cell, first hit and distance per point."""

    near: Indices
    close: Indices
    hit: Indices
    nearest_m: Floats


@borrowing
def press(
    surface: Surface,
    scene: Scene,
    motion: Motion,
    foam: Foam,
    temperature_c: Floats,
    step_s: float,
    pressed: Pressed,
    wrench: Floats,
    scratch: Scratch,
) -> int:
    """Compute contact of all cells with the solids near them.

    Args:
        surface: The cells.
        scene: The solids.
        motion: Poses and velocities now.
        foam: Material of the foam.
        temperature_c: (nbody,) temperatures of the bodies [°C].
        step_s: Step over which shear displacement is integrated [s].
        pressed: Contact state, overwritten; shear is updated.
        wrench: (nbody, 6) forces [N] and moments [N m] on the bodies about their centres of mass; added to.
        scratch: Scratch arrays.

    Returns:
        Number of cells in contact.
    """
    pressed.on_body_n[:] = 0.0
    pressed.by_patch_n[:] = 0.0
    pressed.peak_n[0] = 0.0
    pressed.slid_n_m[:] = 0.0
    below_m = _BELOW_M + scene.deepest_m
    half_m = 0.5 * (foam.thickness_m + below_m)
    corner_m = 0.0  # largest distance of a sample point from the centre of the cell
    for s in range(len(surface.sample_m)):
        corner_m = max(corner_m, math.hypot(surface.sample_m[s, 0], surface.sample_m[s, 1]))
    ball_m = math.hypot(corner_m, half_m)
    touching = 0
    for p in range(len(surface.patch_body)):
        n_near = near_patch(surface, scene, motion, p, foam.thickness_m + ball_m, scratch.near)
        for i in range(surface.patch_start[p], surface.patch_start[p + 1]):
            n_close = 0
            if n_near > 0:
                x, y, z = lifted(surface, motion, i, half_m - below_m)
                for j in range(n_near):
                    if within(scene, motion, scratch.near[j], x, y, z, ball_m):
                        scratch.close[n_close] = scratch.near[j]
                        n_close += 1
            if n_close == 0 and not pressed.loaded[i]:
                continue
            _press_cell(
                surface, scene, motion, foam, temperature_c, step_s, pressed, wrench, p, i, scratch, n_close
            )
            touching += pressed.loaded[i]
    return touching


@borrowing
def _push(
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


@borrowing
def _probe(
    surface: Surface, scene: Scene, motion: Motion, i: int, k: int, hit: Indices, nearest_m: Floats
) -> None:
    """Cast rays from the points of cell `i` at solid `k`; update `hit` and `nearest_m` where it is nearer.

    Heights count from `_BELOW_M` below the rigid surface; a compliant solid may lie deeper.
    """
    g, axes, give_m = scene.geom[k], motion.geom_xmat, scene.give_m[k]
    x, y, z = lifted(surface, motion, i, -_BELOW_M - give_m)
    ox, oy, oz = into_solid(scene, motion, k, x, y, z)
    u, v, w = axis(surface, motion, i, 0)
    xx, xy, xz = rotated_back(axes, g, u, v, w)
    u, v, w = axis(surface, motion, i, 1)
    yx, yy, yz = rotated_back(axes, g, u, v, w)
    u, v, w = axis(surface, motion, i, 2)
    nx, ny, nz = rotated_back(axes, g, u, v, w)
    kind, size_a, size_b, size_c = scene.kind[k], scene.size_m[k, 0], scene.size_m[k, 1], scene.size_m[k, 2]
    first, last, triangles_m = scene.first[k], scene.last[k], scene.triangles_m
    for s in range(len(surface.sample_m)):
        a, b = surface.sample_m[s, 0], surface.sample_m[s, 1]
        x, y, z = ox + a * xx + b * yx, oy + a * xy + b * yy, oz + a * xz + b * yz
        distance_m = entry_m(kind, size_a, size_b, size_c, triangles_m, first, last, x, y, z, nx, ny, nz)
        if distance_m - give_m < nearest_m[s]:
            hit[s], nearest_m[s] = k, distance_m - give_m


@borrowing
def _press_cell(
    surface: Surface,
    scene: Scene,
    motion: Motion,
    foam: Foam,
    temperature_c: Floats,
    step_s: float,
    pressed: Pressed,
    wrench: Floats,
    p: int,
    i: int,
    scratch: Scratch,
    n_close: int,
) -> None:
    """Compute contact forces of cell `i`, of patch `p`, with the solids close to it."""
    hit, nearest_m = scratch.hit, scratch.nearest_m
    hit[:], nearest_m[:] = -1, _BELOW_M + foam.thickness_m
    for j in range(n_close):
        _probe(surface, scene, motion, i, scratch.close[j], hit, nearest_m)
    own = surface.body[i]
    area, per_element = surface.sample_area_m2, len(surface.sample_m) // surface.n_elements
    ox, oy, oz = lifted(surface, motion, i, -_BELOW_M)
    xx, xy, xz = axis(surface, motion, i, 0)
    yx, yy, yz = axis(surface, motion, i, 1)
    nx, ny, nz = axis(surface, motion, i, 2)
    pressed.force_n[i, :] = 0.0
    contacts, warmth_c = 0, 0.0
    for s in range(len(surface.sample_m)):
        if hit[s] < 0:
            pressed.shear_m[i, s, 0] = 0.0
            pressed.shear_m[i, s, 1] = 0.0
            continue
        a, c = surface.sample_m[s, 0], surface.sample_m[s, 1]
        x, y, z = ox + a * xx + c * yx, oy + a * xy + c * yy, oz + a * xz + c * yz
        other, share, give_m = scene.body[hit[s]], scene.share[hit[s]], scene.give_m[hit[s]]
        lift_m = max(nearest_m[s], _BELOW_M - give_m)
        depth_m = _BELOW_M + foam.thickness_m - lift_m
        lift_m += min((1.0 - share) * depth_m, give_m)
        x, y, z = x + lift_m * nx, y + lift_m * ny, z + lift_m * nz
        vx, vy, vz = velocity(motion, other, x, y, z)
        wx, wy, wz = velocity(motion, own, x, y, z)
        vx, vy, vz = vx - wx, vy - wy, vz - wz
        rate_m_s = -(vx * nx + vy * ny + vz * nz)
        elastic_pa, viscous_pa = foam.stiffness_pa_per_m * depth_m, foam.damping_pa_s_per_m * rate_m_s
        normal_n = area * max(0.0, share * (elastic_pa + viscous_pa))
        along_x, along_y, slid_m = _shear(
            foam,
            share * area,
            normal_n,
            vx * xx + vy * xy + vz * xz,
            vx * yx + vy * yy + vz * yz,
            step_s,
            pressed.shear_m,
            i,
            s,
        )
        fx = normal_n * nx + along_x * xx + along_y * yx
        fy = normal_n * ny + along_x * xy + along_y * yy
        fz = normal_n * nz + along_x * xz + along_y * yz
        _push(motion.xipos, wrench, other, x, y, z, fx, fy, fz)
        _push(motion.xipos, wrench, own, x, y, z, -fx, -fy, -fz)
        pressed.force_n[i, s // per_element] += normal_n
        pressed.on_body_n[other] += normal_n
        pressed.by_patch_n[p, other] += normal_n
        pressed.slid_n_m[other] += normal_n * slid_m
        warmth_c += temperature_c[other]
        contacts += 1
    for e in range(surface.n_elements):
        pressed.peak_n[0] = max(pressed.peak_n[0], pressed.force_n[i, e])
    pressed.loaded[i] = contacts > 0
    pressed.touch_c[i] = warmth_c / contacts if contacts > 0 else math.nan


@borrowing
def _shear(
    foam: Foam,
    area: float,
    normal_n: float,
    slip_x: float,
    slip_y: float,
    step_s: float,
    strain_m: Floats,
    i: int,
    s: int,
) -> tuple[float, float, float]:
    """Friction force [N] at slip velocity (slip_x, slip_y) [m/s], plane of the cell; sliding distance [m].

    Elastic-plastic Coulomb friction: shear displacement grows with the slip until the force reaches μ N;
    beyond, the solid slides at constant displacement. So a body at rest on a slope stays at rest.
    """
    stiffness = _SHEAR * foam.stiffness_pa_per_m * area
    damping = _SHEAR * foam.damping_pa_s_per_m * area
    strain_x, strain_y = strain_m[i, s, 0] + slip_x * step_s, strain_m[i, s, 1] + slip_y * step_s
    fx, fy = -stiffness * strain_x - damping * slip_x, -stiffness * strain_y - damping * slip_y
    limit_n, slid_m = foam.friction * normal_n, 0.0
    if (
        abs(fx) + abs(fy) > limit_n and math.hypot(fx, fy) > limit_n
    ):  # the first test is cheap and mostly decides
        force_n = math.hypot(fx, fy)
        fx, fy = fx * limit_n / force_n, fy * limit_n / force_n
        held = foam.friction * normal_n / stiffness
        stretch = math.hypot(strain_x, strain_y)
        if stretch > held:
            slid_m = stretch - held
            strain_x, strain_y = strain_x * held / stretch, strain_y * held / stretch
    strain_m[i, s, 0], strain_m[i, s, 1] = strain_x, strain_y
    return fx, fy, slid_m
