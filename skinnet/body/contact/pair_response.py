"""Response of foam between pairs of bodies: forces, and their derivative by the relative motion."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.point_kinematics import CellFrame
from skinnet.compilation import compiled_without_nrt

__all__ = ["PairResponse", "add_moments", "add_stiffness", "no_pairs"]

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
def add_moments(moments: Floats, i: int, weight: float, a: float, b: float) -> None:
    """Add a weight at (a, b) [m] to row `i` of the moments."""
    moments[i, 0] += weight
    moments[i, 1] += weight * a
    moments[i, 2] += weight * b
    moments[i, 3] += weight * a * a
    moments[i, 4] += weight * a * b
    moments[i, 5] += weight * b * b


@compiled_without_nrt
def add_stiffness(pairs: PairResponse, p: int, f: CellFrame, height_m: float) -> None:
    """Add the derivative by the present moments, of a cell of frame `f`, to pair `p`.

    Shear acts at the height `height_m` [m]. It is Tᵀ K T, where T has no entries lower left.
    """
    rx, ry, rz = f.x - pairs.origin_m[0], f.y - pairs.origin_m[1], f.z - pairs.origin_m[2]
    _derivative_of_moments(pairs.moments, height_m, pairs.local)
    _set_axis(pairs.to_cell, 0, f.xx, f.xy, f.xz, rx, ry, rz)
    _set_axis(pairs.to_cell, 1, f.yx, f.yy, f.yz, rx, ry, rz)
    _set_axis(pairs.to_cell, 2, f.nx, f.ny, f.nz, rx, ry, rz)
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
def _set_axis(to_cell: Floats, i: int, u: float, v: float, w: float, rx: float, ry: float, rz: float) -> None:
    """Set the rows of axis `i`, (u, v, w) in the world, of a cell at (rx, ry, rz) [m] from the origin.

    They take a twist about the origin to one about the cell: rows (Rᵀ, -Rᵀ [r]) and (0, Rᵀ).
    """
    to_cell[i, 0], to_cell[i, 1], to_cell[i, 2] = u, v, w
    to_cell[i, 3], to_cell[i, 4], to_cell[i, 5] = ry * w - rz * v, rz * u - rx * w, rx * v - ry * u
    to_cell[i + 3, 3], to_cell[i + 3, 4], to_cell[i + 3, 5] = u, v, w


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
