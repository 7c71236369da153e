"""Line search along a correction of Newton's method, for forces whose slope changes within a step.

The forces of the foam have a convex potential (friction aside), so that the work of the residual along a
correction only falls with the way along it. Where it has changed its sign, the correction went too far: the
way is bracketed and halved, or cut by the secant, in turn, until the work is small beside that at its start.
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt

__all__ = ["begin_search", "continue_search", "is_rounding"]

Floats = NDArray[np.float64]
_SMALL = 0.5
"""Work of the residual along a correction, as a fraction of that at its start, with which a search ends."""
_ROUNDING = 1e-20
"""Energy of a correction, as a fraction of the kinetic energy, that rounding alone explains."""
_WAY, _LOW, _LOW_J, _HIGH, _HIGH_J, _START_J, _TURN = range(7)
"""Entries of `line`: the way now, both ends of the bracket with their work [J], work at the start, turns."""


@compiled_without_nrt
def begin_search(line: Floats, step: Floats, correction: Floats, n: int, work_j: float) -> None:
    """Begin at the end of the whole correction, the first `n` of `correction`, kept in `step`.

    Args:
        line: (7,) state of the search.
        step: (v,) the correction that is searched along.
        correction: (v,) correction of the velocities.
        n: Number of velocities.
        work_j: Work of the residual along the correction at its start [J].
    """
    for i in range(n):
        step[i] = correction[i]
    line[_WAY], line[_LOW], line[_LOW_J], line[_START_J] = 1.0, 0.0, work_j, work_j
    line[_HIGH], line[_HIGH_J], line[_TURN] = np.inf, 0.0, 0.0


@compiled_without_nrt
def continue_search(line: Floats, step: Floats, velocity: Floats, residual: Floats, n: int) -> bool:
    """Continue with the residual at the present velocities; move these and return True until it ends."""
    work_j = 0.0
    for i in range(n):
        work_j += step[i] * residual[i]
    if abs(work_j) <= _SMALL * line[_START_J] or (work_j > 0.0 and line[_HIGH] == np.inf):
        return False
    if work_j > 0.0:
        line[_LOW], line[_LOW_J] = line[_WAY], work_j
    else:
        line[_HIGH], line[_HIGH_J] = line[_WAY], work_j
    low, high = line[_LOW], line[_HIGH]
    part = line[_LOW_J] / (line[_LOW_J] - line[_HIGH_J])
    if line[_TURN] % 2.0 == 1.0:
        part = 0.5
    way = low + part * (high - low)
    line[_TURN] += 1.0
    if not low < way < high:
        return False
    for i in range(n):
        velocity[i] += (way - line[_WAY]) * step[i]
    line[_WAY] = way
    return True


@compiled_without_nrt
def is_rounding(energy_j: float, inertia: Floats, velocity: Floats, n: int) -> bool:
    """Return True if a correction of `energy_j` [J] is nothing beside the kinetic energy of n velocities.

    So ends a step in which the foam lets go: of no impulse of its own any correction is a large part.
    """
    kinetic_j = 0.0
    for i in range(n):
        for j in range(n):
            kinetic_j += velocity[i] * inertia[max(i, j), min(i, j)] * velocity[j]
    return energy_j <= _ROUNDING * kinetic_j
