"""Sites of a growing lattice: places that cells predict for their neighbours."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.compilation import compiled_without_nrt
from skinnet.covering.cell_limits import CellLimits
from skinnet.covering.cell_settling import Ground, Scratch, hexagon_direction
from skinnet.covering.surface_walk import walk_one_pitch

__all__ = ["Sites", "new_sites", "predict_neighbours", "take_next_site"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_SITE_FRACTION = 0.5
"""Distance of predictions of one site, as a fraction of the pitch."""
_ALIKE_COSINE = pinned_math.cos(math.radians(18.0))
"""Least cosine between axes that are averaged."""
_FILLED_FRACTION = 0.55
_MAX_TRIES = 3


class Sites(NamedTuple):
    """Predicted sites: their means, the number of predictions, tries so far, and whether they are open."""

    sum_m: Floats
    x_axis: Floats
    normal: Floats
    weight: Floats
    tries: Indices
    open: Bools


def new_sites(capacity: int) -> Sites:
    """Allocate room for so many sites."""
    return Sites(
        np.zeros((capacity, 3)),
        np.zeros((capacity, 3)),
        np.zeros((capacity, 3)),
        np.zeros(capacity),
        np.zeros(capacity, dtype=np.int64),
        np.zeros(capacity, dtype=np.bool_),
    )


@compiled_without_nrt
def predict_neighbours(
    ground: Ground,
    limits: CellLimits,
    positions_m: Floats,
    rotations: Floats,
    n_cells: int,
    sites: Sites,
    n_sites: int,
    w: Scratch,
) -> int:
    """Predict the neighbours of the last cell and close the sites that it fills; return their number."""
    i, reach_m = n_cells - 1, _FILLED_FRACTION * limits.pitch_m
    for site in range(n_sites):
        if sites.open[site]:
            x, y, z = (
                sites.sum_m[site, 0] / sites.weight[site] - positions_m[i, 0],
                sites.sum_m[site, 1] / sites.weight[site] - positions_m[i, 1],
                sites.sum_m[site, 2] / sites.weight[site] - positions_m[i, 2],
            )
            alike = (
                sites.normal[site, 0] * rotations[i, 0, 2]
                + sites.normal[site, 1] * rotations[i, 1, 2]
                + sites.normal[site, 2] * rotations[i, 2, 2]
            )
            if x * x + y * y + z * z < reach_m * reach_m and alike > 0.0:
                sites.open[site] = False
    for k in range(6):
        c, s = hexagon_direction(k)
        if (
            n_sites < len(sites.open)
            and walk_one_pitch(
                ground.solids,
                ground.samples,
                limits.pitch_m,
                positions_m[i],
                rotations[i],
                c,
                s,
                w.target_m,
                w.normal,
                w.x_axis,
            )
            and not _is_filled(positions_m, rotations, n_cells, w, reach_m)
        ):
            n_sites = _add_prediction(sites, n_sites, w, _SITE_FRACTION * limits.pitch_m)
    return n_sites


@compiled_without_nrt
def _is_filled(positions_m: Floats, rotations: Floats, n_cells: int, w: Scratch, reach_m: float) -> bool:
    for j in range(n_cells):
        x, y, z = (
            w.target_m[0] - positions_m[j, 0],
            w.target_m[1] - positions_m[j, 1],
            w.target_m[2] - positions_m[j, 2],
        )
        if x * x + y * y + z * z < reach_m * reach_m:
            R = rotations
            if w.normal[0] * R[j, 0, 2] + w.normal[1] * R[j, 1, 2] + w.normal[2] * R[j, 2, 2] > 0.0:
                return True
    return False


@compiled_without_nrt
def _add_prediction(sites: Sites, n_sites: int, w: Scratch, reach_m: float) -> int:
    """Add the prediction in `w` to its site, or as a new one; a site that failed is tried again."""
    for site in range(n_sites):
        x, y, z = (
            sites.sum_m[site, 0] / sites.weight[site] - w.target_m[0],
            sites.sum_m[site, 1] / sites.weight[site] - w.target_m[1],
            sites.sum_m[site, 2] / sites.weight[site] - w.target_m[2],
        )
        if x * x + y * y + z * z > reach_m * reach_m:
            continue
        n, a = sites.normal, sites.x_axis
        if n[site, 0] * w.normal[0] + n[site, 1] * w.normal[1] + n[site, 2] * w.normal[2] < 0.3:
            continue
        if sites.tries[site] >= _MAX_TRIES:
            return n_sites
        weight = sites.weight[site]
        sites.weight[site] += 1.0
        sites.open[site] = True
        best, turn = -2.0, 0
        nx, ny, nz = w.normal[0], w.normal[1], w.normal[2]
        ux, uy, uz = w.x_axis[0], w.x_axis[1], w.x_axis[2]
        vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        for k in range(6):
            c, s = hexagon_direction(k)
            alike = (
                a[site, 0] * (c * ux + s * vx)
                + a[site, 1] * (c * uy + s * vy)
                + a[site, 2] * (c * uz + s * vz)
            )
            if alike > best + 1e-9:
                best, turn = alike, k
        c, s = hexagon_direction(turn)
        length = math.sqrt(a[site, 0] * a[site, 0] + a[site, 1] * a[site, 1] + a[site, 2] * a[site, 2])
        for m in range(3):
            sites.sum_m[site, m] += w.target_m[m]
            n[site, m] = (weight * n[site, m] + w.normal[m]) / (weight + 1.0)
        if best >= _ALIKE_COSINE * length:
            a[site, 0] += c * ux + s * vx
            a[site, 1] += c * uy + s * vy
            a[site, 2] += c * uz + s * vz
        return n_sites
    for m in range(3):
        sites.sum_m[n_sites, m], sites.normal[n_sites, m] = w.target_m[m], w.normal[m]
        sites.x_axis[n_sites, m] = w.x_axis[m]
    sites.weight[n_sites] = 1.0
    sites.tries[n_sites] = 0
    sites.open[n_sites] = True
    return n_sites + 1


@compiled_without_nrt
def take_next_site(sites: Sites, n_sites: int, w: Scratch) -> bool:
    """Put the open site with most predictions, the first of equals, into `w` and close it; False: none."""
    best = -1
    for site in range(n_sites):
        if sites.open[site] and (best < 0 or sites.weight[site] > sites.weight[best]):
            best = site
    if best < 0:
        return False
    sites.open[best] = False
    sites.tries[best] += 1
    n = sites.normal
    length = math.sqrt(n[best, 0] * n[best, 0] + n[best, 1] * n[best, 1] + n[best, 2] * n[best, 2])
    for k in range(3):
        w.target_m[k] = sites.sum_m[best, k] / sites.weight[best]
        w.normal[k] = n[best, k] / length
        w.x_axis[k] = sites.x_axis[best, k]
    return True
