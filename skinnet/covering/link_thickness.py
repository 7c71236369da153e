"""Thickness of a link: least distance of two parallel planes that hold its felt solids between them.

One of the planes lies along a face of the convex hull of the solids, or of points on them where they are
round.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from skinnet.body.contact import ray_casting as shapes
from skinnet.covering.felt_solids import FeltSolids
from skinnet.covering.sample_search import SurfaceSamples

__all__ = ["thickness_m"]

Floats = NDArray[np.float64]

_SAMPLES = 400
"""Number of samples of primitives, about, from which the planes are taken."""


def thickness_m(solids: FeltSolids, samples: SurfaceSamples) -> float:
    """Thickness [m] of `solids`, of which these are `samples`."""
    corner_m = np.unique(solids.corner_m.reshape(-1, 3), axis=0)
    on_primitives = samples.point_m[solids.hull[samples.solid] < 0]
    point_m = np.concatenate([corner_m, on_primitives[:: max(len(on_primitives) // _SAMPLES, 1)]])
    along = ConvexHull(point_m).equations[:, :3]
    primitives = np.flatnonzero(solids.hull < 0)
    ends_m = [_ends_m(solids, k, along) for k in primitives.tolist()]
    if len(corner_m):
        height_m = np.einsum("dk,pk->dp", along, corner_m)
        ends_m.append((height_m.min(axis=1), height_m.max(axis=1)))
    low_m, high_m = (np.stack(side) for side in zip(*ends_m, strict=True))
    return float((high_m.max(axis=0) - low_m.min(axis=0)).min())


def _ends_m(solids: FeltSolids, k: int, along: Floats) -> tuple[Floats, Floats]:
    """Lowest and highest coordinates (d,) [m] of primitive `k` along unit directions (d, 3)."""
    a, b, c = solids.size_m[k].tolist()
    x, y, z = np.abs(np.einsum("di,ij->dj", along, solids.R_body_solid[k])).T
    match int(solids.kind[k]):
        case shapes.BOX:
            half_m = a * x + b * y + c * z
        case shapes.CYLINDER:
            half_m = a * np.sqrt(x * x + y * y) + b * z
        case shapes.ELLIPSOID:
            half_m = np.sqrt(a * a * x * x + b * b * y * y + c * c * z * z)
        case shapes.CAPSULE:
            half_m = a + b * z
        case _:
            half_m = np.full(len(along), a)
    centre_m = np.einsum("di,i->d", along, solids.position_m[k])
    return centre_m - half_m, centre_m + half_m
