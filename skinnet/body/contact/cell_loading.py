"""Loading of a cell's foam: where solids overlap it, by how much, and over which area.

The overlap of foam and a convex solid is a concave function d over the plane of the cell, and the pressed
area d > 0 is convex. So a few points tell where a sample, a parallelogram, needs more of them:

- with all corners pressed it is pressed as a whole, and its mean overlap lies between the mean of its corners
  and that at its centre c; (2 d(c) + mean of corners) / 3 is exact for quadratic functions;
- d ≤ 2 d(c) - min d(corners) everywhere in it: where that is negative, nothing presses it;
- all else is cut into a finer grid: a medium one where a side is pressed and the overlap bends little, a
  rough one against meshes.

A sample enters the forces as one point for its pressed part, with the area of that part, the mean overlap
there, and its centre of pressure; and as one for the part that the coming step may press.
"""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_problem import RAY_START_DEPTH_M, ContactProblem
from skinnet.body.contact.parallel_rays import CellInSolid, cast_rays, cell_in_solid, lowest_height_m
from skinnet.body.contact.ray_casting import MESH, PLANE
from skinnet.body.contact.sample_grid import SampleGrid
from skinnet.body.contact.sample_points import (
    add_partial_sample,
    add_whole_sample,
    add_whole_samples,
    keep_nearest,
    meet_nothing,
)
from skinnet.compilation import compiled_inline, compiled_without_nrt

__all__ = ["find_loaded_points"]

_NONE, _ROUGH, _MEDIUM, _FINE = 0, 1, 2, 3
"""Grids in a sample, by number of points."""

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_FLAT = 0.02
"""Nonlinearity of the overlap, as a fraction of it, up to which centres alone stand for a pressed cell."""
_CURVED = 0.5
"""Nonlinearity of the overlap over a sample, as a fraction of it, from which a finer grid is used."""
_NEARLY_PLANE = 0.02
"""Nonlinearity of the overlap, in sides of a sample, up to which a medium grid tells what is pressed."""
_FEW_NODES = 2
"""Nodes per corner of a cell up to which one call casts the rays from all at once."""
_NARROW = 2.0
"""Half width of a solid, in sides of a sample, below which it may lie between all points of a sample."""


@compiled_without_nrt
def find_loaded_points(problem: ContactProblem, cell: int, n_close: int, face_m: float) -> bool:
    """Add the loaded points of cell `cell` against the first `n_close` solids of `workspace.close`.

    Solids are sought up to the height `face_m` [m], which the step may bring into contact.

    Returns:
        True if the points are one in each sample, in their order, against one solid.
    """
    surface, scene, workspace = problem.surface, problem.scene, problem.workspace
    grid, close = surface.grid, workspace.close
    face_m, top_m = RAY_START_DEPTH_M + problem.foam.thickness_m, RAY_START_DEPTH_M + face_m
    centres, fines = grid.n_nodes, grid.n_nodes + grid.n_samples
    met, has_few_nodes, limit, finest = 0, grid.n_nodes <= _FEW_NODES * grid.n_corners, _FINE, _NONE
    for j in range(n_close):
        k = close[j]
        f, above_m = _frame(problem, cell, k), _above_m(problem, cell, k)
        if lowest_height_m(scene, k, f) + above_m >= top_m:
            continue
        if met == 0:
            meet_nothing(problem, centres, fines, top_m)
            for s in range(len(workspace.inner_grid)):
                workspace.inner_grid[s] = _NONE
        close[met] = k
        met += 1
        if has_few_nodes:
            _cast(problem, cell, k, f, 0, fines)
        else:
            _cast(problem, cell, k, f, 0, grid.n_corners)
            _cast(problem, cell, k, f, centres, fines)
        if not _is_flat(problem, face_m - above_m):
            if not has_few_nodes:
                _cast(problem, cell, k, f, grid.n_corners, centres)
            finest = max(finest, _judge(problem, k, f, face_m - above_m, top_m - above_m))
        keep_nearest(problem, centres, fines, k, above_m)
        if scene.geom_type[k] == MESH:
            limit = _ROUGH
    if met == 0:
        return False
    if finest == _NONE:
        return add_whole_samples(problem, face_m)
    for s in range(grid.n_samples):
        workspace.inner_grid[s] = min(workspace.inner_grid[s], limit)
    _cast_inner(problem, cell, met, top_m)
    for s in range(grid.n_samples):
        if workspace.inner_grid[s] > _NONE:
            first, n_inner = _inner_points(grid, s, workspace.inner_grid[s])
            add_partial_sample(problem, s, met, face_m, first, n_inner)
        else:
            add_whole_sample(problem, s, face_m)
    return False


