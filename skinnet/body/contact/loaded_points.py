"""Loaded points of a foundation: where foam is compressed now, or will be within the step."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["LoadedPoints", "no_loaded_points"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class LoadedPoints(NamedTuple):
    """Loaded points of a foundation, m of them, in the order of its cells; arrays hold all that could be.

    Points that follow each other, of one cell and against one body, are a run: what depends on the motion of
    both is computed once per run.

    Attributes:
        total: (1,) m.
        lost: (1,) number of points for which there was no space.
        n_runs: (1,) number of runs.
        run_first: First point of each run; it ends where the next begins.
        run_cell: Row of the cell of each run.
        run_body: Body that each run's points press.
        run_is_whole: True for runs of one point in each sample of a cell, in their order.
        sample: Number of the sample in its cell.
        solid: Number of the solid in the contact scene.
        area_m2: Area of the part of the sample that the point stands for [m²].
        x_m: Centre of pressure of this part, plane of the cell [m].
        y_m: As x_m [m].
        depth_m: Mean overlap of foam and solid; negative before contact [m].
        square_m2: Mean square of the overlap [m²].
        height_m: Height above the rigid surface at which forces act [m].
    """

    total: Indices
    lost: Indices
    n_runs: Indices
    run_first: Indices
    run_cell: Indices
    run_body: Indices
    run_is_whole: NDArray[np.bool_]
    sample: Indices
    solid: Indices
    area_m2: Floats
    x_m: Floats
    y_m: Floats
    depth_m: Floats
    square_m2: Floats
    height_m: Floats


def no_loaded_points(capacity: int) -> LoadedPoints:
    """Return an empty list of points for at most `capacity` points."""
    return LoadedPoints(
        total=np.zeros(1, dtype=np.int64),
        lost=np.zeros(1, dtype=np.int64),
        n_runs=np.zeros(1, dtype=np.int64),
        run_first=np.zeros(capacity + 1, dtype=np.int64),
        run_cell=np.zeros(capacity, dtype=np.int64),
        run_body=np.zeros(capacity, dtype=np.int64),
        run_is_whole=np.zeros(capacity, dtype=np.bool_),
        sample=np.zeros(capacity, dtype=np.int64),
        solid=np.zeros(capacity, dtype=np.int64),
        area_m2=np.zeros(capacity),
        x_m=np.zeros(capacity),
        y_m=np.zeros(capacity),
        depth_m=np.zeros(capacity),
        square_m2=np.zeros(capacity),
        height_m=np.zeros(capacity),
    )
