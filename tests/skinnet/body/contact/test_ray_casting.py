"""Rays against solids: compared with MuJoCo's own ray functions."""

import math

import mujoco
import numpy as np
import pytest

from skinnet.body.contact import ray_casting as geometry

NAMES = ("PLANE", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
SIZE = np.array([0.3, 0.2, 0.45])
SOLIDS = (geometry.SPHERE, geometry.CAPSULE, geometry.ELLIPSOID, geometry.CYLINDER, geometry.BOX)


def entry(kind: int, origin, direction) -> float:
    return geometry.entry_distance_m(kind, *SIZE, *map(float, origin), *map(float, direction))


def rays(seed: int, count: int, reach: float):
    """Rays from a shell of `reach` around the origin that point roughly inwards."""
    random = np.random.default_rng(seed)
    origins = random.normal(size=(count, 3))
    origins *= reach / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = random.normal(scale=0.3, size=(count, 3)) - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_shapes_carry_mujocos_numbers():
    for name in NAMES:
        assert getattr(geometry, name) == getattr(mujoco.mjtGeom, f"mjGEOM_{name}").value


@pytest.mark.parametrize("kind", SOLIDS)
def test_entry_from_outside_equals_mujocos_ray(kind):
    hits = 0
    for origin, direction in zip(*rays(kind, 2000, 1.5), strict=True):
        theirs = mujoco.mju_rayGeom(np.zeros(3), np.eye(3).ravel(), SIZE, origin, direction, kind, None)
        ours = entry(kind, origin, direction)
        hits += theirs >= 0
        assert ours == (pytest.approx(theirs, abs=1e-12) if theirs >= 0 else math.inf)
    assert 200 < hits < 2000


@pytest.mark.parametrize("kind", SOLIDS)
def test_inside_is_distance_zero_and_behind_is_never(kind):
    random = np.random.default_rng(1)
    for _ in range(200):
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        inside = random.uniform(-0.1, 0.1, size=3)
        assert entry(kind, inside, direction) == 0.0
        assert entry(kind, inside + 3.0 * direction, direction) == math.inf


@pytest.mark.parametrize("kind", SOLIDS)
def test_the_entry_point_moves_with_the_origin(kind):
    for origin, direction in zip(*rays(7, 200, 1.5), strict=True):
        first = entry(kind, origin, direction)
        if first < math.inf:
            assert entry(kind, origin + 0.1 * direction, direction) == pytest.approx(first - 0.1, abs=1e-12)


@pytest.mark.parametrize("kind", SOLIDS)
def test_rays_along_the_axes(kind):
    """No division by zero where a ray is parallel to faces or to the axis of a cylinder."""
    top_m = {geometry.SPHERE: 0.3, geometry.CAPSULE: 0.5, geometry.CYLINDER: 0.2}.get(kind, 0.45)
    assert entry(kind, (0, 0, 2), (0, 0, -1)) == pytest.approx(2 - top_m)
    assert entry(kind, (0.299999, 1, 0), (0, -1, 0)) < 1.0
    assert entry(kind, (0.300001, 1, 0), (0, -1, 0)) == math.inf


def test_plane_is_a_half_space():
    assert entry(geometry.PLANE, (5, 5, 1), (0, 0.6, -0.8)) == pytest.approx(1.25)
    assert entry(geometry.PLANE, (0, 0, 1), (0, 1, 0)) == math.inf
    assert entry(geometry.PLANE, (0, 0, -1), (0, 0, 1)) == 0.0