@compiled_inline
def _start_m(problem: ContactProblem, cell: int, k: int) -> float:
    """Depth [m] below the rigid surface at which the rays of cell `cell` at solid `k` start."""
    deepest_m = RAY_START_DEPTH_M + problem.scene.max_indentation_m[k]
    return float(min(deepest_m, problem.start_depth_m[cell]))


@compiled_without_nrt
def _frame(problem: ContactProblem, cell: int, k: int) -> CellInSolid:
    """Frame of cell `cell` in that of solid `k`, with rays from where they may start."""
    start_m = _start_m(problem, cell, k)
    stretch = 1.0 + problem.surface.curvature_per_m[cell] * problem.foam.thickness_m
    return cell_in_solid(problem.surface, problem.scene, problem.motion, cell, k, start_m, stretch)


@compiled_inline
def _above_m(problem: ContactProblem, cell: int, k: int) -> float:
    """Height [m] of the start of the rays at solid `k` above `RAY_START_DEPTH_M`."""
    return RAY_START_DEPTH_M - _start_m(problem, cell, k)


@compiled_without_nrt
def _cast(problem: ContactProblem, cell: int, k: int, f: CellInSolid, first: int, last: int) -> None:
    """Fill the heights [m] of solid `k` above points `first` to `last` of cell `cell`.

    A curved piece of skin is a plane one whose face falls off by x² / 2 r, at the radius r of the face.
    """
    grid, height_m = problem.surface.grid, problem.workspace.height_m
    cast_rays(problem.scene, k, f, grid.x_m, grid.y_m, first, last, height_m)
    curvature_per_m = problem.surface.curvature_per_m[cell]
    if curvature_per_m != 0.0:
        fall_per_m = 0.5 * curvature_per_m * f.stretch
        for i in range(first, last):
            height_m[i] += fall_per_m * grid.x_m[i] * grid.x_m[i]


@compiled_without_nrt
def _is_flat(problem: ContactProblem, face_m: float) -> bool:
    """True if all corners of the cell are pressed and its centres alone stand for the overlap.

    Heights count from the start of the rays: `face_m` of the foam's face [m].
    """
    grid, height_m = problem.surface.grid, problem.workspace.height_m
    highest_m, corners_m, middle_m = 0.0, 0.0, 0.0
    for i in range(grid.n_corners):
        highest_m = max(highest_m, height_m[i])
        corners_m += height_m[i] / grid.n_corners
    if highest_m >= face_m:
        return False
    centre_m = height_m[grid.n_nodes : grid.n_nodes + grid.n_samples]
    for s in range(grid.n_samples):
        middle_m += centre_m[s] / grid.n_samples
    return bool(corners_m - middle_m <= _FLAT * (face_m - middle_m))


