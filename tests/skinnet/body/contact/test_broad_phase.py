"""The broad phase leaves out nothing that touches, and costs nothing where nothing is near."""

import time
from pathlib import Path

import body_scenes
import mujoco
import numpy as np
import pytest

from skinnet.body.contact.broad_phase import ActiveCells, collect_active_cells, keep_active
from skinnet.body.contact.cell_tree import build_cell_tree
from skinnet.body.contact.skin_foundation import Foundation

SCENE = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 1" pos="0 0 -0.3"/>
    <body name="base">
      <joint name="turn" axis="0 0 1"/><joint name="tilt" axis="1 0 0"/>
      <geom type="box" size="0.4 0.4 0.02" pos="0 0 -0.02" mass="50"/>
    </body>
    <body name="link">
      <joint name="swing" axis="0 1 0"/>
      <geom type="box" size="0.1 0.1 0.02" pos="0 0 -0.8"/>
    </body>
    {loads}
  </worldbody>
</mujoco>
"""
KINDS = ("sphere", "box", "capsule", "cylinder", "ellipsoid")


def scene(folder: Path):
    """A large and a small patch on two bodies, and bodies of all kinds that float."""
    loads = "".join(
        f'<body name="{kind}"><freejoint/><geom type="{kind}" size="0.05 0.03 0.02" mass="1"/></body>'
        for kind in KINDS
    )
    skin = (
        body_scenes.lattice_patch("plate", "base", 20, 20),
        body_scenes.lattice_patch("link", "link", 3, 3, (0.0, 0.0, -0.78)),
    )
    return body_scenes.body_of(folder, SCENE.format(loads=loads), skin, ("turn",))


def copy_of(foundation: Foundation) -> Foundation:
    """A second foundation of the same skin and motion, with a wrench of its own."""
    return Foundation(
        foundation.surface,
        foundation.scene,
        foundation.foam,
        foundation.motion,
        foundation.temperature_c,
        np.zeros_like(foundation.applied_wrench),
    )


def test_forces_are_those_of_all_cells_looked_at(tmp_path):
    """Bodies jump about at random; a foundation in which every cell is always active feels the same."""
    body = scene(tmp_path)
    few, every = copy_of(body.cell_foundation), copy_of(body.cell_foundation)
    random, loaded = np.random.default_rng(0), 0
    for _ in range(150):
        body.data.qpos[:3] = random.uniform(-0.4, 0.4, size=3)
        for kind in range(len(KINDS)):
            place = body.data.qpos[3 + 7 * kind :][:7]
            place[:3] = random.uniform([-0.3, -0.3, -0.1], [0.3, 0.3, 0.15])
            place[3:] = random.normal(size=4)
        mujoco.mj_fwdPosition(body.model.mj, body.data)
        mujoco.mj_fwdVelocity(body.model.mj, body.data)
        for p in range(2):
            for row in range(*every.surface.patch_start[p : p + 2]):
                keep_active(every.problem.workspace.active, p, row)
        for foundation in (few, every):
            foundation.applied_wrench[:] = 0.0
            foundation.compute_contact(0.001)
        np.testing.assert_array_equal(few.contact.force_n, every.contact.force_n)
        np.testing.assert_array_equal(few.contact.shear_m, every.contact.shear_m)
        np.testing.assert_array_equal(few.applied_wrench, every.applied_wrench)
        assert few.n_in_contact == every.n_in_contact == few.contact.in_contact.sum()
        loaded += few.n_in_contact
    assert loaded > 1000


def test_only_cells_near_a_solid_are_active(tmp_path):
    body = scene(tmp_path)
    surface, active = body.surface, ActiveCells.of(body.surface)
    scene_, motion = body.cell_foundation.scene, body.cell_foundation.motion
    body.data.qpos[3:] = np.tile([9.0, 9.0, 9.0, 1.0, 0, 0, 0], len(KINDS))
    body.data.qpos[3:6] = (0.1, -0.05, 0.06)
    mujoco.mj_kinematics(body.model.mj, body.data)
    sphere = np.flatnonzero(scene_.body_id == body.model.mj.body("sphere").id)
    count = collect_active_cells(surface, scene_, motion, 0, 0.02, sphere, 1, active)
    rows = active.row[:count]
    assert (np.diff(rows) > 0).all()
    away_m = np.linalg.norm(surface.position_m[:400] - body.data.qpos[3:6], axis=1) - 0.05
    assert set(np.flatnonzero(away_m < 0.02)) <= set(rows)
    assert count < 60, "a few leaves of 8 cells"
    assert collect_active_cells(surface, scene_, motion, 0, 0.02, sphere, 0, active) == 0
    keep_active(active, 0, 7)
    keep_active(active, 1, 405)
    assert collect_active_cells(surface, scene_, motion, 0, 0.02, sphere, 0, active) == 1
    assert active.row[0] == 7
    assert collect_active_cells(surface, scene_, motion, 1, 0.02, sphere, 0, active) == 1
    assert active.row[0] == 405


def test_every_node_holds_its_cells():
    random = np.random.default_rng(1)
    patches = [random.normal(size=(n, 3)) for n in (1, 8, 9, 200)]
    tree, first = build_cell_tree(patches), 0
    for p, position_m in enumerate(patches):
        leaves = []
        for i in range(tree.root[p], tree.root[p + 1]):
            below = range(i, tree.after[i])
            cells = [row for node in below for row in tree.cell[tree.first[node] : tree.end[node]]]
            off_m = np.linalg.norm(position_m[np.array(cells) - first] - tree.centre_m[i], axis=1)
            assert off_m.max() <= tree.radius_m[i] + 1e-12
            leaves += list(tree.cell[tree.first[i] : tree.end[i]])
        assert sorted(leaves) == list(range(first, first + len(position_m)))
        first += len(position_m)


def test_the_sphere_of_a_patch_holds_its_cells_and_little_more(tmp_path):
    surface = scene(tmp_path).surface
    for p in range(2):
        position_m = surface.position_m[slice(*surface.patch_start[p : p + 2])]
        off_m = np.linalg.norm(position_m - surface.patch_centre_m[p], axis=1)
        assert off_m.max() == pytest.approx(surface.patch_radius_m[p])
        assert surface.patch_radius_m[p] <= 0.5 * np.linalg.norm(np.ptp(position_m, axis=0)) + 1e-12


def least_s(functions, repeats: int = 30):
    """Least CPU time [s] of each of `functions`, taken in turn."""
    least = [np.inf] * len(functions)
    for _ in range(repeats):
        for k, function in enumerate(functions):
            start = time.process_time_ns()
            for _ in range(20):
                function()
            least[k] = min(least[k], (time.process_time_ns() - start) / 20e9)
    return least


def ball_on_cells(folder: Path, subdivision: int):
    """Eight cells under a ball with a mesh of 20 · 4ⁿ faces and a radius of 50 mm."""
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(name="base")
    base.add_joint(name="turn", axis=[0, 0, 1])
    base.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.02], pos=[0, 0, -0.02], mass=50)
    spec.add_mesh(name="ball").make_sphere(subdivision=subdivision)
    spec.mesh("ball").scale = [0.05, 0.05, 0.05]
    load = spec.worldbody.add_body(name="load", pos=[0, 0, 0.055])
    load.add_freejoint()
    load.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ball", mass=1)
    spec.compile()
    folder.mkdir()
    skin = (body_scenes.lattice_patch("skin", "base", 4, 2),)
    body = body_scenes.body_of(folder, spec.to_xml(), skin, ("turn",))
    body.dynamics.compute_contact()
    assert body.cell_foundation.n_in_contact > 0
    return body


@pytest.mark.timeout(120)
def test_the_cost_of_a_mesh_hardly_grows_with_its_faces(tmp_path):
    """Sixteen times as many faces cost less than half as much again; face by face, they cost 15 times."""
    bodies = [ball_on_cells(tmp_path / str(n), n) for n in (1, 3)]
    coarse, fine = (body.cell_foundation for body in bodies)
    assert len(fine.scene.hulls.plane) >= 15 * len(coarse.scene.hulls.plane) > 0
    coarse_s, fine_s = least_s([lambda: coarse.compute_contact(0.001), lambda: fine.compute_contact(0.001)])
    assert fine_s < 1.5 * coarse_s
