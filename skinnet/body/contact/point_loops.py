"""Loops over the points of one cell against one body, for vector instructions.

Most points of a large contact lie on cells that are covered as a whole. Without branches and calls the
compiler handles four to eight at a time; it must see that arrays do not overlap, which it tests for few of
them: so each loop fills one. Values are those of the loops with branches of `present_forces` and
`foam_response`, to the last bit: each is computed alike, and sums keep their order. What a point does not
take part in is zero here.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.point_kinematics import CellTwist
from skinnet.compilation import compiled_without_nrt

__all__ = ["Resultant", "any_slips", "fill_heights", "fill_normal_forces", "sum_forces"]

Floats = NDArray[np.float64]


class Resultant(NamedTuple):
    """Resultant of the forces at points of a cell, about its centre on the rigid surface, its frame.

    Attributes:
        force_x: Force [N], with force_y and force_z.
        force_y: See force_x.
        force_z: See force_x.
        moment_x: Moment [N m], with moment_y and moment_z.
        moment_y: See moment_x.
        moment_z: See moment_x.
        pressed_m2: Area that is pressed [m²].
    """

    force_x: float
    force_y: float
    force_z: float
    moment_x: float
    moment_y: float
    moment_z: float
    pressed_m2: float


@compiled_without_nrt
def fill_heights(thickness_m: float, share: float, give_m: float, depth_m: Floats, height_m: Floats) -> None:
    """Fill the heights of pressed foam: its thickness, less its `share` of the depths.

    The rest of the depth indents the solid, at most by `give_m` [m].
    """
    for i in range(len(depth_m)):
        d = depth_m[i]
        indented_m = (1.0 - share) * d
        h = thickness_m - d + (indented_m if indented_m < give_m else give_m)
        height_m[i] = h if d > 0.0 else thickness_m


@compiled_without_nrt
def fill_normal_forces(
    twist: CellTwist,
    stiffness: float,
    damping: float,
    share: float,
    x_m: Floats,
    y_m: Floats,
    area_m2: Floats,
    depth_m: Floats,
    normal_n: Floats,
) -> None:
    """Fill normal forces [N] by a stiffness [Pa/m] and a damping [Pa s/m]; 0 without contact."""
    for i in range(len(depth_m)):
        rate_m_s = -(twist.vz + twist.wx * y_m[i] - twist.wy * x_m[i])
        pressure_pa = share * (stiffness * depth_m[i] + damping * rate_m_s)
        pressure_pa = pressure_pa if pressure_pa > 0.0 else 0.0
        force_n = area_m2[i] * pressure_pa
        normal_n[i] = force_n if depth_m[i] > 0.0 else 0.0


@compiled_without_nrt
def any_slips(friction: float, normal_n: Floats, x_n: Floats, y_n: Floats) -> bool:
    """True if the shear force (`x_n`, `y_n`) of a point may reach the limit of friction; cheap and safe."""
    count = 0
    for i in range(len(normal_n)):
        count += abs(x_n[i]) + abs(y_n[i]) > friction * normal_n[i]
    return count > 0


@compiled_without_nrt
def sum_forces(
    x_m: Floats,
    y_m: Floats,
    height_m: Floats,
    depth_m: Floats,
    area_m2: Floats,
    normal_n: Floats,
    x_n: Floats,
    y_n: Floats,
) -> Resultant:
    """Resultant of normal forces and shear forces (`x_n`, `y_n`) [N] at points."""
    force_x = force_y = force_z = moment_x = moment_y = moment_z = pressed_m2 = 0.0
    for i in range(len(normal_n)):
        a, b, h = x_m[i], y_m[i], height_m[i]
        force_x += x_n[i]
        force_y += y_n[i]
        force_z += normal_n[i]
        moment_x += b * normal_n[i] - h * y_n[i]
        moment_y += h * x_n[i] - a * normal_n[i]
        moment_z += a * y_n[i] - b * x_n[i]
        pressed_m2 += area_m2[i] if depth_m[i] > 0.0 else 0.0
    return Resultant(force_x, force_y, force_z, moment_x, moment_y, moment_z, pressed_m2)
