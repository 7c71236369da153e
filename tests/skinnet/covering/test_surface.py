"""The felt surface: areas of closed forms, unions, bodies that move as one, regions and clearance."""

import math

import mujoco
import numpy as np
import pytest
from link_models import BOX, CAPSULE, CYLINDER, SPHERE, TWO_LINKS, ground_of, hull_of_points, model_of
from scipy.spatial import ConvexHull, cKDTree

from skinnet.covering.felt_solids import felt_solids, first_entry_m, is_inside, link_of_body, neighbour_poses
from skinnet.covering.surface_samples import sample_surface

SPACING_M = 0.003


def sampled(mj: mujoco.MjModel, body: str = "link"):
    solids = felt_solids(mj, link_of_body(mj, mj.body(body).id))
    return solids, sample_surface(solids, SPACING_M)


@pytest.mark.parametrize(
    ("geoms", "area_m2"),
    [
        (BOX, 24 * 0.05**2),
        (SPHERE, 4 * math.pi * 0.06**2),
        (CAPSULE, 4 * math.pi * 0.05 * 0.15),
        (CYLINDER, 2 * math.pi * 0.04 * (0.2 + 0.04)),
        (BOX + BOX, 24 * 0.05**2),
        (BOX + '<geom type="box" pos=".1 0 0" size=".05 .05 .05"/>', 40 * 0.05**2),
    ],
)
def test_samples_stand_for_the_area_of_the_union(geoms: str, area_m2: float) -> None:
    _, samples = sampled(model_of(geoms))
    assert samples.area_m2.sum() == pytest.approx(area_m2, rel=0.01)


def test_an_ellipsoid_has_its_area() -> None:
    _, samples = sampled(model_of('<geom type="ellipsoid" size=".05 .05 .1"/>'))
    e = math.sqrt(1.0 - 0.25)
    area_m2 = 2 * math.pi * 0.05**2 * (1.0 + 0.1 / (0.05 * e) * math.asin(e))  # prolate spheroid
    assert samples.area_m2.sum() == pytest.approx(area_m2, rel=0.01)


def test_a_hull_has_the_area_and_the_inside_of_its_mesh() -> None:
    asset, geom = hull_of_points()
    mj = model_of(geom, asset)
    solids, samples = sampled(mj)
    vertices_m = mj.mesh_vert[: mj.mesh_vertnum[0]].astype(float)
    assert samples.area_m2.sum() == pytest.approx(ConvexHull(vertices_m).area, rel=0.01)
    for scale, inside in ((0.999, True), (1.001, False)):
        found = [is_inside(solids, 0, *(scale * point_m)) for point_m in samples.point_m[::50]]
        assert found == [inside] * len(found)


def test_samples_keep_their_distance_and_leave_no_hole() -> None:
    _, samples = sampled(model_of(SPHERE))
    tree = cKDTree(samples.point_m)
    assert tree.query(samples.point_m, 2)[0][:, 1].min() >= 0.79 * SPACING_M
    i = np.arange(2000) + 0.5
    z, turn = 1.0 - i / 1000, i * 2.399963
    sphere = np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    assert tree.query(0.06 * sphere)[0].max() < 1.3 * SPACING_M


def test_rays_against_samples_end_on_them_and_agree_with_mujoco() -> None:
    """A ray from outside along the inward normal of a sample ends on the sample, as `mj_ray` has it."""
    asset, mesh = hull_of_points()
    mj = model_of(f'{mesh}<geom type="cylinder" size=".03 .15" pos=".02 0 0" euler="90 0 0"/>', asset)
    solids, samples = sampled(mj)
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    for point_m, normal in zip(samples.point_m[::40], samples.normal[::40], strict=True):
        start_m = point_m + 0.5 * normal
        found_m = first_entry_m(solids, *start_m, *(-normal), 1.0)
        assert found_m <= 0.5 + 1e-6
        geom = np.array([-1], dtype=np.int32)
        assert found_m == pytest.approx(
            mujoco.mj_ray(mj, data, start_m, -normal, None, 1, -1, geom), abs=2e-4
        )


def test_welded_bodies_are_one_link_and_what_cannot_collide_is_not_felt() -> None:
    mj = mujoco.MjModel.from_xml_string(TWO_LINKS)
    upper, fore = mj.body("upper").id, mj.body("fore").id
    assert link_of_body(mj, upper).members == (upper, mj.body("bracket").id)
    assert link_of_body(mj, mj.body("bracket").id).members == (upper, mj.body("bracket").id)
    solids, _ = sampled(mj, "fore")
    assert solids.geom_id.tolist() == [mj.geom("forearm").id]
    assert [link.body_id for link, _ in neighbour_poses(mj, link_of_body(mj, fore))] == [
        upper,
        mj.body("needle").id,
    ]


def test_solids_lie_in_the_frame_of_the_body() -> None:
    mj = mujoco.MjModel.from_xml_string(TWO_LINKS)
    solids = felt_solids(mj, link_of_body(mj, mj.body("bracket").id))
    arm = solids.geom_id.tolist().index(mj.geom("arm").id)
    assert solids.position_m[arm] == pytest.approx([0.0, 0.0, 0.175 - 0.3], abs=1e-6)


