"""The covering of one link: what fits, what may not be, and what a limit does, on primitives and a hull."""

from functools import cache

import mujoco
import numpy as np
import pytest
from link_models import (
    BOX,
    CAPSULE,
    CYLINDER,
    PITCH_M,
    PLATE,
    SIDE_M,
    SMALL_CUBE,
    SPHERE,
    TEE,
    ground_of,
    hull_of_points,
    model_of,
)
from scipy.spatial import cKDTree

from skinnet.covering.covering_metrics import cell_figures, covering_metrics
from skinnet.covering.link_covering import LinkCovering, cover_ground
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import CellPoseSpec, PatchSpec
from skinnet.skin.placement import place_patch

NONE = (np.zeros((0, 3)), np.zeros((0, 3, 3)))
HULL_ASSET, HULL = hull_of_points()
CELL_M2 = 1.5 * 3**0.5 * SIDE_M**2


def wires_of(position_m: np.ndarray, R: np.ndarray) -> int:
    cells = tuple(
        CellPoseSpec(position_m=tuple(p), normal=tuple(q[:, 2]), x_axis=tuple(q[:, 0]))
        for p, q in zip(position_m, R, strict=True)
    )
    return len(place_patch(PatchSpec(name="p", body="link", cells=cells), CellSpec(side_m=SIDE_M)).wires)


def measured(geoms: str, position_m: np.ndarray, R: np.ndarray, asset: str = "") -> dict:
    mj = model_of(geoms, asset)
    figures = cell_figures(mj, ground_of(mj), position_m, R, SIDE_M, 0.012)
    return covering_metrics([figures], wires_of(position_m, R))


@cache
def covering_of(geoms: str, asset: str = "") -> LinkCovering:
    return cover_ground(ground_of(model_of(geoms, asset)), *NONE, None)


@pytest.mark.parametrize(
    ("geoms", "asset", "within", "wired"),
    [
        (BOX, "", 0.94, 0.5),
        (CYLINDER, "", 0.96, 0.6),
        (CAPSULE, "", 0.95, 0.6),
        (SPHERE, "", 0.92, 0.6),
        (HULL, HULL_ASSET, 0.95, 0.6),
        (TEE, "", 0.94, 0.5),
        (PLATE, "", 0.92, 0.5),
        (SMALL_CUBE, "", 0.8, 0.0),
    ],
)
def test_a_link_is_covered_without_fault(geoms: str, asset: str, within: float, wired: float) -> None:
    made = covering_of(geoms, asset)
    found = measured(geoms, made.position_m, made.R_body_cell, asset)
    assert (found["overlaps"], found["piercing"], found["buried"]) == (0, 0, 0)
    assert found["within_0_6_pitch"] >= within
    assert found["wired"] >= wired
    assert found["gap_mm_p95"] < 6.5


def test_cells_of_a_sphere_lie_on_it_and_face_outwards() -> None:
    made = covering_of(SPHERE)
    radius_m = np.linalg.norm(made.position_m, axis=1)
    assert np.abs(radius_m - 0.06).max() < 1e-3
    assert ((made.position_m * made.R_body_cell[:, :, 2]).sum(axis=1) / radius_m).min() > 0.99


def test_a_plate_has_cells_on_both_sides_back_to_back() -> None:
    made = covering_of(PLATE)
    flat = np.abs(made.R_body_cell[:, 2, 2]) > 0.99
    up = made.R_body_cell[:, 2, 2] > 0.0
    area = 0.12 * 0.12 / CELL_M2
    assert (flat & up).sum() > 0.6 * area
    assert (flat & ~up).sum() > 0.6 * area


def test_no_two_hexagons_share_a_point() -> None:
    """Each cell's corners and middles of edges lie outside the prism of every other cell."""
    made = covering_of(HULL, HULL_ASSET)
    angles = np.radians(np.arange(0.0, 360.0, 10.0))
    reach = np.where(np.arange(36) % 6 == 3, SIDE_M, SIDE_M * 3**0.5 / 2) - 0.001
    rim = np.column_stack([reach * np.cos(angles), reach * np.sin(angles), np.zeros(36)])
    for i, j in cKDTree(made.position_m).query_pairs(2 * SIDE_M):
        for a, b in ((i, j), (j, i)):
            world = rim @ made.R_body_cell[a].T + made.position_m[a]
            x, y, z = ((world - made.position_m[b]) @ made.R_body_cell[b]).T
            apothem_m = SIDE_M * 3**0.5 / 2 - 0.001
            inside = (np.abs(x) < apothem_m) & (0.5 * np.abs(x) + 3**0.5 / 2 * np.abs(y) < apothem_m)
            assert not (inside & (z > 0.0) & (z < 0.002)).any()


