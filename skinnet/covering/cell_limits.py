"""Limits that a cell of a covering keeps, and its conflicts with other cells."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.covering.hexagons import piercing_m

__all__ = ["BACK_TO_BACK_COSINE", "CellLimits", "limits_of", "sum_of_pushes"]

Floats = NDArray[np.float64]

BACK_TO_BACK_COSINE = -0.986
"""Cosine of the angle between normals from which on cells lie on opposite sides of a plate: over 170°."""


class CellLimits(NamedTuple):
    """Limits that a cell must keep; lengths in m.

    Attributes:
        pitch_m: Distance of neighbours in the lattice.
        side_m: Side of the hexagon.
        foam_m: Thickness of the foam: nothing of the own link may reach into it.
        intrusion_m: How far the own link may do so all the same.
        lift_m: Greatest height of the centre above the surface.
        gap_m: Greatest mean height of the hexagon above the surface under it.
        depth_m: Depth below the hexagon at which the surface no longer supports it.
        support: Least supported share of the hexagon.
        distance_m: Least distance of centres.
        piercing_m: Greatest overlap of two plates.
        plate_m: Thickness of the plates that may not overlap.
        margin_m: Least distance of the hexagon from surface that it may not cover.
    """

    pitch_m: float
    side_m: float
    foam_m: float
    intrusion_m: float
    lift_m: float
    gap_m: float
    depth_m: float
    support: float
    distance_m: float
    piercing_m: float
    plate_m: float
    margin_m: float


def limits_of(pitch_m: float, side_m: float, foam_m: float, margin_m: float) -> CellLimits:
    """Limits of a cell: those of a pitch of 24 mm, in proportion *(assumed; chosen on twelve robots)*."""
    return CellLimits(
        pitch_m=pitch_m,
        side_m=side_m,
        foam_m=foam_m,
        intrusion_m=0.02 * pitch_m,
        lift_m=0.25 * pitch_m,
        gap_m=0.25 * pitch_m,
        depth_m=0.4 * pitch_m,
        support=0.55,
        distance_m=0.93 * pitch_m,
        piercing_m=0.035 * pitch_m,
        plate_m=0.08 * pitch_m,
        margin_m=margin_m,
    )


@compiled_without_nrt
def sum_of_pushes(
    positions_m: Floats,
    rotations: Floats,
    n_cells: int,
    limits: CellLimits,
    position_m: Floats,
    R: Floats,
    push_m: Floats,
) -> bool:
    """Sum up in `push_m` (3,) [m] how a cell must move to keep off others; False if it keeps off them."""
    push_m[0] = push_m[1] = push_m[2] = 0.0
    conflict = False
    reach_m = 2.0 * limits.side_m + limits.plate_m
    for j in range(n_cells):
        x, y, z = (
            position_m[0] - positions_m[j, 0],
            position_m[1] - positions_m[j, 1],
            position_m[2] - positions_m[j, 2],
        )
        off_m2 = x * x + y * y + z * z
        if off_m2 > reach_m * reach_m:
            continue
        R_other = rotations[j]
        alike = R[0, 2] * R_other[0, 2] + R[1, 2] * R_other[1, 2] + R[2, 2] * R_other[2, 2]
        off_m = math.sqrt(off_m2)
        by_m = 0.0
        if alike > BACK_TO_BACK_COSINE:
            by_m = limits.distance_m - off_m
        pierced_m = piercing_m(R_other, R, x, y, z, limits.side_m, limits.plate_m)
        if pierced_m > limits.piercing_m:
            by_m = max(by_m, pierced_m - limits.piercing_m)
        if by_m > 0.0:
            conflict = True
            scale = (by_m + 0.004 * limits.pitch_m) / max(off_m, 1e-9)
            push_m[0], push_m[1], push_m[2] = (
                push_m[0] + scale * x,
                push_m[1] + scale * y,
                push_m[2] + scale * z,
            )
    return conflict
