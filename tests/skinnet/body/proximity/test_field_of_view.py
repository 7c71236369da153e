"""Proximity in a cone: against rays of MuJoCo, a convex solver, closed forms, and specks."""

import math
from typing import Any

import body_scenes
import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize

from skinnet.body.proximity.cone_hulls import hull_facets_m
from skinnet.body.proximity.field_of_view import FieldOfView, distance_in_view_m
from skinnet.errors import ModelError
from skinnet.protocol.messages import STIMULUS_NAMES

DISTANCE = STIMULUS_NAMES.index("distance_m")
RANGE_M = 0.075
APEX_M = np.array([0.0, 0.0, 0.022])
"""Face of the only cell, which looks up."""
HULL_M = np.random.default_rng(0).normal(size=(40, 3)) * [0.03, 0.02, 0.015]
SOLIDS = {
    "sphere": 'type="sphere" size="0.02"',
    "capsule": 'type="capsule" size="0.012 0.04"',
    "wire": 'type="capsule" size="0.001 0.2"',
    "box": 'type="box" size="0.03 0.015 0.01"',
    "plate": 'type="box" size="0.2 0.1 0.002"',
    "cylinder": 'type="cylinder" size="0.02 0.03"',
    "rod": 'type="cylinder" size="0.003 0.2"',
    "disc": 'type="cylinder" size="0.05 0.001"',
    "ellipsoid": 'type="ellipsoid" size="0.03 0.02 0.01"',
    "mesh": 'type="mesh" mesh="hull"',
}


class Watched:
    """A cell and one solid before it, which can be put anywhere."""

    def __init__(self, folder: Any, geom: str, mesh_m: np.ndarray = HULL_M) -> None:
        points = " ".join(map(repr, mesh_m.ravel().tolist()))
        asset = f'<asset><mesh name="hull" vertex="{points}"/></asset>'
        mjcf = f"""<mujoco>{asset}<worldbody>
          <body name="base"><joint name="turn" axis="0 0 1"/>
            <geom type="box" size="0.02 0.02 0.01" mass="1"/></body>
          <body name="solid" pos="0 0 1"><freejoint/><geom name="solid" {geom} mass="1"/></body>
        </worldbody></mujoco>"""
        patches = (body_scenes.lattice_patch("skin", "base", 1, 1, (0.0, 0.0, 0.01)),)
        self.body = body_scenes.body_of(folder, mjcf, patches, ("turn",))
        self.mj, self.data = self.body.model.mj, self.body.data
        self.foundation = self.body.cell_foundation
        scene = self.foundation.scene
        self.geom = self.mj.geom("solid").id
        self.near = np.flatnonzero(scene.geom_id == self.geom)
        self.qpos = int(self.mj.jnt_qposadr[self.mj.body("solid").jntadr[0]])

    def view(self, half_angle_rad: float) -> FieldOfView:
        return FieldOfView.build(self.mj, self.foundation.scene, RANGE_M, half_angle_rad)

    def place(self, at_m: Any, quaternion: Any = (1.0, 0.0, 0.0, 0.0)) -> None:
        """Put the solid at `at_m`, seen from the face of the cell."""
        self.data.qpos[self.qpos :][:3] = APEX_M + at_m
        self.data.qpos[self.qpos + 3 :][:4] = quaternion / np.linalg.norm(quaternion)
        mujoco.mj_kinematics(self.mj, self.data)

    def place_at_random(self, random: np.random.Generator) -> None:
        self.place([*random.uniform(-0.1, 0.1, 2), random.uniform(-0.02, 0.1)], random.normal(size=4))

    def distance_m(self, view: FieldOfView) -> float:
        surface, scene, motion = self.foundation.surface, self.foundation.scene, self.foundation.motion
        return distance_in_view_m(view, surface, scene, motion, 0, 0.012, self.near, len(self.near))

    def shortest_ray_m(self, directions: np.ndarray) -> float:
        """The shortest of MuJoCo's rays from the face of the cell."""
        ids, distance = np.zeros(len(directions), dtype=np.int32), np.zeros(len(directions))
        base = self.mj.body("base").id
        mujoco.mj_multiRay(
            m=self.mj, d=self.data, pnt=APEX_M, vec=directions.ravel(), geomgroup=None, flg_static=1,
            bodyexclude=base, geomid=ids, dist=distance, normal=None, nray=len(directions),
            cutoff=mujoco.mjMAXVAL,
        )  # fmt: skip
        met = distance[(ids == self.geom) & (distance >= 0.0) & (distance <= RANGE_M)]
        return float(met.min(initial=math.inf))


