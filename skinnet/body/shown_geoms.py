"""Geoms of a model that pictures show: visual ones, and felt ones for which no visual mesh stands."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import matmul

__all__ = ["felt_geoms", "shown_geoms"]

Floats = NDArray[np.float64]
_N_VISIBLE_GROUPS = 3
"""Number of geom groups that MuJoCo draws (0 to 2); higher groups are for contacts only."""
_FILLED = 0.5
"""Part of the box around a felt geom that boxes around visual meshes fill, if they stand for it."""


def felt_geoms(mj: mujoco.MjModel) -> NDArray[np.bool_]:
    """Geoms (ngeom,) that collide with anything, and are felt by skin."""
    felt: NDArray[np.bool_] = (mj.geom_contype != 0) | (mj.geom_conaffinity != 0)
    felt[np.concatenate([mj.pair_geom1, mj.pair_geom2])] = True
    return felt


def shown_geoms(mj: mujoco.MjModel) -> NDArray[np.bool_]:
    """Geoms (ngeom,) to show: what MuJoCo draws, but nothing twice, and of every body something.

    Files often have a felt geometry and a visual mesh of one surface, which flicker through each other when
    both are drawn. Small meshes on a felt geom are details, and so are visual primitives. A body of which
    nothing is in a visible group shows its felt geoms.
    """
    felt, opaque = felt_geoms(mj), mj.geom_rgba[:, 3] != 0.0
    visible = (mj.geom_group < _N_VISIBLE_GROUPS) & opaque
    is_mesh = mj.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    shown: NDArray[np.bool_] = visible.copy()
    low_m, high_m = _boxes_m(mj)
    for body in range(mj.nbody):
        geoms = int(mj.body_geomadr[body]) + np.arange(mj.body_geomnum[body])
        if not visible[geoms].any():
            shown[geoms] = felt[geoms] & opaque[geoms]
            continue
        visual = geoms[visible[geoms] & ~felt[geoms] & is_mesh[geoms]]
        for geom in geoms[visible[geoms] & felt[geoms]].tolist():
            overlap_m = np.minimum(high_m[visual], high_m[geom]) - np.maximum(low_m[visual], low_m[geom])
            filled_m3 = np.prod(np.maximum(overlap_m, 0.0), axis=1).sum()
            shown[geom] = filled_m3 < _FILLED * np.prod(high_m[geom] - low_m[geom])
    return shown


def _boxes_m(mj: mujoco.MjModel) -> tuple[Floats, Floats]:
    """Lowest and highest corners (ngeom, 3) of the boxes around all geoms, frame of their bodies [m]."""
    centre_m, half_m = np.empty((mj.ngeom, 3)), np.empty((mj.ngeom, 3))
    rotation = np.empty(9)
    for geom in range(mj.ngeom):
        mujoco.mju_quat2Mat(rotation, mj.geom_quat[geom])
        R_body_geom = rotation.reshape(3, 3)
        centre_m[geom] = mj.geom_pos[geom] + matmul(R_body_geom, mj.geom_aabb[geom, :3])
        half_m[geom] = matmul(np.abs(R_body_geom), mj.geom_aabb[geom, 3:])
    return centre_m - half_m, centre_m + half_m
