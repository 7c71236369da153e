"""The objects: what the table says is what the model has, and how they give way to skin and links."""

import re

import body_scenes
import mujoco
import numpy as np
import pytest
from grasp_rig import CELLS_M2, FOAM_PA_PER_M, MS, S, close, rig, rig_deployment
from locations import ROOT

from skinnet.body.contact.compliant_layer import geoms_under_skin
from skinnet.body.environment.stand_model import OBJECT, place_object
from skinnet.deployment.environment.objects import OBJECTS
from skinnet.deployment.load import load
from skinnet.errors import DeploymentError
from skinnet.skin.placement import place_patch

PAGE = ROOT / "docs" / "assumptions.md"
BOX, CYLINDER, ELLIPSOID = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{n}")) for n in ("BOX", "CYLINDER", "ELLIPSOID")
)


def solids(mj: mujoco.MjModel) -> list[int]:
    return [g for g in range(mj.ngeom) if mj.geom_bodyid[g] == mj.body(OBJECT).id]


def outline_m(kind: int, size: np.ndarray) -> np.ndarray:
    """Points (n, 3) on the outline of a solid in its own frame."""
    if kind == BOX:
        return size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    around = np.linspace(0.0, 2.0 * np.pi, 721)
    if kind == CYLINDER:
        rim = size[0] * np.column_stack([np.cos(around), np.sin(around), np.zeros(721)])
        up = np.array([0.0, 0.0, size[1]])
        return np.concatenate([rim - up, rim + up])
    assert kind == ELLIPSOID
    up = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    a, b = (grid.ravel() for grid in np.meshgrid(around, up))
    return size * np.column_stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_is_as_large_and_heavy_as_the_table_says(tmp_path, name):
    body = rig(tmp_path, name)
    mj, data, thing = body.model.mj, body.data, OBJECTS[name]
    points = np.concatenate(
        [
            outline_m(mj.geom_type[g], mj.geom_size[g]) @ data.geom_xmat[g].reshape(3, 3).T
            + data.geom_xpos[g]
            for g in solids(mj)
        ]
    )
    low, high = (ends - data.body(OBJECT).xpos for ends in (points.min(axis=0), points.max(axis=0)))
    assert high - low == pytest.approx(thing.size_m, abs=2e-4)
    assert high == pytest.approx(0.5 * np.array(thing.size_m), abs=2e-4), "the frame is in the middle"
    assert mj.body(OBJECT).mass[0] == pytest.approx(thing.mass_kg)
    assert abs(mj.body(OBJECT).ipos[:2]).max() < 0.01
    felt = set(body.cell_foundation.scene.geom_id.tolist())
    assert felt.issuperset(solids(mj))


def test_boxes_have_the_inertia_of_their_walls_or_of_their_contents(tmp_path):
    """Closed forms: a solid block, and six plates with the mass of their area."""
    a, b, c = OBJECTS["delivery_box"].size_m
    solid = OBJECTS["delivery_box"].mass_kg / 12.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    mj = rig(tmp_path, "delivery_box").model.mj
    assert sorted(mj.body(OBJECT).inertia) == pytest.approx(sorted(solid))

    a, b, c = edges = np.array(OBJECTS["moving_box"].size_m)
    density = OBJECTS["moving_box"].mass_kg / (2.0 * (a * b + b * c + c * a))
    second = np.zeros(3)  # ∫ x² dm, of each coordinate
    for axis in range(3):
        for across in range(3):  # two plates each, normal to `across`
            plate_kg = 2.0 * density * np.prod(np.delete(edges, across))
            second[axis] += plate_kg * edges[axis] ** 2 * (1 / 4 if axis == across else 1 / 12)
    hollow = second.sum() - second
    mj = rig(tmp_path, "moving_box").model.mj
    assert sorted(mj.body(OBJECT).inertia) == pytest.approx(sorted(hollow), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "overlap_m"),
    [("delivery_box", 0.005), ("moving_box", 0.005), ("moving_box", 0.016), ("lid", 0.014)],
)
def test_foam_and_object_are_two_springs_in_a_row(tmp_path, name, overlap_m):
    """Closed form of the force on each paddle, also where they overlap by more than the foam is thick."""
    body, thing = rig(tmp_path, name), OBJECTS[name]
    close(body, overlap_m, thing.size_m[1])
    in_a_row = 1.0 / (1.0 / FOAM_PA_PER_M + 1.0 / thing.stiffness_pa_per_m)
    expected_n = in_a_row * overlap_m * CELLS_M2
    truth = body.ground_truth()
    assert truth.arrays["object_patch_force_n"][-1] == pytest.approx([expected_n, expected_n], rel=0.01)
    assert not truth.facts["object"]["rigid_contacts"], "the links under the foam are not met"