def fan(half_angle_rad: float) -> np.ndarray:
    """Directions of a cone, close together, and closer still at its rim."""
    rings, places = np.meshgrid(
        np.linspace(0.0, 1.0, 60), np.linspace(0.0, 2.0 * math.pi, 200), indexing="ij"
    )
    cosine = 1.0 - (1.0 - math.cos(half_angle_rad)) * rings.ravel()
    rim = np.linspace(0.0, 2.0 * math.pi, 10_000)
    cosine = np.concatenate([cosine, np.full(len(rim), math.cos(half_angle_rad))])
    place = np.concatenate([places.ravel(), rim])
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return np.column_stack([sine * np.cos(place), sine * np.sin(place), cosine])


@pytest.mark.parametrize("kind", SOLIDS)
def test_no_ray_in_the_cone_meets_a_solid_before_its_distance(tmp_path: Any, kind: str) -> None:
    watched, random, seen, hidden = Watched(tmp_path, SOLIDS[kind]), np.random.default_rng(1), 0, 0
    for half_angle_deg in (5, 20, 35, 60, 80):
        half_angle_rad = math.radians(half_angle_deg)
        view, directions = watched.view(half_angle_rad), fan(half_angle_rad)
        for _ in range(30):
            watched.place_at_random(random)
            distance_m, ray_m = watched.distance_m(view), watched.shortest_ray_m(directions)
            assert distance_m <= ray_m + 1e-8
            seen += math.isfinite(ray_m)
            hidden += math.isinf(ray_m)
    assert min(seen, hidden) > 15


def inside(watched: Watched, kind: str) -> list[Any]:
    """Functions that are positive inside the solid, of points in its frame [m]."""
    a, b, c = watched.mj.geom_size[watched.geom]
    if kind == "mesh":
        facets = hull_facets_m(watched.mj, 0)
        normals = np.cross(facets[:, 3:6], facets[:, 6:9])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        offsets = np.einsum("ij,ij->i", normals, facets[:, :3])
        return [lambda p: 1e2 * (offsets - normals @ p)]
    if kind in ("box", "plate"):
        return [lambda p: 1e2 * (np.array([a, b, c]) - np.abs(p))]
    if kind == "ellipsoid":
        return [lambda p: 1.0 - float(((p / (a, b, c)) ** 2).sum())]
    if kind in ("cylinder", "rod", "disc"):
        return [lambda p: 1.0 - (p[0] ** 2 + p[1] ** 2) / a**2, lambda p: 1e2 * (b - abs(p[2]))]
    half = 0.0 if kind == "sphere" else b
    return [lambda p: 1.0 - (p[0] ** 2 + p[1] ** 2 + max(abs(p[2]) - half, 0.0) ** 2) / a**2]


@pytest.mark.parametrize("kind", ["sphere", "capsule", "box", "cylinder", "ellipsoid", "mesh"])
def test_the_distance_is_that_of_a_convex_solver(tmp_path: Any, kind: str) -> None:
    """The shortest vector that is in the solid and in the cone (sequential quadratic programming)."""
    watched, random, solved = Watched(tmp_path, SOLIDS[kind]), np.random.default_rng(2), 0
    contains = inside(watched, kind)
    for number in range(60):
        slope = math.tan(math.radians((20, 35, 60)[number % 3]))
        view = watched.view(math.atan(slope))
        watched.place_at_random(random)
        distance_m = watched.distance_m(view)
        if not 0.0 < distance_m < math.inf:
            continue
        origin_m = watched.data.geom_xpos[watched.geom] - APEX_M
        R_solid_cell = watched.data.geom_xmat[watched.geom].reshape(3, 3).T
        conditions = [
            {"type": "ineq", "fun": lambda p, f=f, R=R_solid_cell, o=origin_m: f(R @ (0.01 * p - o))}
            for f in contains
        ]
        conditions.append({"type": "ineq", "fun": lambda p, s=slope: s * p[2] - math.hypot(p[0], p[1])})
        found_m = [
            0.01 * float(np.linalg.norm(result.x))
            for share in (0.5, 0.8, 1.0)
            for result in [
                minimize(
                    lambda p: p @ p,
                    100.0 * share * origin_m + (0.0, 0.0, 1.0),
                    constraints=conditions,
                    method="SLSQP",
                    options={"maxiter": 200, "ftol": 1e-13},
                )
            ]
            if result.success and all(np.min(each["fun"](result.x)) > -1e-6 for each in conditions)
        ]
        if found_m:
            solved += 1
            assert distance_m == pytest.approx(min(found_m), abs=2e-6)
    assert solved >= 8


