"""Rays of a cell, cast all at once, against the single rays of the contact scene, which MuJoCo's hold."""

from pathlib import Path

import body_scenes
import mujoco
import numpy as np
import pytest

from skinnet.body.contact.contact_scene import ray_distance_m
from skinnet.body.contact.parallel_rays import cast_rays, cell_in_solid, lowest_height_m
from skinnet.body.contact.point_kinematics import cell_axis, point_above_cell
from skinnet.body.simulation import BodySimulation

KINDS = ("sphere", "box", "capsule", "cylinder", "ellipsoid", "mesh", "plane")
START_M = 0.004


def scene(folder: Path) -> BodySimulation:
    """An arm with cells, and floating solids of all kinds."""
    spec = mujoco.MjSpec.from_string(body_scenes.ARM.format(more="", sensors=""))
    turn = np.arange(9) * 2.0 * np.pi / 9.0
    rim = np.column_stack([0.02 * np.cos(turn), 0.02 * np.sin(turn), 0.0 * turn])
    spec.add_mesh(name="cone", uservert=[*rim.ravel(), 0.01, 0.005, 0.06])  # its box is not about its centre
    for kind in KINDS:
        body = spec.worldbody.add_body(name=kind, mocap=True)
        shape = getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")
        body.add_geom(
            name=kind, type=shape, size=[0.03, 0.02, 0.015], meshname="cone" if kind == "mesh" else ""
        )
    spec.compile()
    skin = (body_scenes.patch("skin", "arm", *body_scenes.ARM_CELLS),)
    return body_scenes.body_of(folder, spec.to_xml(), skin, ("turn", "lift"))


@pytest.mark.parametrize("kind", KINDS)
def test_rays_of_a_cell_are_single_rays(tmp_path: Path, kind: str) -> None:
    """Outside, inside and beside solids in any pose; where a ray begins, and none below the lowest height."""
    body = scene(tmp_path)
    data, given, surface = body.data, body.cell_foundation.scene, body.surface
    motion, mj = body.cell_foundation.motion, body.model.mj
    k = int(np.flatnonzero(given.geom_id == mj.geom(kind).id)[0])
    mocap, random = int(mj.body(kind).mocapid[0]), np.random.default_rng(3)
    data.qpos[:2] = (0.4, -0.3)
    mujoco.mj_kinematics(mj, data)
    seen = {"inside": 0, "missed": 0, "met": 0}
    for number in range(20):
        i = number % 3
        origin_m, normal = (
            np.array(point_above_cell(surface, motion, i, -START_M)),
            cell_axis(surface, motion, i, 2),
        )
        x_axis, y_axis = (
            np.array(cell_axis(surface, motion, i, 0)),
            np.array(cell_axis(surface, motion, i, 1)),
        )
        data.mocap_pos[mocap] = origin_m + random.uniform(-0.03, 0.03, 3) + 0.01 * np.array(normal)
        data.mocap_quat[mocap] = random.normal(size=4)
        if number < 4:  # its axes along those of the cell
            data.mocap_quat[mocap] = data.xquat[mj.body("arm").id]
        mujoco.mj_kinematics(mj, data)
        stretch = float(random.choice([1.0, 1.3]))
        x_m, y_m = random.uniform(-0.02, 0.02, (2, 12))
        height_m = np.full(12, -1.0)
        f = cell_in_solid(surface, given, motion, i, k, START_M, stretch)
        cast_rays(given, k, f, x_m, y_m, 2, 11, height_m)
        assert height_m[[0, 1, 11]].tolist() == [-1.0] * 3, "not asked for"
        for place in range(2, 11):
            start_m = origin_m + stretch * x_m[place] * x_axis + y_m[place] * y_axis
            expected_m = ray_distance_m(given, motion, k, *start_m, *normal)
            assert height_m[place] == pytest.approx(expected_m, rel=1e-9, abs=1e-12)
            seen["inside" if expected_m == 0.0 else "missed" if np.isinf(expected_m) else "met"] += 1
        assert (height_m[2:11] >= lowest_height_m(given, k, f) - 1e-12).all()
    assert min(seen.values()) > 5


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plane"])
def test_the_lowest_height_is_reached(tmp_path: Path, kind: str) -> None:
    """The first of many rays to meet a solid does so at its lowest height (that of a mesh is its box)."""
    body = scene(tmp_path)
    data, given, surface = body.data, body.cell_foundation.scene, body.surface
    motion, mj = body.cell_foundation.motion, body.model.mj
    k = int(np.flatnonzero(given.geom_id == mj.geom(kind).id)[0])
    mocap, random = int(mj.body(kind).mocapid[0]), np.random.default_rng(5)
    x_m, y_m = (each.ravel() for each in np.meshgrid(*[np.linspace(-0.05, 0.05, 41)] * 2))
    for _ in range(3 if kind != "mesh" else 8):
        data.mocap_quat[mocap] = random.normal(size=4)
        mujoco.mj_kinematics(mj, data)
        place_m = point_above_cell(surface, motion, 0, 0.1)
        data.mocap_pos[mocap] = place_m
        mujoco.mj_kinematics(mj, data)
        f, height_m = cell_in_solid(surface, given, motion, 0, k, START_M, 1.0), np.zeros(len(x_m))
        cast_rays(given, k, f, x_m, y_m, 0, len(x_m), height_m)
        lowest_m = lowest_height_m(given, k, f)
        assert lowest_m <= height_m.min() + 1e-12
        assert lowest_m == pytest.approx(height_m.min(), abs=0.04 if kind == "mesh" else 3e-3)