@pytest.mark.parametrize(
    ("region", "holds"),
    [
        ({"half_space": {"normal": (0, 0, 2), "offset_m": 0.05}}, lambda p: p[:, 2] >= 0.05),
        ({"interval": {"axis": "z", "min_m": -0.02, "max_m": 0.03}}, lambda p: abs(p[:, 2] - 0.005) <= 0.025),
        (
            {
                "box": {"min_m": (0, 0, 0), "max_m": (1, 1, 1)},
                "interval": {"axis": (0, 0, 1), "min_m": 0, "max_m": 0.05},
            },
            lambda p: (p >= 0).all(axis=1) & (p[:, 2] <= 0.05),
        ),
    ],
)
def test_a_region_is_what_all_its_parts_hold(region, holds) -> None:
    import msgspec

    from skinnet.deployment.skin.covers import CoverRegionSpec

    of = ground_of(model_of(CYLINDER), region=msgspec.convert(region, CoverRegionSpec))
    samples = of.ground.samples
    assert (of.ground.asked == holds(samples.point_m)).all()
    assert of.ground.asked.any()
    assert not of.ground.asked.all()


def test_surface_that_a_neighbour_sweeps_is_left_out() -> None:
    """The pedestal reaches 12 mm above the arm's lower end at some angle; MuJoCo's own distances agree."""
    mj = mujoco.MjModel.from_xml_string(TWO_LINKS)
    swept, whole = ground_of(mj, "upper"), ground_of(mj, "upper", clearance=False)
    assert whole.ground.asked.all()
    reached = ~swept.ground.asked
    assert 0.02 < reached.mean() < 0.6
    data, pedestal = mujoco.MjData(mj), mj.geom("pedestal").id
    nearest_m = np.full(len(reached), np.inf)
    samples = swept.ground.samples
    for angle in np.linspace(-1.2, 1.2, 24):
        data.qpos[0] = angle
        mujoco.mj_kinematics(mj, data)
        R, t = data.xmat[mj.body("upper").id].reshape(3, 3), data.xpos[mj.body("upper").id]
        top_m = (samples.point_m + 0.012 * samples.normal) @ R.T + t
        box_m = np.abs(top_m - data.geom_xpos[pedestal]) - mj.geom_size[pedestal]
        nearest_m = np.minimum(nearest_m, np.linalg.norm(np.maximum(box_m, 0.0), axis=1))
    below = samples.point_m[:, 2] < 0.1
    assert reached[below & (nearest_m == 0.0)].all()


FINGERS = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="palm"><geom type="box" size=".12 .05 .02" mass="1"/>
    <body name="one" pos="-.045 0 .1"><joint axis="1 0 0" range="-1.5 1.5" limited="true"/>
      <geom type="capsule" size=".04" fromto="0 0 .06 0 0 .2" mass=".5"/></body>
    <body name="two" pos=".045 0 .1"><joint axis="1 0 0" range="-1.5 1.5" limited="true"/>
      <geom type="capsule" size=".04" fromto="0 0 .06 0 0 .2" mass=".5"/></body>
  </body>
</worldbody></mujoco>
"""


def test_surface_that_a_link_beside_presses_at_home_is_left_out():
    mj = mujoco.MjModel.from_xml_string(FINGERS)
    apart = ground_of(mj, "one", np.array([1.4, -1.4]))
    beside = ground_of(mj, "one", np.zeros(2))
    assert apart.ground.asked.sum() > beside.ground.asked.sum()
    lost = apart.ground.asked & ~beside.ground.asked
    gap_m = 0.05 - beside.ground.samples.point_m[:, 0]  # from finger one's axis to the nearest line of two
    assert beside.ground.samples.normal[lost, 0].min() > 0.5
    assert gap_m[lost].max() < 0.05
    facing = beside.ground.samples.normal[:, 0] > 0.999
    assert facing.any()
    assert not beside.ground.asked[facing].any()
    assert (ground_of(mj, "one", np.zeros(2), clearance=False).ground.asked).all()


BESIDE_A_BASE = """
<mujoco><compiler angle="radian"/><worldbody>
  <geom name="post" type="capsule" size=".04" fromto="-.09 0 .16 -.09 0 .3"/>
  <body name="base"><geom type="capsule" size=".04" fromto=".09 0 .16 .09 0 .3" mass="3"/>
    <body name="one"><joint axis="1 0 0" range="-.5 .5" limited="true"/>
      <geom type="box" size=".02 .02 .02" mass=".5"/>
      <body name="two" pos="0 0 .1"><joint axis="0 0 1" range="-.5 .5" limited="true"/>
        <geom type="capsule" size=".04" fromto="0 0 .06 0 0 .2" mass=".5"/></body></body></body>
</worldbody></mujoco>
"""


def test_a_base_two_joints_away_counts_and_furniture_does_not():
    asked = ground_of(mujoco.MjModel.from_xml_string(BESIDE_A_BASE), "two").ground
    assert not asked.asked[asked.samples.normal[:, 0] > 0.999].any()
    assert asked.asked[asked.samples.normal[:, 0] < -0.999].all()
