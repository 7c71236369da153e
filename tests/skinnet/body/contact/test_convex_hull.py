"""Convex hulls of meshes: the shapes are MuJoCo's, and rays agree with clipping by all planes."""

import math

import mujoco
import numpy as np
import pytest

from skinnet.body.contact.convex_hull import (
    build_convex_hulls,
    hull_entry,
    hull_vertices_m,
    is_apart_from_hull,
)
from skinnet.body.proximity.cone_hulls import hull_facets_m


def clipped(hulls, row: int, origin, direction) -> float:
    """Distance [m] of a ray to a hull by clipping it with all planes, all at once."""
    plane = hulls.plane[hulls.first[row] : hulls.first[row + 1]]
    facing, height_m = plane[:, :3] @ direction, plane[:, :3] @ origin - plane[:, 3]
    along = np.abs(facing) < 1e-12
    if (height_m[along] > 0).any():
        return math.inf
    entries = -height_m[facing < -1e-12] / facing[facing < -1e-12]
    exits = -height_m[facing > 1e-12] / facing[facing > 1e-12]
    return max(entries.max(), 0.0) if entries.max() <= exits.min() and exits.min() >= 0.0 else math.inf


def shapes() -> dict[str, np.ndarray]:
    random = np.random.default_rng(2)
    ball = random.normal(size=(1500, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    turn = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    return {
        "few": random.normal(size=(20, 3)),
        "ball": ball,
        "needle": ball * [1.0, 0.05, 0.05],
        "slab": ball * [1.0, 1.0, 0.01],
        "drum": np.concatenate([rim + np.array([7.0, 0.0, z]) for z in (0.5, -0.5)]),
        "grid": np.array(np.meshgrid(*[np.linspace(-1, 1, 5)] * 3)).reshape(3, -1).T,
        "single precision": (ball * [0.3, 0.2, 0.1]).astype(np.float32).astype(np.float64),
    }


def rays(points: np.ndarray, count: int, seed: int):
    """Origins around and inside the points, directions roughly inwards, and some along the axes."""
    random = np.random.default_rng(seed)
    reach = np.ptp(points, axis=0).max()
    for _ in range(count):
        origin = random.normal(size=3)
        origin *= reach * random.uniform(0.0, 1.5) / np.linalg.norm(origin)
        direction = random.normal(scale=0.4, size=3) - origin / reach
        if random.random() < 0.2:
            direction = np.eye(3)[random.integers(3)] * random.choice([-1, 1])
        yield points.mean(axis=0) + origin, direction / np.linalg.norm(direction)


@pytest.mark.parametrize("name", shapes())
def test_rays_agree_with_clipping_by_all_planes(name):
    """From a triangle of the table, or from where the last ray ended: the same entry."""
    points = shapes()[name]
    hulls = build_convex_hulls([shapes()["few"], points])
    near, hits, misses = -1, 0, 0
    for number, (origin, direction) in enumerate(rays(points, 1500, 1)):
        expected = clipped(hulls, 1, origin, direction)
        start = near if number % 2 else -1
        found_m, near = hull_entry(hulls, 1, *origin, *direction, start)
        assert found_m == (pytest.approx(expected, abs=1e-9) if expected < math.inf else math.inf)
        assert hulls.first[1] <= near < hulls.first[2]
        hits, misses = hits + (expected < math.inf), misses + (expected == math.inf)
    assert min(hits, misses) > 50


def test_what_is_apart_from_a_hull_is_not_in_reach_of_it():
    points = shapes()["needle"]
    hulls = build_convex_hulls([points])
    apart = 0
    for origin, direction in rays(points, 3000, 4):
        distance_m, _ = hull_entry(hulls, 0, *origin, *direction, -1)
        if is_apart_from_hull(hulls, 0, *origin, 0.1):
            apart += 1
            assert distance_m > 0.1
    assert apart > 1000


BALL_RADIUS_M = 0.0025
BALL = f'<body name="ball" mocap="true"><geom size="{BALL_RADIUS_M}"/></body>'


def bracket(bodies: str = "", mesh: str = "") -> mujoco.MjModel:
    """A U-shaped bracket that hangs on a joint, 60 mm wide, of 5 mm plates, its opening upwards."""
    outline = [(-30, 0), (30, 0), (30, 40), (25, 40), (25, 5), (-25, 5), (-25, 40), (-30, 40)]
    vertices = [(x, y, z) for y in (-20, 20) for x, z in outline]
    quads = [(k, (k + 1) % 8, 8 + (k + 1) % 8, 8 + k) for k in range(8)]
    caps = [(0, 1, 4, 5), (1, 2, 3, 4), (0, 5, 6, 7)]
    quads += caps + [tuple(8 + k for k in reversed(cap)) for cap in caps]
    faces = [t for q in quads for t in ((q[0], q[2], q[1]), (q[0], q[3], q[2]))]
    text = " ".join(f"{0.001 * v:g}" for vertex in vertices for v in vertex)
    corners = " ".join(str(k) for face in faces for k in face)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="u" vertex="{text}" face="{corners}" {mesh}/></asset>'
        '<worldbody><body><joint/><geom name="u" type="mesh" mesh="u"/></body>'
        f"{bodies}</worldbody></mujoco>"
    )


def test_the_hull_is_what_mujoco_collides():
    """A ball that comes down on a bracket from anywhere: MuJoCo touches it where the hull does."""
    mj = bracket(BALL)
    hulls = build_convex_hulls([hull_vertices_m(mj, 0)])
    data = mujoco.MjData(mj)
    random = np.random.default_rng(6)
    for _ in range(30):
        data.mocap_pos[0] = random.uniform([-0.04, -0.03, 0.04], [0.04, 0.03, 0.045])
        mujoco.mj_forward(mj, data)
        rotation, centre_m = data.geom_xmat[0].reshape(3, 3), data.geom_xpos[0]
        origin = rotation.T @ (data.mocap_pos[0] - centre_m)
        touches = any(contact.dist < 0.0 for contact in data.contact)
        down_m, _ = hull_entry(hulls, 0, *origin, *(rotation.T @ [0.0, 0.0, -1.0]), -1)
        if down_m < math.inf and abs(down_m - BALL_RADIUS_M) > 1e-5:
            assert touches == (down_m < BALL_RADIUS_M)
        if is_apart_from_hull(hulls, 0, *origin, BALL_RADIUS_M):
            assert not touches


def test_a_hull_of_few_vertices_is_mujocos():
    """`maxhullvert` makes MuJoCo collide a hull of fewer vertices than the mesh has."""
    assert len(hull_vertices_m(bracket(), 0)) == 8
    assert len(hull_vertices_m(bracket(mesh='maxhullvert="5"'), 0)) == 5


def test_points_in_a_plane_have_no_hull():
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    with pytest.raises(ValueError, match="1"):
        build_convex_hulls([shapes()["few"], flat])


def test_what_is_seen_is_the_hull_that_is_felt():
    """Proximity and contact share the triangles of the hull that MuJoCo collides."""
    mj = bracket(mesh='maxhullvert="5"')
    felt = {tuple(vertex) for vertex in hull_vertices_m(mj, 0)}
    facets_m = hull_facets_m(mj, 0)
    corners_m = np.concatenate([facets_m[:, :3], *(facets_m[:, :3] + facets_m[:, k : k + 3] for k in (3, 6))])
    seen = {tuple(corner) for corner in facets_m[:, :3]}
    assert seen <= felt
    np.testing.assert_allclose(np.unique(corners_m.round(9), axis=0), sorted(felt), atol=1e-8)
