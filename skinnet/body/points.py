"""Points of the skin in the world: where they are, how they move, what is near them."""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.scene import Motion, Scene, within
from skinnet.body.surface import Surface
from skinnet.compiled import compiled

__all__ = ["axis", "lifted", "near_patch", "velocity"]


@compiled
def near_patch(
    surface: Surface, scene: Scene, motion: Motion, p: int, margin_m: float, near: NDArray[np.int64]
) -> int:
    """Puts the solids that come within `margin_m` of the cells of patch `p` into `near`; returns how many."""
    b = surface.patch_body[p]
    axes, centre = motion.xmat[b], surface.patch_centre_m[p]
    x = motion.xpos[b, 0] + axes[0] * centre[0] + axes[1] * centre[1] + axes[2] * centre[2]
    y = motion.xpos[b, 1] + axes[3] * centre[0] + axes[4] * centre[1] + axes[5] * centre[2]
    z = motion.xpos[b, 2] + axes[6] * centre[0] + axes[7] * centre[1] + axes[8] * centre[2]
    radius_m = surface.patch_radius_m[p] + margin_m
    count = 0
    for k in range(len(scene.geom)):
        if scene.felt[p, k] and within(scene, motion, k, x, y, z, radius_m):
            near[count] = k
            count += 1
    return count


@compiled
def lifted(surface: Surface, motion: Motion, i: int, height_m: float) -> tuple[float, float, float]:
    """Point `height_m` above the middle of cell `i` on the rigid surface, world [m]."""
    b = surface.body[i]
    axes, rotation = motion.xmat[b], surface.R_body_cell[i]
    px = surface.position_m[i, 0] + height_m * rotation[0, 2]
    py = surface.position_m[i, 1] + height_m * rotation[1, 2]
    pz = surface.position_m[i, 2] + height_m * rotation[2, 2]
    return (
        motion.xpos[b, 0] + axes[0] * px + axes[1] * py + axes[2] * pz,
        motion.xpos[b, 1] + axes[3] * px + axes[4] * py + axes[5] * pz,
        motion.xpos[b, 2] + axes[6] * px + axes[7] * py + axes[8] * pz,
    )


@compiled
def axis(surface: Surface, motion: Motion, i: int, column: int) -> tuple[float, float, float]:
    """Axis x, y or z (0, 1, 2) of cell `i`, world."""
    axes, rotation = motion.xmat[surface.body[i]], surface.R_body_cell[i]
    u, v, w = rotation[0, column], rotation[1, column], rotation[2, column]
    return (
        axes[0] * u + axes[1] * v + axes[2] * w,
        axes[3] * u + axes[4] * v + axes[5] * w,
        axes[6] * u + axes[7] * v + axes[8] * w,
    )


@compiled
def velocity(motion: Motion, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Velocity [m/s] of the point (x, y, z) of body `b`, world."""
    centre, twist = motion.centre_m[motion.root[b]], motion.cvel[b]
    rx, ry, rz = x - centre[0], y - centre[1], z - centre[2]
    return (
        twist[3] + twist[1] * rz - twist[2] * ry,
        twist[4] + twist[2] * rx - twist[0] * rz,
        twist[5] + twist[0] * ry - twist[1] * rx,
    )
