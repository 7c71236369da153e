"""Links that stand near one another at home without a joint between them, such as the fingers of a hand."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.collision_filter import geoms_felt_by_bodies
from skinnet.covering.felt_solids import Link, Model, felt_geoms, link_of_body
from skinnet.pinned_linalg import matmul

__all__ = ["home_neighbours"]

Floats = NDArray[np.float64]

_GRID = 2.0**24
"""Inverse of the grid [m] to which poses are rounded, as those of neighbours across a joint."""


def home_neighbours(mj: Model, link: Link, home_qpos: Floats, reach_m: float) -> list[tuple[Link, Floats]]:
    """Links that skin on `link` feels and that are within reach at home, with their pose (1, 3, 4) there.

    A pose is R and t of the frame of the neighbour's body in that of the link's. A base that stands in the
    world counts, other bodies there or such as move freely do not.

    Args:
        mj: The model.
        link: The link.
        home_qpos: (nq,) home posture.
        reach_m: Height of the skin [m].
    """
    data = mujoco.MjData(mj)
    data.qpos[:] = home_qpos
    mujoco.mj_kinematics(mj, data)
    own = felt_geoms(mj, link.members)
    root = int(mj.body_rootid[link.body_id])
    felt = geoms_felt_by_bodies(mj, link.members).any(axis=0)
    felt &= mj.body_rootid[mj.geom_bodyid] == root
    found: dict[tuple[int, ...], Link] = {}
    for geom in np.flatnonzero(felt).tolist():
        offset_m = data.geom_xpos[own] - data.geom_xpos[geom]
        apart_m = np.sqrt((offset_m * offset_m).sum(axis=1))
        if (apart_m <= mj.geom_rbound[own] + mj.geom_rbound[geom] + reach_m).any():
            other = link_of_body(mj, int(mj.geom_bodyid[geom]))
            found.setdefault(other.members, other)
    return [(other, _pose(data, link.body_id, other.body_id)[None]) for other in found.values()]


def _pose(data: mujoco.MjData, body: int, other: int) -> Floats:
    """R and t (3, 4) of the frame of one body in that of another, rounded so that last bits do not matter."""
    R = data.xmat[body].reshape(3, 3)
    R_body_other = matmul(R.T, data.xmat[other].reshape(3, 3))
    t_m = matmul(R.T, data.xpos[other] - data.xpos[body])
    pose: Floats = np.round(np.column_stack([R_body_other, t_m]) * _GRID) / _GRID
    return pose
