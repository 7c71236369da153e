"""Points on the surface of felt geoms, in the world: enough of them to see how far a link reaches."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.convex_hull import hull_vertices_m

__all__ = ["world_points_m"]

Floats = NDArray[np.float64]
_N_POINTS = 400


def world_points_m(mj: mujoco.MjModel, data: mujoco.MjData, geoms: Sequence[int]) -> Floats:
    """Points (n, 3) on the surfaces of primitives and convex hulls, world frame [m].

    Args:
        mj: The model.
        data: Its state, after forward kinematics.
        geoms: Ids of the geoms.
    """
    found = [np.zeros((0, 3))]
    for geom in geoms:
        R = data.geom_xmat[geom].reshape(3, 3)
        found.append((_points_m(mj, geom)[:, None, :] * R).sum(axis=2) + data.geom_xpos[geom])
    return np.concatenate(found)


def _points_m(mj: mujoco.MjModel, geom: int) -> Floats:
    """Points (n, 3) on the surface of a geom, frame of the geom [m]."""
    size_m = mj.geom_size[geom]
    kind = mujoco.mjtGeom(mj.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return hull_vertices_m(mj, int(mj.geom_dataid[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        corners_m: Floats = np.array(list(np.ndindex(2, 2, 2))) * 2.0 * size_m - size_m
        return corners_m
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        turn = np.linspace(0.0, 2.0 * np.pi, _N_POINTS // 4, endpoint=False)
        ring_m = np.stack([size_m[0] * np.cos(turn), size_m[0] * np.sin(turn)], axis=1)
        ends_m = [np.column_stack([ring_m, np.full(len(turn), z)]) for z in (-size_m[1], size_m[1])]
        return np.concatenate(ends_m)
    sphere = _unit_sphere()
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        points_m: Floats = size_m[0] * sphere
        points_m[:, 2] += np.sign(sphere[:, 2]) * size_m[1]
        return points_m
    radii_m = size_m if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size_m[0])
    scaled: Floats = sphere * radii_m
    return scaled


def _unit_sphere() -> Floats:
    """Points (n, 3) spread evenly over the unit sphere (Fibonacci)."""
    i = np.arange(_N_POINTS) + 0.5
    z, turn = 1.0 - 2.0 * i / _N_POINTS, i * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
