"""Skin point kinematics in the world frame: position, axes, velocity, nearby solids."""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_scene import ContactScene, Motion, may_intersect_sphere
from skinnet.body.contact.rotations import rotate
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt

__all__ = ["cell_axis", "point_above_cell", "point_velocity", "solids_near_patch"]

Floats = NDArray[np.float64]


@compiled_without_nrt
def solids_near_patch(
    surface: SkinSurface,
    scene: ContactScene,
    motion: Motion,
    p: int,
    margin_m: float,
    near: NDArray[np.int64],
) -> int:
    """Collect solids within `margin_m` [m] of the cells of patch `p` in `near`; return their number."""
    b = surface.patch_body_id[p]
    centre_m = surface.patch_centre_m
    x, y, z = rotate(motion.xmat, b, centre_m[p, 0], centre_m[p, 1], centre_m[p, 2])
    x, y, z = motion.xpos[b, 0] + x, motion.xpos[b, 1] + y, motion.xpos[b, 2] + z
    radius_m = surface.patch_radius_m[p] + margin_m
    count = 0
    for k in range(len(scene.geom_id)):
        if scene.collides[p, k] and may_intersect_sphere(scene, motion, k, x, y, z, radius_m):
            near[count] = k
            count += 1
    return count


@compiled_without_nrt
def point_above_cell(
    surface: SkinSurface, motion: Motion, i: int, height_m: float
) -> tuple[float, float, float]:
    """Skin point `height_m` [m] above the rigid surface at the centre of cell `i`, world [m]."""
    b = surface.body_id[i]
    px = surface.position_m[i, 0] + height_m * surface.R_body_cell[i, 0, 2]
    py = surface.position_m[i, 1] + height_m * surface.R_body_cell[i, 1, 2]
    pz = surface.position_m[i, 2] + height_m * surface.R_body_cell[i, 2, 2]
    x, y, z = rotate(motion.xmat, b, px, py, pz)
    return motion.xpos[b, 0] + x, motion.xpos[b, 1] + y, motion.xpos[b, 2] + z


@compiled_without_nrt
def cell_axis(surface: SkinSurface, motion: Motion, i: int, column: int) -> tuple[float, float, float]:
    """Cell axis x, y or z (`column` 0, 1, 2) of cell `i`, world."""
    cell = surface.R_body_cell
    return rotate(motion.xmat, surface.body_id[i], cell[i, 0, column], cell[i, 1, column], cell[i, 2, column])


@compiled_without_nrt
def point_velocity(motion: Motion, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Linear velocity [m/s] of the point (x, y, z) of body `b`, world."""
    twist, root = motion.cvel, motion.root_body_id[b]
    rx, ry, rz = (
        x - motion.subtree_com_m[root, 0],
        y - motion.subtree_com_m[root, 1],
        z - motion.subtree_com_m[root, 2],
    )
    return (
        twist[b, 3] + twist[b, 1] * rz - twist[b, 2] * ry,
        twist[b, 4] + twist[b, 2] * rx - twist[b, 0] * rz,
        twist[b, 5] + twist[b, 0] * ry - twist[b, 1] * rx,
    )
