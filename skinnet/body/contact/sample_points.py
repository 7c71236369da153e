"""Loaded points of the samples of a cell, once it is known which solid each of its points meets first.

Loops over points are short and without branches where they can be: the compiler makes vector instructions of
them. So each fills one array, and lengths are those of slices, which are known not to be negative.
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_problem import ContactProblem
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.compilation import compiled_inline, compiled_without_nrt

__all__ = ["add_partial_sample", "add_whole_sample", "add_whole_samples", "keep_nearest", "meet_nothing"]

Floats = NDArray[np.float64]


@compiled_without_nrt
def meet_nothing(problem: ContactProblem, first: int, end: int, top_m: float) -> None:
    """Let points `first` to `end` meet nothing below the height `top_m` [m]."""
    hit, nearest_m = problem.workspace.hit[first:end], problem.workspace.nearest_m[first:end]
    for i in range(len(hit)):
        hit[i] = -1
    for i in range(len(hit)):
        nearest_m[i] = top_m


@compiled_without_nrt
def keep_nearest(problem: ContactProblem, first: int, end: int, k: int, above_m: float) -> None:
    """Let points `first` to `end` meet solid `k` where it is nearest; its rays start `above_m` [m] higher.

    Without branches, for vector instructions.
    """
    workspace = problem.workspace
    hit, nearest_m = workspace.hit[first:end], workspace.nearest_m[first:end]
    height_m = workspace.height_m[first:end]
    for i in range(len(hit)):
        here_m, known_m = height_m[i] + above_m, nearest_m[i]
        nearest_m[i] = here_m if here_m < known_m else known_m
        hit[i] = k if here_m < known_m else hit[i]


@compiled_without_nrt
def add_whole_samples(problem: ContactProblem, face_m: float) -> bool:
    """Add one point for each sample that is near a solid; return True if all are near the same one.

    That is most of a large contact, and has short loops of its own, for vector instructions.
    """
    grid, workspace, points = problem.surface.grid, problem.workspace, problem.points
    centres, fines, first, same = grid.n_nodes, grid.n_nodes + grid.n_samples, points.total[0], 0
    end, hit, nearest_m = (
        first + grid.n_samples,
        workspace.hit[centres:fines],
        workspace.nearest_m[centres:fines],
    )
    k = hit[0]
    for s in range(len(hit)):
        same += hit[s] == k
    if same < len(hit) or k < 0 or end > len(points.sample):
        for s in range(len(hit)):
            add_whole_sample(problem, s, face_m)
        return False
    deepest_m = problem.foam.thickness_m + problem.scene.max_indentation_m[k]
    sample, solid, area_m2 = points.sample[first:end], points.solid[first:end], points.area_m2[first:end]
    x_m, y_m = points.x_m[first:end], points.y_m[first:end]
    depth_m, square_m2 = points.depth_m[first:end], points.square_m2[first:end]
    centre_x_m, centre_y_m = grid.x_m[centres:fines], grid.y_m[centres:fines]
    for s in range(len(depth_m)):
        depth_m[s] = min(face_m - nearest_m[s], deepest_m)
    for s in range(len(depth_m)):
        square_m2[s] = depth_m[s] * depth_m[s]
    for s in range(len(depth_m)):
        x_m[s] = centre_x_m[s]
    for s in range(len(depth_m)):
        y_m[s] = centre_y_m[s]
    for s in range(len(depth_m)):
        area_m2[s] = grid.area_m2
    for s in range(len(depth_m)):
        sample[s] = s
    for s in range(len(depth_m)):
        solid[s] = k
    points.total[0] = end
    return True


@compiled_without_nrt
def add_whole_sample(problem: ContactProblem, s: int, face_m: float) -> None:
    """Add one point for sample `s` if it is near a solid."""
    grid, workspace = problem.surface.grid, problem.workspace
    i = grid.n_nodes + s
    k = workspace.hit[i]
    if k < 0:
        return
    deepest_m = problem.foam.thickness_m + problem.scene.max_indentation_m[k]
    depth_m = min(face_m - workspace.nearest_m[i], deepest_m)
    square_m2 = depth_m * depth_m
    _add_point(problem.points, s, k, grid.area_m2, depth_m, square_m2, grid.x_m[i], grid.y_m[i])


@compiled_without_nrt
def add_partial_sample(
    problem: ContactProblem, s: int, met: int, face_m: float, first: int, n_inner: int
) -> None:
    """Add the parts of sample `s` that each solid presses, or may press in the coming step."""
    grid, workspace, points = problem.surface.grid, problem.workspace, problem.points
    end, inner_m2 = first + n_inner, grid.area_m2 / n_inner
    hit, nearest_m = workspace.hit[first:end], workspace.nearest_m[first:end]
    grid_x_m, grid_y_m = grid.x_m[first:end], grid.y_m[first:end]
    overlap_m = workspace.height_m[first:end]  # heights are no longer needed
    for j in range(met):
        k = workspace.close[j]
        deepest_m = problem.foam.thickness_m + problem.scene.max_indentation_m[k]
        near = pressed = 0
        for i in range(len(hit)):
            d = min(face_m - nearest_m[i], deepest_m)
            d = d if hit[i] == k else 0.0
            overlap_m[i] = d if d > 0.0 else 0.0
        for i in range(len(hit)):
            near += hit[i] == k
        for i in range(len(hit)):
            pressed += overlap_m[i] > 0.0
        near -= pressed
        if pressed > 0:
            _add_pressed_part(points, s, k, pressed * inner_m2, pressed, overlap_m, grid_x_m, grid_y_m)
        if near > 0:
            gap_m = near_x_m = near_y_m = 0.0
            for i in range(len(hit)):
                if hit[i] == k and overlap_m[i] <= 0.0:
                    gap_m += face_m - nearest_m[i]
                    near_x_m += grid_x_m[i]
                    near_y_m += grid_y_m[i]
            _add_point(points, s, k, near * inner_m2, gap_m / near, 0.0, near_x_m / near, near_y_m / near)


@compiled_without_nrt
def _add_pressed_part(
    points: LoadedPoints,
    s: int,
    k: int,
    area_m2: float,
    pressed: int,
    overlap_m: Floats,
    grid_x_m: Floats,
    grid_y_m: Floats,
) -> None:
    """Add the part of sample `s` that solid `k` presses, by its overlaps at the finer grid; some are zero.

    Zeros between others are summed, which is cheaper than branches; those before and after are left out.
    """
    first, end = 0, len(overlap_m)
    while overlap_m[first] <= 0.0:
        first += 1
    while overlap_m[end - 1] <= 0.0:
        end -= 1
    d_m, at_x_m, at_y_m = overlap_m[first:end], grid_x_m[first:end], grid_y_m[first:end]
    depth_m = square_m2 = x_m2 = y_m2 = 0.0
    for i in range(len(d_m)):
        d = d_m[i]
        depth_m += d
        square_m2 += d * d
        x_m2 += d * at_x_m[i]
        y_m2 += d * at_y_m[i]
    _add_point(points, s, k, area_m2, depth_m / pressed, square_m2 / pressed, x_m2 / depth_m, y_m2 / depth_m)


@compiled_inline
def _add_point(
    points: LoadedPoints,
    s: int,
    k: int,
    area_m2: float,
    depth_m: float,
    square_m2: float,
    x_m: float,
    y_m: float,
) -> None:
    """Add a part of sample `s`, against solid `k`, to the loaded points."""
    m = points.total[0]
    if m == len(points.sample):
        points.lost[0] += 1
        return
    points.sample[m], points.solid[m] = s, k
    points.area_m2[m], points.depth_m[m], points.square_m2[m] = area_m2, depth_m, square_m2
    points.x_m[m], points.y_m[m] = x_m, y_m
    points.total[0] = m + 1