@pytest.mark.parametrize("round_link", [False, True])
def test_a_link_under_skin_is_met_where_the_foam_is_pressed_flat(tmp_path, round_link):
    """12 mm of foam in series with 2 MPa/m are flat at 21 mm; for a flat and a round link."""
    body, thing = rig(tmp_path, "moving_box", round_link=round_link), OBJECTS["moving_box"]
    flat_m = body.thickness_m * (1.0 + FOAM_PA_PER_M / thing.stiffness_pa_per_m)
    assert flat_m == pytest.approx(0.021)
    close(body, body.thickness_m + 0.4 * (flat_m - body.thickness_m), thing.size_m[1])
    assert not body.ground_truth().facts["object"]["rigid_contacts"]
    body.set_command([0.02, 0.02])
    body.advance(body.t_ns + 400 * MS)
    met = body.ground_truth().facts["object"]["rigid_contacts"]
    assert set(met) == {"left", "right"}
    assert min(each["peak_force_n"] for each in met.values()) > 50.0


def test_bare_links_meet_a_soft_object_at_its_face(tmp_path):
    """A block that stands out 8 mm beyond the foam touches first; the force goes through the box."""
    body = rig(tmp_path, "moving_box", bare_m=-0.020)
    close(body, -0.005, OBJECTS["moving_box"].size_m[1])
    body.set_command([0.01, 0.01])
    body.advance(body.t_ns + 800 * MS)
    body.set_command([0.0, 0.0])
    body.advance(body.t_ns + 300 * MS)
    truth = body.ground_truth()
    left_n, right_n = truth.arrays["object_patch_force_n"][-1]
    assert left_n == 0.0
    assert right_n > 5.0
    assert set(truth.facts["object"]["rigid_contacts"]) == {"bare"}
    pushed_n = body.data.qfrc_constraint[body.model.dof_address[0]]
    assert abs(pushed_n) == pytest.approx(right_n, rel=0.05)


def test_cells_lie_on_the_links_that_they_were_put_on():
    body = body_scenes.hrp2()
    deployment = body_scenes.load(body_scenes.HRP2)
    patches = [place_patch(patch, deployment.cells) for patch in deployment.patches]
    links = [body.model.mj.geom(g).name for g in geoms_under_skin(body.model.mj, patches)]
    sides = [f"{side}_{part}" for side in ("left", "right") for part in ("upper_arm", "forearm", "hand")]
    assert sorted(links) == sorted(["chest", *sides])


def test_the_seed_places_the_object_within_the_disturbance():
    drawn = []
    for seed in range(1, 41):
        presented = place_object(rig_deployment(seed=seed, max_offset_m=0.03, max_yaw_deg=10.0))
        assert presented is not None
        off_m, turned_deg = np.array(presented.position_m[:2]) - (0.4, 0.0), np.degrees(presented.yaw_rad)
        drawn.append([*off_m / 0.03, turned_deg / 10.0])
        assert presented.position_m[2] == 1.07
        again = place_object(rig_deployment(seed=seed, max_offset_m=0.03, max_yaw_deg=10.0))
        unturned = place_object(rig_deployment(seed=seed, max_offset_m=0.03))
        assert again is not None
        assert unturned is not None
        assert again.position_m == presented.position_m == unturned.position_m
    shares = np.array(drawn)
    assert np.abs(shares).max() < 1.0
    assert (shares.min(axis=0) < -0.7).all()
    assert (shares.max(axis=0) > 0.7).all()
    assert np.abs(np.corrcoef(shares.T)[np.triu_indices(3, 1)]).max() < 0.4


def test_the_object_stands_where_the_seed_has_put_it(tmp_path):
    body = rig(tmp_path, "lid", max_offset_m=0.02, max_yaw_deg=15.0)
    presented = place_object(rig_deployment("lid", max_offset_m=0.02, max_yaw_deg=15.0))
    assert presented is not None
    assert body.data.body(OBJECT).xpos == pytest.approx(presented.position_m)
    R = body.data.body(OBJECT).xmat.reshape(3, 3)
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(presented.yaw_rad)
    facts = body.ground_truth().facts["object"]
    assert facts["initial_position_m"] == presented.position_m
    assert facts["yaw_rad"] == presented.yaw_rad


def test_an_unknown_object_is_refused_with_those_that_there_are():
    with pytest.raises(
        DeploymentError, match=r"object = 'box': allowed: 'none', 'trash_bin', .*'wide_crate'"
    ):
        load(body_scenes.HRP2, ("object=box",))


def test_the_page_lists_every_object():
    """Width, mass and stiffness in docs/assumptions.md are those of the table."""
    rows = re.findall(
        r"^\| `(\w+)` \| ([\d. ×]+) \| ([\d.]+) \| ([\d.]+) \|", PAGE.read_text(encoding="utf-8"), re.M
    )
    assert [row[0] for row in rows] == list(OBJECTS)
    for name, size, mass_kg, mpa_per_m in rows:
        thing = OBJECTS[name]
        assert tuple(float(edge) for edge in size.split("×")) == thing.size_m
        assert float(mass_kg) == thing.mass_kg
        assert float(mpa_per_m) == thing.stiffness_pa_per_m * 1e-6


def test_none_is_a_stand_alone(tmp_path):
    body = rig(tmp_path, "none", rise_m=0.3, rise_stage="guide")
    body.begin_stage("guide")
    body.advance(4 * S)
    truth = body.ground_truth()
    assert truth.facts["object"] is None
    assert truth.arrays["stand_top_m"][-1] == pytest.approx(1.07 - 0.15)
    assert not any(key.startswith("object") for key in truth.arrays)