def test_a_speck_is_seen_everywhere_in_the_cone_and_nowhere_else(tmp_path: Any) -> None:
    """A ball of 0.1 mm, exactly up to its edge: no gap through which it could come."""
    watched, random, radius_m = (
        Watched(tmp_path, 'type="sphere" size="0.0001"'),
        np.random.default_rng(3),
        1e-4,
    )
    half_angle_rad = math.radians(35.0)
    view, seen = watched.view(half_angle_rad), 0
    for _ in range(2000):
        at_m = random.uniform((-0.06, -0.06, 0.001), (0.06, 0.06, 0.08))
        away_m, angle_rad = float(np.linalg.norm(at_m)), math.atan2(math.hypot(*at_m[:2]), at_m[2])
        margin_m = away_m * math.sin(half_angle_rad - angle_rad)
        watched.place(at_m)
        distance_m = watched.distance_m(view)
        if away_m - radius_m > RANGE_M or margin_m < -radius_m:
            assert math.isinf(distance_m)
        elif margin_m >= 0.0:
            assert distance_m == pytest.approx(away_m - radius_m, abs=1e-12)
            seen += 1
    assert seen > 200


@pytest.mark.parametrize("kind", ["capsule", "box", "cylinder", "ellipsoid", "mesh"])
def test_the_edge_of_view_is_that_of_the_solid(tmp_path: Any, kind: str) -> None:
    """A solid that moves in from the side appears where its support reaches the cone, within a micrometre."""
    watched, random = Watched(tmp_path, SOLIDS[kind]), np.random.default_rng(4)
    half_angle_rad = math.radians(35.0)
    view, directions = watched.view(half_angle_rad), fan(half_angle_rad)
    for _ in range(5):
        quaternion, height_m = random.normal(size=4), random.uniform(0.04, 0.06)
        outside_m, inside_m = 0.3, 0.0
        while outside_m - inside_m > 1e-6:
            middle_m = 0.5 * (outside_m + inside_m)
            watched.place((middle_m, 0.0, height_m), quaternion)
            if math.isfinite(watched.distance_m(view)):
                inside_m = middle_m
            else:
                outside_m = middle_m
        watched.place((outside_m, 0.0, height_m), quaternion)
        assert math.isinf(watched.shortest_ray_m(directions))
        watched.place((outside_m - 1e-3, 0.0, height_m), quaternion)
        assert math.isfinite(watched.shortest_ray_m(directions)), "1 mm further in, rays meet it"


def test_a_ball_beside_the_axis_is_seen_by_default(tmp_path: Any) -> None:
    ball = '<body name="ball" pos="{} 0 {}"><geom type="sphere" size="0.005"/></body>'
    at = 0.30 + 0.031, 1.05 + 0.01 + 0.012 + 0.047
    seen = body_scenes.arm(tmp_path, more=ball.format(*at)).stimulus()[0, DISTANCE]
    assert seen == pytest.approx(math.hypot(0.031, 0.047) - 0.005, abs=1e-9)
    unseen = body_scenes.arm(tmp_path, more=ball.format(at[0] + 0.02, at[1])).stimulus()[0, DISTANCE]
    assert math.isinf(unseen)


@pytest.mark.parametrize("tilt_deg", [0.0, 20.0, 50.0, 100.0, 130.0])
def test_a_plane_is_seen_where_the_cone_leads_to_it_first(tmp_path: Any, tilt_deg: float) -> None:
    tilt_rad, half_angle_rad, away_m = math.radians(tilt_deg), math.radians(35.0), 0.03
    normal = np.array([math.sin(tilt_rad), 0.0, -math.cos(tilt_rad)])
    point_m = (APEX_M - away_m * normal).tolist()
    plane = '<geom name="solid" type="plane" size="1 1 1" pos="{} {} {}" zaxis="{} {} {}"/>'
    mjcf = f"""<mujoco><worldbody>{plane.format(*point_m, *normal)}
      <body name="base"><joint name="turn" axis="0 0 1"/>
        <geom type="box" size="0.002 0.002 0.01" mass="1"/></body></worldbody></mujoco>"""
    patches = (body_scenes.lattice_patch("skin", "base", 1, 1, (0.0, 0.0, 0.01)),)
    distance_m = body_scenes.body_of(tmp_path, mjcf, patches, ("turn",)).stimulus()[0, DISTANCE]
    off_rad = max(tilt_rad - half_angle_rad, 0.0)
    due_m = away_m / math.cos(off_rad) if off_rad < 0.5 * math.pi else math.inf
    assert distance_m == pytest.approx(due_m if due_m <= RANGE_M else math.inf, abs=1e-9)


def test_the_inside_of_every_solid_is_at_distance_zero(tmp_path: Any) -> None:
    for geom in SOLIDS.values():
        watched = Watched(tmp_path, geom)
        watched.place((0.0, 0.0, 0.0), (0.5, 0.1, 0.7, 0.2))
        assert watched.distance_m(watched.view(math.radians(35.0))) == 0.0


def test_a_flat_mesh_is_refused(tmp_path: Any) -> None:
    watched = Watched(tmp_path, SOLIDS["mesh"])
    flat = watched.mj
    flat.mesh_vert[:, 2] = 0.0
    with pytest.raises(ModelError, match="flat and has no convex hull"):
        watched.view(0.5)
