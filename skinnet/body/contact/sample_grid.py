"""Sample points of a cell's foam: equal parallelograms, with their corners and a finer grid in each."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["FINE_PER_SIDE", "MEDIUM_PER_SIDE", "ROUGH_PER_SIDE", "SampleGrid", "sample_grid"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

FINE_PER_SIDE = 8
"""Points per side of a sample that is partly covered: tips of 5 mm radius within 5 % from 0.2 mm depth."""
MEDIUM_PER_SIDE = 6
"""As FINE_PER_SIDE, where the pressed area ends in a nearly straight line: round sheets within 0.5 %."""
ROUGH_PER_SIDE = 4
"""As FINE_PER_SIDE, against meshes: tips of 8 mm radius within 3 % from 1 mm depth."""
_SAME_POINT = 1e-6
"""Distance below which two corners are the same, as a fraction of a sample's side."""


class SampleGrid(NamedTuple):
    """Points of a cell's foam, in the plane of the cell: corners, centres, then the fine points by sample.

    The foam of a cell is cut into s samples, equal parallelograms, whose corners are its v nodes.

    Attributes:
        x_m: (v + s + s f + s m + s r,) x of nodes, the outline's corners first, centres, inner points [m].
        y_m: As x_m [m].
        n_corners: Number of corners of the cell's outline, which is convex.
        n_nodes: v.
        n_samples: s.
        n_fine: f, fine points per sample.
        n_medium: m, points per sample of a grid that is less fine.
        n_rough: r, points per sample of the least fine grid, for solids whose rays cost more.
        node: (s, 4) corners of each sample.
        side_m: Longer side of a sample [m].
        area_m2: Area of a sample [m²].
    """

    x_m: Floats
    y_m: Floats
    n_corners: int
    n_nodes: int
    n_samples: int
    n_fine: int
    n_medium: int
    n_rough: int
    node: Indices
    side_m: float
    area_m2: float


def sample_grid(centre_m: Floats, sides_m: Floats, outline_m: Floats) -> SampleGrid:
    """Lay out the points of a cell.

    Args:
        centre_m: (s, 2) centres of the samples [m].
        sides_m: (s, 2, 2) the two sides of each, as vectors [m].
        outline_m: (·, 2) corners of the cell [m].
    """
    if not len(centre_m) or not np.any(sides_m):
        empty = np.zeros(0)
        return SampleGrid(empty, empty, 0, 0, 0, 0, 0, 0, np.zeros((0, 4), dtype=np.int64), 0.0, 0.0)
    side_m = float(np.linalg.norm(sides_m, axis=2).max())
    nodes = [*outline_m]
    node = np.empty((len(centre_m), 4), dtype=np.int64)
    for s, (middle_m, (one_m, other_m)) in enumerate(zip(centre_m, sides_m, strict=True)):
        for corner, (a, b) in enumerate(((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))):
            place_m = middle_m + a * one_m + b * other_m
            apart_m = np.linalg.norm(np.array(nodes) - place_m, axis=1)
            nearest = int(np.argmin(apart_m))
            if apart_m[nearest] > _SAME_POINT * side_m:
                nearest = len(nodes)
                nodes.append(place_m)
            node[s, corner] = nearest
    finer_m = [
        _inner_points_m(centre_m, sides_m, n) for n in (FINE_PER_SIDE, MEDIUM_PER_SIDE, ROUGH_PER_SIDE)
    ]
    points_m = np.concatenate([np.array(nodes), centre_m, *finer_m])
    (ax, ay), (bx, by) = sides_m[0]
    return SampleGrid(
        x_m=np.ascontiguousarray(points_m[:, 0]),
        y_m=np.ascontiguousarray(points_m[:, 1]),
        n_corners=len(outline_m),
        n_nodes=len(nodes),
        n_samples=len(centre_m),
        n_fine=FINE_PER_SIDE**2,
        n_medium=MEDIUM_PER_SIDE**2,
        n_rough=ROUGH_PER_SIDE**2,
        node=node,
        side_m=side_m,
        area_m2=abs(float(ax * by - ay * bx)),
    )


def _inner_points_m(centre_m: Floats, sides_m: Floats, per_side: int) -> Floats:
    """Points (s n², 2) [m] in all samples, n = `per_side` along each side, in the middle of equal parts."""
    steps = (np.arange(per_side) + 0.5) / per_side - 0.5
    a, b = (each.ravel()[:, None] for each in np.meshgrid(steps, steps, indexing="ij"))
    points_m = centre_m[:, None] + a * sides_m[:, None, 0] + b * sides_m[:, None, 1]
    return points_m.reshape(-1, 2)
