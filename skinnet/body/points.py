"""Skin point kinematics in the world frame: position, axes, velocity, nearby solids."""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.frames import rotated
from skinnet.body.scene import Motion, Scene, within
from skinnet.body.surface import Surface
from skinnet.compiled import borrowing

__all__ = ["axis", "lifted", "near_patch", "velocity"]

Floats = NDArray[np.float64]


@borrowing
def near_patch(
    surface: Surface, scene: Scene, motion: Motion, p: int, margin_m: float, near: NDArray[np.int64]
) -> int:
    """Collect solids within `margin_m` [m] of the cells of patch `p` in `near`; return their number."""
    b = surface.patch_body[p]
    centre_m = surface.patch_centre_m
    x, y, z = rotated(motion.xmat, b, centre_m[p, 0], centre_m[p, 1], centre_m[p, 2])
    x, y, z = motion.xpos[b, 0] + x, motion.xpos[b, 1] + y, motion.xpos[b, 2] + z
    radius_m = surface.patch_radius_m[p] + margin_m
    count = 0
    for k in range(len(scene.geom)):
        if scene.felt[p, k] and within(scene, motion, k, x, y, z, radius_m):
            near[count] = k
            count += 1
    return count


@borrowing
def lifted(surface: Surface, motion: Motion, i: int, height_m: float) -> tuple[float, float, float]:
    """Skin point `height_m` [m] above the rigid surface at the centre of cell `i`, world [m]."""
    b = surface.body[i]
    px = surface.position_m[i, 0] + height_m * surface.R_body_cell[i, 0, 2]
    py = surface.position_m[i, 1] + height_m * surface.R_body_cell[i, 1, 2]
    pz = surface.position_m[i, 2] + height_m * surface.R_body_cell[i, 2, 2]
    x, y, z = rotated(motion.xmat, b, px, py, pz)
    return motion.xpos[b, 0] + x, motion.xpos[b, 1] + y, motion.xpos[b, 2] + z


@borrowing
def axis(surface: Surface, motion: Motion, i: int, column: int) -> tuple[float, float, float]:
    """Cell axis x, y or z (`column` 0, 1, 2) of cell `i`, world."""
    cell = surface.R_body_cell
    return rotated(motion.xmat, surface.body[i], cell[i, 0, column], cell[i, 1, column], cell[i, 2, column])


@borrowing
def velocity(motion: Motion, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Linear velocity [m/s] of the point (x, y, z) of body `b`, world."""
    twist, root = motion.cvel, motion.root[b]
    rx, ry, rz = x - motion.centre_m[root, 0], y - motion.centre_m[root, 1], z - motion.centre_m[root, 2]
    return (
        twist[b, 3] + twist[b, 1] * rz - twist[b, 2] * ry,
        twist[b, 4] + twist[b, 2] * rx - twist[b, 0] * rz,
        twist[b, 5] + twist[b, 0] * ry - twist[b, 1] * rx,
    )