def test_cells_keep_off_cells_that_are_there() -> None:
    of = ground_of(model_of(CYLINDER))
    whole = covering_of(CYLINDER)
    there = whole.position_m[:, 2] > 0.0
    fixed = whole.position_m[there], np.ascontiguousarray(whole.R_body_cell[there])
    rest = cover_ground(of, *fixed, None)
    assert len(rest.position_m) > 0.6 * (~there).sum()
    both = np.concatenate([fixed[0], rest.position_m]), np.concatenate([fixed[1], rest.R_body_cell])
    found = measured(CYLINDER, *both)
    assert (found["overlaps"], found["piercing"]) == (0, 0)


def test_max_cells_bounds_a_compact_patch() -> None:
    few = cover_ground(ground_of(model_of(CYLINDER)), *NONE, 7)
    assert len(few.position_m) == 7
    assert np.ptp(few.position_m, axis=0).max() < 3.5 * PITCH_M


def test_a_margin_keeps_hexagons_off_creases() -> None:
    margin_m = 0.004
    made = cover_ground(ground_of(model_of(BOX), margin_m=margin_m), *NONE, None)
    assert len(made.position_m) >= 6 * 7
    corner = np.array([[0.5 * 3**0.5 * SIDE_M, 0.5 * SIDE_M, 0.0], [0.0, SIDE_M, 0.0]])
    for p, R in zip(made.position_m, made.R_body_cell, strict=True):
        face = int(np.argmax(np.abs(p)))
        assert abs(R[face, 2]) > 0.999
        others = [k for k in range(3) if k != face]
        for point in np.concatenate([corner, -corner]):
            assert np.abs((p + R @ point)[others]).max() < 0.05 - margin_m + 0.002  # samples are 3 mm apart


def test_the_same_link_gets_the_same_cells() -> None:
    again = cover_ground(ground_of(model_of(TEE)), *NONE, None)
    made = covering_of(TEE)
    assert (again.position_m == made.position_m).all()
    assert (again.R_body_cell == made.R_body_cell).all()


RIM = """
<mujoco>
  <worldbody>
    <body name="lower">
      <geom name="lower" type="cylinder" size=".05 .1" mass="3"/>
      <body name="upper" pos="0 0 .104">
        <joint name="turn" axis="0 0 1"/>
        <geom name="upper" type="box" size=".09 .045 .04" pos="0 0 .04" mass="2"/>
      </body>
    </body>
    <body name="probe" mocap="true"><geom name="probe" type="cylinder" size="{radius} {half}"/></body>
  </worldbody>
</mujoco>
"""
"""A box that turns 4 mm above the end of a cylinder, and juts out beyond its rim."""


def test_no_cell_at_a_rim_is_in_the_way_of_what_turns_above_it() -> None:
    """Cells may jut out beyond an edge: their foam, as cylinders of MuJoCo, is clear at all angles."""
    half_m = 0.5 * 0.012
    mj = mujoco.MjModel.from_xml_string(RIM.format(radius=0.5 * PITCH_M, half=half_m))
    found = cover_ground(ground_of(mj, "lower"), *NONE, None)
    assert len(found.position_m) > 50
    data, probe, upper = mujoco.MjData(mj), mj.geom("probe").id, mj.geom("upper").id
    deepest_m = 0.0
    for angle in np.linspace(-np.pi, np.pi, 25):
        data.qpos[0] = angle
        for position_m, R in zip(found.position_m, found.R_body_cell, strict=True):
            data.mocap_pos[0] = position_m + half_m * R[:, 2]
            mujoco.mju_mat2Quat(data.mocap_quat[0], R.ravel())
            mujoco.mj_kinematics(mj, data)
            deepest_m = max(deepest_m, -mujoco.mj_geomDistance(mj, data, probe, upper, 0.1, None))
    assert deepest_m < 0.5e-3


def test_cells_fill_what_a_turning_neighbour_leaves() -> None:
    of = ground_of(mujoco.MjModel.from_xml_string(RIM.format(radius=0.01, half=0.01)), "lower")
    found, samples, asked = cover_ground(of, *NONE, None), of.ground.samples, of.ground.asked
    off_m, _ = cKDTree(found.position_m).query(samples.point_m[asked])
    area_m2 = samples.area_m2[asked]
    assert area_m2[off_m < 0.6 * PITCH_M].sum() > 0.97 * area_m2.sum()
