"""Thickness of links under skin: how deep rays may start without leaving the link on its other side."""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_scene import ContactScene, ray_distance_m
from skinnet.body.contact.point_kinematics import Motion, cell_axis, point_above_cell
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt

__all__ = ["start_depths_m"]

Floats = NDArray[np.float64]
_MARGIN_M = 0.005
"""Distance [m] of the start of rays from the far face of a link, where a solid may penetrate (assumed)."""


def start_depths_m(surface: SkinSurface, scene: ContactScene, motion: Motion, deepest_m: float) -> Floats:
    """Start depths (n,) of the rays of all cells [m]: within the link, at most `deepest_m`.

    Rays start 5 mm before the far face of the link, in the middle of one that is thinner than 10 mm.
    A solid that presses the far face of a thin link is then beyond the start, and not felt. Where a cell has
    no solid of its own link under it, nothing limits the depth.
    """
    depths_m = np.full(len(surface.body_id), deepest_m)
    _limit_depths(surface, scene, motion, depths_m)
    return depths_m


@compiled_without_nrt
def _limit_depths(surface: SkinSurface, scene: ContactScene, motion: Motion, depths_m: Floats) -> None:
    for i in range(len(depths_m)):
        below_m = depths_m[i] + _MARGIN_M
        x, y, z = point_above_cell(surface, motion, i, -below_m)
        nx, ny, nz = cell_axis(surface, motion, i, 2)
        nearest_m = np.inf
        for k in range(len(scene.geom_id)):
            if scene.body_id[k] == surface.body_id[i]:
                nearest_m = min(nearest_m, ray_distance_m(scene, motion, k, x, y, z, nx, ny, nz))
        if nearest_m < below_m:
            thickness_m = below_m - nearest_m
            depths_m[i] = min(depths_m[i], thickness_m - min(0.5 * thickness_m, _MARGIN_M))
