"""The elastic foundation: statics, conservation, friction, and the area that samples stand for."""

import math

import body_scenes
import numba
import numpy as np
import pytest
from locations import DEPLOYMENTS

from skinnet.body.contact.skin_surface import (
    N_SAMPLES_PER_CELL,
    cell_grid,
    force_cell_centre_m,
    hexagon_m,
)
from skinnet.body.simulation import BodySimulation
from skinnet.deployment.load import load
from skinnet.deployment.robot import FoamSpec
from skinnet.errors import ModelError

PLATE = """
<mujoco>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="base" pos="0 0 1" euler="{tilt} 0 0">
      <geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.01" contype="1" conaffinity="1"/>
    </body>
    <body name="box" pos="0 0 {height}">
      <freejoint/>
      <geom type="box" size="0.06 0.06 0.03" mass="1"/>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""
SIDE_M = 0.014


def plate(folder, tilt_deg=0.0, **body):
    """A box of 1 kg just above a plate that is fully covered with skin; it may be tilted about x."""
    mjcf = PLATE.format(tilt=tilt_deg, height=1.0 + (0.012 + 0.03) / math.cos(math.radians(tilt_deg)))
    skin = (body_scenes.lattice_patch("skin", "base", 9, 11),)
    scene = body_scenes.body_of(folder, mjcf, skin, ("turn",), **body)
    tilt = math.radians(tilt_deg)
    scene.data.qpos[3:7] = (math.cos(tilt / 2), math.sin(tilt / 2), 0, 0)
    return scene


@pytest.mark.parametrize("tilt_deg", [0.0, 10.0, 20.0])
def test_a_resting_box_weighs_what_it_weighs(tmp_path, tilt_deg):
    body = plate(tmp_path, tilt_deg)
    body.advance(2_000_000_000)
    at_ns, before = body.t_ns, body.data.qpos[:3].copy()
    total_n = body.stimulus()[:, :3].sum()
    assert total_n == pytest.approx(9.81 * math.cos(math.radians(tilt_deg)), rel=0.01)
    body.advance(at_ns + 1_000_000_000)
    crept_m = np.linalg.norm(body.data.qpos[:3] - before)
    assert crept_m < 1e-5, "friction holds: tan 20° < 0.6"


def test_a_slope_beyond_the_friction_cone_slides_as_coulomb_says(tmp_path):
    body = plate(tmp_path, 20.0, foam=FoamSpec(friction=0.2))
    body.advance(50_000_000)
    speed = np.linalg.norm(body.data.qvel[:3])
    body.advance(150_000_000)
    expected = 9.81 * (math.sin(math.radians(20)) - 0.2 * math.cos(math.radians(20)))
    gained = np.linalg.norm(body.data.qvel[:3]) - speed
    assert gained / 0.1 == pytest.approx(expected, rel=0.05)


def test_depth_under_a_weight_is_the_springs(tmp_path):
    """1 kg on 0.12 m × 0.12 m of foam of 1.5 MPa/m sinks by m g / (k A)."""
    body = plate(tmp_path)
    body.advance(2_000_000_000)
    depth_m = 1.0 + 0.012 + 0.03 - body.data.qpos[2]
    assert depth_m == pytest.approx(9.81 / (1.5e6 * 0.12**2), rel=0.05)


def test_foam_never_pulls(tmp_path):
    body = plate(tmp_path)
    body.advance(500_000_000)
    body.data.qvel[2] = 0.5  # torn off faster than the foam can follow
    lowest = 0.0
    for _ in range(20):
        body.advance(body.t_ns + 1_000_000)
        lowest = min(lowest, body.stimulus()[:, :3].min())
        assert body.data.xfrc_applied[body.model.mj.body("box").id, 2] >= 0.0
    assert lowest == 0.0
    assert body.stimulus()[:, :3].sum() == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_action_equals_reaction_and_elements_add_up_to_the_force(tmp_path, seed):
    """A tumbling ball on a moving arm: no net force or moment, and Σ element forces = force on the ball."""
    ball = '<freejoint/><geom type="sphere" size="0.03" mass="0.5"/>'
    more = f'<body name="ball" pos="0.33 0.005 1.095">{ball}</body>'
    foam = FoamSpec(friction=0.0 if seed == 0 else 0.6)
    body = body_scenes.arm(tmp_path, more=more, foam=foam)
    random = np.random.default_rng(seed)
    mj, ball = body.model.mj, body.model.mj.body("ball").id
    body.data.qvel[-3:] = 20.0 * random.normal(size=3)
    loaded = 0
    for _ in range(100):
        body.set_command(random.uniform(-0.5, 0.5, size=2))
        body.advance(body.t_ns + 2_000_000)
        forces_n = body.stimulus()[:, :3].sum(axis=1)
        wrench = body.data.xfrc_applied
        moments = wrench[:, 3:] + np.cross(body.data.xipos, wrench[:, :3])
        np.testing.assert_allclose(wrench[:, :3].sum(axis=0), 0.0, atol=1e-9)
        np.testing.assert_allclose(moments.sum(axis=0), 0.0, atol=1e-9)
        R_world_body = body.data.xmat[mj.body("arm").id].reshape(3, 3)
        normals = (R_world_body @ body.surface.R_body_cell)[:, :, 2]
        pressure_n = forces_n @ normals
        friction_n = wrench[ball, :3] - pressure_n
        if seed == 0:
            np.testing.assert_allclose(friction_n, 0.0, atol=1e-9)
        else:
            assert np.linalg.norm(friction_n) <= 0.6 * forces_n.sum() + 1e-9
        loaded += forces_n.sum() > 0.1
    assert loaded >= 15


def test_samples_stand_for_equal_areas_of_the_hexagon():
    grid = cell_grid(SIDE_M)
    samples = np.column_stack([grid.x_m, grid.y_m])[grid.n_nodes :][: grid.n_samples]
    assert grid.n_samples * grid.area_m2 == pytest.approx(1.5 * math.sqrt(3.0) * SIDE_M**2)
    assert samples.shape == (N_SAMPLES_PER_CELL, 2)
    np.testing.assert_allclose(samples.mean(axis=0), 0.0, atol=1e-15)
    # polar moment of a hexagon over its area: 5/12 side²; each of the 27 rhombi holds (side/3)²/6 of its own
    moment_m2 = (samples**2).sum(axis=1).mean()
    assert moment_m2 == pytest.approx(SIDE_M**2 * (5 / 12 - 1 / 54))
    for element in range(3):
        mine = samples[9 * element : 9 * element + 9]
        centre = force_cell_centre_m(element, 1.0)
        np.testing.assert_allclose(mine.mean(axis=0), centre * SIDE_M / 2, atol=1e-12)
    rim = hexagon_m(SIDE_M)
    inward = np.roll(rim, -1, axis=0) + rim
    assert np.all(samples @ inward.T < 1.5 * SIDE_M**2), "all inside the hexagon"


def test_a_wide_object_presses_all_force_cells_alike(tmp_path):
    body = plate(tmp_path)
    body.advance(2_000_000_000)
    forces = body.stimulus()[:, :3]
    covered = forces.min(axis=1) > 0.0
    assert covered.sum() >= 8
    inner = forces[np.linalg.norm(body.surface.position_m[:, :2], axis=1) < 0.03]
    np.testing.assert_allclose(inner, inner.mean(), rtol=0.02)


def test_nothing_near_costs_no_force_and_leaves_no_wrench(tmp_path):
    body = body_scenes.arm(tmp_path)
    body.advance(100_000_000)
    assert not body.data.xfrc_applied.any()
    assert not body.stimulus()[:, :3].any()


@pytest.mark.parametrize("seam_m", [0.0031, -0.0172])
def test_a_seam_between_two_solids_of_a_body_does_not_shear_foam_twice(tmp_path, seam_m):
    """Samples under the seam are pressed by both halves of a box, but are sheared once."""
    whole = '<geom type="box" size="0.06 0.06 0.03" mass="1"/>'
    halves = "".join(
        f'<geom type="box" size="{(high - low) / 2} 0.06 0.03" pos="{(low + high) / 2} 0 0" mass="0.5"/>'
        for low, high in ((-0.06, seam_m), (seam_m, 0.06))
    )
    assert whole in PLATE
    shear_n = []
    for folder, geoms in (("whole", whole), ("halves", halves)):
        (tmp_path / folder).mkdir()
        mjcf = PLATE.replace(whole, geoms).format(tilt=0.0, height=1.0 + 0.012 + 0.03 - 0.003)
        skin = (body_scenes.lattice_patch("skin", "base", 9, 11),)
        body = body_scenes.body_of(tmp_path / folder, mjcf, skin, ("turn",))
        for _ in range(40):  # 0.2 mm, far below the friction cone
            body.data.qpos[0] += 5e-6
            body.data.qvel[:] = 0.0
            body.data.qvel[0] = 5e-3
            body.dynamics.compute_contact()
        shear_n.append(float(body.data.xfrc_applied[:, 0].max()))
    k, c, area_m2 = 1.5e6, 1e4, 0.12 * 0.12
    assert shear_n[0] == pytest.approx(0.5 * (k * 0.2e-3 + c * 5e-3) * area_m2, rel=0.01)
    assert shear_n[1] == pytest.approx(shear_n[0], rel=3e-3)


def test_more_solids_than_samples_have_space_for_are_refused(tmp_path):
    bristles = "".join(
        f'<geom type="box" size="0.00034 0.00034 0.03" pos="{7e-4 * i} {7e-4 * j} 0" mass="0.001"/>'
        for i in range(-20, 21)
        for j in range(-20, 21)
    )
    mjcf = PLATE.replace('<geom type="box" size="0.06 0.06 0.03" mass="1"/>', bristles)
    mjcf = mjcf.format(tilt=0.0, height=1.0 + 0.012 + 0.03 - 0.003)
    skin = (body_scenes.lattice_patch("skin", "base", 1, 1),)
    with pytest.raises(ModelError, match="loaded points beyond the 1054 that are expected at most"):
        body_scenes.body_of(tmp_path, mjcf, skin, ("turn",)).advance(1_000_000)


@pytest.mark.parametrize("name", ["hrp2_touch", "riba_cylinder", "two_link_arm"])
def test_cells_and_sheets_share_the_compiled_contact(name):
    """Numba compiles once for each type of its arguments, and the contact takes half a minute."""
    body = BodySimulation(load(DEPLOYMENTS / f"{name}.toml"), DEPLOYMENTS)
    foundations = (body.dynamics.cell_foundation, body.dynamics.sheet_foundation)
    assert numba.typeof(foundations[0].problem) == numba.typeof(foundations[1].problem)
