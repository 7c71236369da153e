"""Walk over a surface: one pitch from a cell towards a neighbour, with its axes carried along."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.covering.felt_solids import FeltSolids, first_entry_m
from skinnet.covering.sample_search import SurfaceSamples, mean_normal, nearest_sample

__all__ = ["turned_along", "walk_one_pitch"]

Floats = NDArray[np.float64]

_STEPS = 6


@compiled_without_nrt
def turned_along(
    ax: float, ay: float, az: float, u: float, v: float, w: float, nx: float, ny: float, nz: float
) -> tuple[float, float, float]:
    """Turn the vector (ax, ay, az) by the least rotation that takes unit (u, v, w) to unit (nx, ny, nz)."""
    cosine = u * nx + v * ny + w * nz
    if cosine < -0.999:
        return ax, ay, az
    cx, cy, cz = v * nz - w * ny, w * nx - u * nz, u * ny - v * nx
    along = (cx * ax + cy * ay + cz * az) / (1.0 + cosine)
    return (
        cosine * ax + cy * az - cz * ay + along * cx,
        cosine * ay + cz * ax - cx * az + along * cy,
        cosine * az + cx * ay - cy * ax + along * cz,
    )


@compiled_without_nrt
def walk_one_pitch(
    solids: FeltSolids,
    samples: SurfaceSamples,
    pitch_m: float,
    position_m: Floats,
    R: Floats,
    cosine: float,
    sine: float,
    target_m: Floats,
    normal: Floats,
    x_axis: Floats,
) -> bool:
    """Walk one pitch over the surface from a cell, in a direction of its plane; False if there is no surface.

    The way goes in short steps: along the tangent, then back to the surface along its mean normal, which also
    turns the direction (parallel transport), so that it goes round edges.

    Args:
        solids: Solids of the link.
        samples: Samples of its surface.
        pitch_m: Length of the way [m].
        position_m: (3,) centre of the cell [m].
        R: (3, 3) axes of the cell.
        cosine: Component of the direction along the cell's x axis.
        sine: Component along its y axis.
        target_m: (3,) end of the way, set in place [m].
        normal: (3,) normal there, set in place.
        x_axis: (3,) the cell's x axis, carried along, set in place.
    """
    px, py, pz = position_m[0], position_m[1], position_m[2]
    nx, ny, nz = R[0, 2], R[1, 2], R[2, 2]
    ax, ay, az = R[0, 0], R[1, 0], R[2, 0]
    dx = cosine * R[0, 0] + sine * R[0, 1]
    dy = cosine * R[1, 0] + sine * R[1, 1]
    dz = cosine * R[2, 0] + sine * R[2, 1]
    step_m, radius_m = pitch_m / _STEPS, 0.35 * pitch_m
    for _ in range(_STEPS):
        px, py, pz = px + step_m * dx, py + step_m * dy, pz + step_m * dz
        s = nearest_sample(samples, px, py, pz, nx, ny, nz, -0.3, pitch_m)
        if s < 0:
            return False
        x, y, z = samples.point_m[s, 0], samples.point_m[s, 1], samples.point_m[s, 2]
        u, v, w = mean_normal(samples, x, y, z, nx, ny, nz, radius_m, -0.3)
        entry_m = first_entry_m(
            solids, px + pitch_m * u, py + pitch_m * v, pz + pitch_m * w, -u, -v, -w, 1.6 * pitch_m
        )
        if 0.0 < entry_m < math.inf:
            height_m = pitch_m - entry_m
            px, py, pz = px + height_m * u, py + height_m * v, pz + height_m * w
        else:
            px, py, pz = x, y, z
        dx, dy, dz = turned_along(dx, dy, dz, nx, ny, nz, u, v, w)
        ax, ay, az = turned_along(ax, ay, az, nx, ny, nz, u, v, w)
        nx, ny, nz = u, v, w
    target_m[0], target_m[1], target_m[2] = px, py, pz
    normal[0], normal[1], normal[2] = nx, ny, nz
    x_axis[0], x_axis[1], x_axis[2] = ax, ay, az
    return True
