"""Line search of the implicit step, on convex potentials whose slope jumps."""

import numpy as np
import pytest
from numpy.typing import NDArray

from skinnet.body.contact.line_search import begin_search, continue_search, is_rounding

Floats = NDArray[np.float64]


def residual_of(velocity: Floats, steep: float) -> Floats:
    """Negative gradient of a convex potential: soft up to 0.3 along the first velocity, `steep` beyond."""
    return np.array([1.0 - velocity[0] - steep * max(0.0, velocity[0] - 0.3), 0.5 - velocity[1]])


def search(steep: float, correction: Floats, n_most: int = 50) -> tuple[Floats, list[float]]:
    """Velocities where the search ends, and the work of the residual along the correction at each place."""
    line, step, velocity = np.zeros(7), np.zeros(2), np.zeros(2)
    start = residual_of(velocity, steep)
    begin_search(line, step, correction, 2, float(correction @ start))
    velocity += correction
    work_j = [float(correction @ start)]
    for _ in range(n_most):
        residual = residual_of(velocity, steep)
        work_j.append(float(correction @ residual))
        if not continue_search(line, step, velocity, residual, 2):
            return velocity, work_j
    raise AssertionError("the search does not end")


@pytest.mark.parametrize("steep", [5.0, 50.0, 1e4])
def test_a_correction_that_goes_too_far_is_cut(steep: float) -> None:
    """Until half of the work is left; always along the correction; never back beyond its start."""
    correction = np.array([1.0, 0.5])
    velocity, work_j = search(steep, correction)
    assert abs(work_j[1]) > 0.5 * work_j[0], "else nothing is to be cut"
    assert abs(work_j[-1]) <= 0.5 * work_j[0]
    assert len(work_j) <= 30
    way = velocity / correction
    assert way[0] == pytest.approx(way[1])
    assert 0.0 < way[0] < 1.0
    positive, negative = [w for w in work_j if w > 0.0], [w for w in work_j if w <= 0.0]
    assert positive == sorted(positive, reverse=True), "each end of the bracket only comes nearer"
    assert negative == sorted(negative)


def test_a_correction_that_helps_stays() -> None:
    correction = np.array([0.29, 0.3])
    velocity, work_j = search(1e4, correction)
    assert velocity == pytest.approx(correction)
    assert len(work_j) == 2


def test_a_correction_that_falls_short_stays() -> None:
    """Work is left, and nothing says where it ends: Newton's next correction does better."""
    correction = np.array([0.05, 0.05])
    velocity, _ = search(0.0, correction)
    assert velocity == pytest.approx(correction)


def test_the_secant_and_halves_take_turns() -> None:
    """The first cut is where a straight line through both works is zero, the second the middle."""
    line, step = np.zeros(7), np.zeros(1)
    velocity = np.ones(1)
    begin_search(line, step, np.ones(1), 1, 1.0)
    assert continue_search(line, step, velocity, np.array([-3.0]), 1)
    assert velocity[0] == pytest.approx(0.25)
    assert continue_search(line, step, velocity, np.array([-2.0]), 1)
    assert velocity[0] == pytest.approx(0.125)
    assert continue_search(line, step, velocity, np.array([0.6]), 1)
    assert velocity[0] == pytest.approx(0.125 + 0.125 * 0.6 / 2.6)
    assert not continue_search(line, step, velocity, np.array([-0.5]), 1)


def test_what_is_small_beside_the_kinetic_energy_is_rounding() -> None:
    """Of the lower triangle of an inertia matrix, all of it."""
    inertia, velocity = np.array([[2.0, 99.0], [0.5, 1.0]]), np.array([1.0, 2.0])
    kinetic_j = 2.0 + 2.0 * 0.5 * 2.0 + 4.0
    assert is_rounding(0.99e-20 * kinetic_j, inertia, velocity, 2)
    assert not is_rounding(1.01e-20 * kinetic_j, inertia, velocity, 2)
    assert is_rounding(0.0, inertia, np.zeros(2), 2)
