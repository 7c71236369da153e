"""Surface that a covering is asked for: a region of a link, without what other links reach, and its edges."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet.covering.felt_solids import FeltSolids
from skinnet.covering.sample_search import SurfaceSamples
from skinnet.deployment.skin.covers import CoverRegionSpec

__all__ = ["creases", "in_region"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_CREASE_COSINE = 0.7071
"""Cosine of the angle between the normals of neighbouring samples from which on they lie at a crease."""
_CREASE_REACH = 1.5
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def in_region(
    samples: SurfaceSamples, solids: FeltSolids, region: CoverRegionSpec, geom_ids: list[int]
) -> Bools:
    """Samples (n,) in all parts of `region`; `geom_ids` are those of the geoms that it names, if any."""
    point_m = samples.point_m
    inside = np.ones(len(point_m), dtype=np.bool_)
    if region.half_space is not None:
        normal = np.array(region.half_space.normal)
        length = np.sqrt((normal * normal).sum())
        inside &= (point_m * (normal / length)).sum(axis=1) >= region.half_space.offset_m
    if region.box is not None:
        inside &= (point_m >= region.box.min_m).all(axis=1) & (point_m <= region.box.max_m).all(axis=1)
    if region.interval is not None:
        axis = region.interval.axis
        direction = np.array(_AXES[axis] if isinstance(axis, str) else axis)
        along_m = (point_m * (direction / np.sqrt((direction * direction).sum()))).sum(axis=1)
        inside &= (along_m >= region.interval.min_m) & (along_m <= region.interval.max_m)
    if region.geoms:
        inside &= np.isin(solids.geom_id[samples.solid], geom_ids)
    return inside


def creases(samples: SurfaceSamples) -> Bools:
    """Samples (n,) at creases of the surface, where its normal turns by more than 45° between neighbours."""
    pairs = cKDTree(samples.point_m).query_pairs(_CREASE_REACH * samples.spacing_m, output_type="ndarray")
    a, b = pairs[:, 0], pairs[:, 1]
    sharp = (samples.normal[a] * samples.normal[b]).sum(axis=1) < _CREASE_COSINE
    at_crease = np.zeros(len(samples.point_m), dtype=np.bool_)
    at_crease[a[sharp]] = at_crease[b[sharp]] = True
    return at_crease
