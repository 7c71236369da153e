"""Plates of hexagons: whether they overlap, against sampled points."""

import math

import numpy as np
import pytest
from link_models import SIDE_M

from skinnet.covering.hexagons import hexagon_grid, in_hexagon, piercing_m

APOTHEM_M = SIDE_M * math.sqrt(3.0) / 2.0
PLATE_M = 0.002


def turned(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    if axis == "z":
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def test_neighbours_in_a_plane_touch_and_overlap_by_what_they_are_too_near() -> None:
    R = np.eye(3)
    assert piercing_m(R, R, 2 * APOTHEM_M, 0.0, 0.0, SIDE_M, PLATE_M) <= 1e-12
    assert piercing_m(R, R, 2 * APOTHEM_M - 0.0015, 0.0, 0.0, SIDE_M, PLATE_M) == pytest.approx(0.0015)
    assert piercing_m(R, R, 0.0, 0.0, 0.0015, SIDE_M, PLATE_M) == pytest.approx(0.0005)
    assert piercing_m(R, R, 0.0, 2 * SIDE_M + 1e-6, 0.0, SIDE_M, PLATE_M) == 0.0


def test_overlap_is_found_exactly_where_plates_share_points() -> None:
    rng = np.random.default_rng(3)
    points, _ = hexagon_grid(12)
    layers = np.concatenate(
        [np.column_stack([SIDE_M * points, np.full(len(points), z)]) for z in np.linspace(0.0, PLATE_M, 7)]
    )
    seen = set()
    for _ in range(400):
        R_a, R_b = (turned("z", rng.uniform(0, 6)) @ turned("x", rng.uniform(-1, 1)) for _ in range(2))
        off_m = rng.normal(size=3) * 0.012
        overlap_m = piercing_m(R_a, R_b, *off_m, SIDE_M, PLATE_M)
        local = (layers @ R_b.T + off_m) @ R_a
        shared = any(
            in_hexagon(x, y, SIDE_M) and 0.0 <= z <= PLATE_M
            for x, y, z in local[::1].tolist()
            if abs(z) < 0.01
        )
        if shared:
            assert overlap_m > 0.0
        if overlap_m > 0.002:
            assert shared
        seen.add((shared, overlap_m > 0.0))
    assert {(True, True), (False, False)} <= seen


def test_points_of_a_hexagon_have_its_area_and_lie_in_it() -> None:
    points, weights = hexagon_grid(3)
    assert len(points) == 37
    assert weights.sum() == pytest.approx(1.0)
    assert all(in_hexagon(x, y, 1.0 + 1e-9) for x, y in points)
    assert (weights * points[:, 0] ** 2).sum() == pytest.approx(5.0 / 24.0, rel=0.15)  # second moment of area