@compiled_without_nrt
def _judge(problem: ContactProblem, k: int, f: CellInSolid, face_m: float, top_m: float) -> int:
    """Mark the samples that need an inner grid against solid `k`; return the finest that one of them does.

    The heights of all others become their means. Heights count from the start of the rays: `face_m` of the
    foam's face, `top_m` of what is sought [m].
    """
    workspace, grid, finest = problem.workspace, problem.surface.grid, _NONE
    height_m, inner_grid, centres = workspace.height_m, workspace.inner_grid, grid.n_nodes
    is_narrow = _half_width_m(problem, k) < _NARROW * grid.side_m
    for s in range(grid.n_samples):
        here_m = height_m[centres + s]
        lowest_m, highest_m, corners_m, pressed = here_m, 0.0, 0.0, 0
        for c in range(4):
            corner_m = height_m[grid.node[s, c]]
            lowest_m, highest_m = min(lowest_m, corner_m), max(highest_m, corner_m)
            corners_m += 0.25 * corner_m
            pressed += corner_m < face_m
        if here_m < math.inf and highest_m < math.inf:
            bend_m = max(corners_m - here_m, 0.0)
            if highest_m < face_m:
                if bend_m <= _CURVED * (face_m - here_m):
                    height_m[centres + s] = here_m + bend_m / 3.0
                else:
                    inner_grid[s] = _FINE
            elif 2.0 * here_m - highest_m < face_m:
                is_plane = pressed >= 2 and bend_m <= _NEARLY_PLANE * grid.side_m
                inner_grid[s] = max(inner_grid[s], _MEDIUM if is_plane else _FINE)
        elif lowest_m < top_m + 0.5 * grid.side_m or (
            lowest_m == math.inf and is_narrow and _may_lie_over(problem, k, f, s)
        ):
            inner_grid[s] = _FINE
        finest = max(finest, inner_grid[s])
    return finest


@compiled_inline
def _half_width_m(problem: ContactProblem, k: int) -> float:
    """Half of the least width [m] of solid `k`; of its bounding box for meshes."""
    if problem.scene.geom_type[k] == PLANE:
        return math.inf
    box_m = problem.scene.bounding_box_m
    return float(min(box_m[k, 3], box_m[k, 4], box_m[k, 5]))


@compiled_inline
def _may_lie_over(problem: ContactProblem, k: int, f: CellInSolid, s: int) -> bool:
    """True if the bounding sphere of solid `k` lies over a part of sample `s`."""
    grid = problem.surface.grid
    i = grid.n_nodes + s
    x, y, z = f.x, f.y, f.z
    if problem.scene.geom_type[k] == MESH:  # its bounding sphere is about the middle of its box
        box_m = problem.scene.bounding_box_m
        x, y, z = x - box_m[k, 0], y - box_m[k, 1], z - box_m[k, 2]
    u = grid.x_m[i] + x * f.xx + y * f.xy + z * f.xz
    v = grid.y_m[i] + x * f.yx + y * f.yy + z * f.yz
    reach_m = problem.scene.bounding_radius_m[k] + grid.side_m
    return bool(u * u + v * v < reach_m * reach_m)


@compiled_inline
def _inner_points(grid: SampleGrid, s: int, inner_grid: int) -> tuple[int, int]:
    """First point of the finer grid in sample `s`, and their number."""
    first = grid.n_nodes + grid.n_samples
    if inner_grid == _FINE:
        return first + s * grid.n_fine, grid.n_fine
    first += grid.n_samples * grid.n_fine
    if inner_grid == _MEDIUM:
        return first + s * grid.n_medium, grid.n_medium
    return first + grid.n_samples * grid.n_medium + s * grid.n_rough, grid.n_rough


@compiled_without_nrt
def _cast_inner(problem: ContactProblem, cell: int, met: int, top_m: float) -> None:
    """Cast rays from the finer grids in all marked samples of cell `cell` at the first `met` solids."""
    grid, workspace = problem.surface.grid, problem.workspace
    for s in range(grid.n_samples):
        if workspace.inner_grid[s] > _NONE:
            first, n_inner = _inner_points(grid, s, workspace.inner_grid[s])
            meet_nothing(problem, first, first + n_inner, top_m)
    for j in range(met):
        k = workspace.close[j]
        f, above_m = _frame(problem, cell, k), _above_m(problem, cell, k)
        for s in range(grid.n_samples):
            if workspace.inner_grid[s] == _NONE:
                continue
            first, n_inner = _inner_points(grid, s, workspace.inner_grid[s])
            _cast(problem, cell, k, f, first, first + n_inner)
            keep_nearest(problem, first, first + n_inner, k, above_m)
