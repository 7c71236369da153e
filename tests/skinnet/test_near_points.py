"""Pairs of near points are those of SciPy's tree."""

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial import cKDTree

from skinnet.near_points import near_pairs, near_pairs_between

points = st.integers(0, 30).flatmap(
    lambda n: arrays(np.float64, (n, 3), elements=st.floats(-1.0, 1.0, width=32))
)


def away_from(reach_m: float, *sets: Any) -> bool:
    """No two points are at this distance up to rounding, where both answers are right."""
    every = np.concatenate(sets)
    apart_m = np.linalg.norm(every[:, None] - every[None], axis=2)
    return bool((np.abs(apart_m - reach_m) > 1e-9).all())


@given(one=points, other=points, reach_m=st.floats(1e-3, 2.0))
def test_pairs_are_those_of_a_tree(one: Any, other: Any, reach_m: float) -> None:
    if not away_from(reach_m, one, other):
        return
    assert near_pairs(one, reach_m) == sorted(cKDTree(one).query_pairs(reach_m))
    found = cKDTree(one).query_ball_tree(cKDTree(other), reach_m) if len(one) and len(other) else []
    assert near_pairs_between(one, other, reach_m) == [
        (a, b) for a, near in enumerate(found) for b in sorted(near)
    ]


def test_points_at_the_reach_are_near() -> None:
    line = np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.75, 0.0]])
    assert near_pairs(line, 0.3) == [(0, 1)]
    assert near_pairs(line, 0.45) == [(0, 1), (1, 2)]
    assert near_pairs(line[[0, 0]], 1e-3) == [(0, 1)]
