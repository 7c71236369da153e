"""What skin feels of a model: MuJoCo's filters, margins, hulls of meshes; what is refused, by name."""

import math
from pathlib import Path

import body_scenes
import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

from skinnet.body.contact.contact_margins import clear_contact_margins
from skinnet.body.contact.mesh_quality import hull_gap_m, is_inward, open_edges
from skinnet.errors import ModelError

WEIGHT_N = 9.81
SCENE = """
<mujoco>
  <asset>{assets}</asset>
  <worldbody>
    <body name="base">
      <joint name="turn" axis="0 0 1"/>
      <geom name="plate" type="box" size="0.12 0.12 0.02" pos="0 0 -0.02" mass="50" {plate}/>
      <body name="link" pos="{link}">
        <joint name="lift" axis="0 0 1"/>
        <geom name="link" type="box" size="0.05 0.05 0.02" pos="0 0 0.0305"/>
      </body>
    </body>
    <body name="load" pos="0 0 {height}"><freejoint/>{load}</body>
    {more}
  </worldbody>
  {rest}
</mujoco>
"""
BOX = '<geom name="box" type="box" size="0.05 0.05 0.02" mass="1" {}/>'
ABOVE_FOAM_M = 0.0121


def scene(folder: Path, load: str = BOX.format(""), *, half_m: float = 0.02, **parts: str):
    """A plate of 24 cm that turns, covered with skin, and a load of 1 kg just above its foam."""
    keys = {"assets": "", "plate": "", "link": "0 0 5", "more": "", "rest": "", **parts}
    mjcf = SCENE.format(load=load, height=ABOVE_FOAM_M + half_m, **keys)
    skin = (body_scenes.lattice_patch("skin", "base", 7, 7),)
    return body_scenes.body_of(folder, mjcf, skin, ("turn",))


def felt_n(body, seconds: float = 0.6) -> float:
    body.advance(body.t_ns + int(seconds * 1e9))
    return float(body.stimulus()[:, :3].sum())


def test_a_box_presses_with_its_weight(tmp_path):
    assert felt_n(scene(tmp_path)) == pytest.approx(WEIGHT_N, rel=0.01)


@pytest.mark.parametrize(
    ("plate", "load", "rest"),
    [
        ("", "", '<contact><exclude body1="base" body2="load"/></contact>'),
        ('contype="1" conaffinity="0"', 'contype="1" conaffinity="0"', ""),
        ('contype="1" conaffinity="1"', 'contype="2" conaffinity="2"', ""),
        ('contype="0" conaffinity="0"', "", ""),
        ("", 'contype="0" conaffinity="0"', ""),
        ("", "", '<option><flag contact="disable"/></option>'),
    ],
)
def test_what_never_collides_is_not_felt(tmp_path, plate, load, rest):
    """The load starts in the foam and falls through it, as it falls through the plate."""
    body = scene(tmp_path, BOX.format(load), half_m=0.012, plate=plate, rest=rest)
    body.advance(30_000_000)
    assert body.stimulus()[:, :3].sum() == 0.0
    assert body.data.qvel[-4] == pytest.approx(-0.03 * WEIGHT_N, rel=1e-6), "it falls freely"


def test_a_child_that_dips_into_the_foam_is_not_felt(tmp_path):
    body = scene(tmp_path, link="0.02 0 0")
    assert felt_n(body, 0.01) == 0.0


def test_a_pair_of_geoms_without_masks_presses(tmp_path):
    masks = 'contype="0" conaffinity="0"'
    pair = '<contact><pair geom1="plate" geom2="box"/></contact>'
    body = scene(tmp_path, BOX.format(masks), plate=masks, rest=pair)
    assert felt_n(body) == pytest.approx(WEIGHT_N, rel=0.01)


@pytest.mark.parametrize(
    ("plate", "load", "rest"),
    [
        ("", 'margin="0.02"', ""),
        ('margin="0.02"', "", ""),
        ('margin="0.01" gap="0.005"', 'margin="0.01"', ""),
        ("", "", '<contact><pair geom1="plate" geom2="box" margin="0.02"/></contact>'),
        ("", "", '<option o_margin="0.02"><flag override="enable"/></option>'),
    ],
)
def test_margins_do_not_hold_things_off_the_foam(tmp_path, plate, load, rest):
    body = scene(tmp_path, BOX.format(load), plate=plate, rest=rest)
    assert felt_n(body) == pytest.approx(WEIGHT_N, rel=0.01)


def test_only_margins_where_skin_can_be_touched_are_cleared(tmp_path):
    mjcf = SCENE.format(
        assets="",
        plate='margin="0.02"',
        link="0 0 5",
        height=1,
        load=BOX.format('gap="0.003"'),
        more='<body name="other"><joint/><geom name="other" size="0.1" contype="2" conaffinity="2" '
        'margin="0.004"/></body>',
        rest='<contact><pair geom1="plate" geom2="other" margin="0.005"/></contact>',
    )
    mj = mujoco.MjModel.from_xml_string(mjcf)
    cleared = clear_contact_margins(mj, [mj.body("base").id])
    assert cleared == [
        'geom "plate" (margin 20 mm)',
        'geom "box" (gap 3 mm)',
        'geom "other" (margin 4 mm)',  # the pair makes it collide
        'pair of geom "plate" and geom "other" (margin 5 mm)',
    ]
    assert not np.concatenate([mj.geom_margin, mj.geom_gap, mj.pair_margin]).any()
    mj = mujoco.MjModel.from_xml_string(
        mjcf.replace('<pair geom1="plate" geom2="other" margin="0.005"/>', "")
    )
    clear_contact_margins(mj, [mj.body("base").id])
    assert mj.geom("other").margin == 0.004


def u_bracket(*, name: str = "u", leave_out: int = 0, inwards: bool = False) -> str:
    """A mesh: a U-shaped bracket 60 mm wide, 40 mm long and high, of 5 mm plates, open downwards."""
    outline = [(-30, 0), (30, 0), (30, 40), (25, 40), (25, 5), (-25, 5), (-25, 40), (-30, 40)]
    vertices = [(x, y, 20 - z) for y in (-20, 20) for x, z in outline]
    quads = [(k, (k + 1) % 8, 8 + (k + 1) % 8, 8 + k) for k in range(8)]
    caps = [(0, 5, 4, 1), (1, 4, 3, 2), (0, 7, 6, 5)]
    quads += caps + [tuple(8 + k for k in reversed(cap)) for cap in caps]
    faces = [t for q in quads for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    faces = faces[: len(faces) - leave_out]
    if inwards:
        faces = [face[::-1] for face in faces]
    text = " ".join(f"{0.001 * v:g}" for vertex in vertices for v in vertex)
    corners = " ".join(str(k) for face in faces for k in face)
    return f'<mesh name="{name}" vertex="{text}" face="{corners}"/>'


@pytest.mark.parametrize("mesh", [u_bracket(), u_bracket(leave_out=2), u_bracket(inwards=True)])
@pytest.mark.parametrize("turned", ["1 0 0 0", "0 1 0 0"])
def test_a_bracket_rests_on_its_hull(tmp_path, mesh, turned):
    """Also on the opening of the U, with nothing visible there; open and inward meshes have the same hull."""
    load = f'<geom type="mesh" mesh="u" mass="1" quat="{turned}"/>'
    body = scene(tmp_path, load, assets=mesh)
    assert felt_n(body, 1.0) == pytest.approx(WEIGHT_N, rel=0.01)
    assert body.data.ncon == 0


def test_a_mesh_presses_where_its_hull_begins_and_not_before(tmp_path):
    """An inward mesh pressed at a distance when rays met its back faces."""
    load = '<geom type="mesh" mesh="u" mass="1"/>'
    body = scene(tmp_path, load, half_m=0.03, assets=u_bracket(inwards=True))
    body.advance(1_000_000)
    assert body.stimulus()[:, :3].sum() == 0.0


def mesh_model(mesh: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset>{mesh}</asset><worldbody><geom type="mesh" mesh="u"/></worldbody></mujoco>'
    )


def test_gap_between_hull_and_mesh_is_that_in_the_middle_of_the_opening():
    """The opening is 50 mm wide and 35 mm deep: its middle is 25 mm from the edges."""
    gap_m = hull_gap_m(mesh_model(u_bracket()), 0)
    assert gap_m == pytest.approx(0.025, abs=0.001)
    ball = mujoco.MjSpec()
    mesh = ball.add_mesh(name="ball")
    mesh.make_sphere(subdivision=3)
    ball.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ball")
    assert hull_gap_m(ball.compile(), 0) < 1e-5


def test_gap_of_a_notch_between_long_triangles():
    """A notch 20 mm wide and 30 mm deep: to its sides, from the middle, 300 / √(10² + 30²) mm."""
    length_mm = 400
    outline = [(-30, 0), (30, 0), (30, 40), (10, 40), (0, 10), (-10, 40), (-30, 40)]
    vertices = [(x, y, z) for y in (-0.5 * length_mm, 0.5 * length_mm) for x, z in outline]
    faces = [(k, (k + 1) % 7, 7 + (k + 1) % 7) for k in range(7)] + [
        (k, 7 + (k + 1) % 7, 7 + k) for k in range(7)
    ]
    caps = [(0, 1, 4), (1, 3, 4), (1, 2, 3), (0, 4, 5), (0, 5, 6)]
    faces += [tuple(reversed(cap)) for cap in caps] + [tuple(7 + k for k in cap) for cap in caps]
    text = " ".join(f"{0.001 * v:g}" for vertex in vertices for v in vertex)
    corners = " ".join(str(k) for face in faces for k in face)
    model = mesh_model(f'<mesh name="u" vertex="{text}" face="{corners}"/>')
    assert open_edges(model, 0) == 0
    assert hull_gap_m(model, 0) == pytest.approx(0.3 / math.sqrt(1000.0), abs=0.001)


def surface_points_m(corner_m, count, random):
    """Points (count, 3) all over triangles (t, 3, 3)."""
    area = np.linalg.norm(np.cross(corner_m[:, 1] - corner_m[:, 0], corner_m[:, 2] - corner_m[:, 0]), axis=1)
    triangle = random.choice(len(corner_m), size=count, p=area / area.sum())
    weight = random.dirichlet(np.ones(3), size=count)
    return np.einsum("sk,skx->sx", weight, corner_m[triangle])


@pytest.mark.parametrize(("seed", "subdivision"), [(0, 1), (1, 0)])
def test_gap_of_a_jagged_mesh_is_that_of_points_all_over_it(seed, subdivision):
    """Against a cloud of points on hull and mesh, of an icosphere whose corners were moved in and out."""
    random, spec = np.random.default_rng(seed), mujoco.MjSpec()
    spec.add_mesh(name="u").make_sphere(subdivision=subdivision)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="u")
    ball = spec.compile()
    vertex = ball.mesh_vert * random.uniform(0.01, 0.1, size=(len(ball.mesh_vert), 1))
    text, corners = (" ".join(map(str, values.ravel().tolist())) for values in (vertex, ball.mesh_face))
    model = mesh_model(f'<mesh name="u" vertex="{text}" face="{corners}"/>')
    vertex_m = model.mesh_vert.astype(np.float64)
    mesh_m = surface_points_m(vertex_m[model.mesh_face], 60_000, random)
    hull = ConvexHull(vertex_m)
    hull_m = surface_points_m(hull.points[hull.simplices], 30_000, random)
    expected_m = cKDTree(mesh_m).query(hull_m)[0].max()
    assert hull_gap_m(model, 0) == pytest.approx(expected_m, abs=0.0015)


def test_open_and_inward_meshes_are_known():
    assert open_edges(mesh_model(u_bracket()), 0) == 0
    assert open_edges(mesh_model(u_bracket(leave_out=2)), 0) == 4
    assert [is_inward(mesh_model(u_bracket(inwards=inwards)), 0) for inwards in (False, True)] == [
        False,
        True,
    ]


CLOTH = (
    '<flexcomp name="cloth" type="grid" count="4 4 1" spacing="0.05 0.05 0.05" pos="0 0 1" mass="0.5" '
    'dim="2" radius="0.01"><contact {}/><edge equality="true"/></flexcomp>'
)


def test_flexes_that_can_touch_skin_are_refused_by_name(tmp_path):
    with pytest.raises(ModelError, match=r'^flex "cloth" can touch skin.*contype and conaffinity') as refused:
        scene(tmp_path, more=CLOTH.format(""))
    assert "\n" not in str(refused.value)
    scene(tmp_path, more=CLOTH.format('contype="2" conaffinity="4"'))


@pytest.mark.parametrize(("masks", "refused"), [("", True), ('contype="0" conaffinity="0"', False)])
def test_height_fields_are_refused_where_skin_can_touch_them(tmp_path, masks, refused):
    hills = '<hfield name="h" nrow="4" ncol="4" size="1 1 1 1"/>'
    more = f'<geom name="hills" type="hfield" hfield="h" pos="0 0 -9" {masks}/>'
    if not refused:
        scene(tmp_path, assets=hills, more=more)
        return
    with pytest.raises(ModelError, match=r"hills.*hfield.*visual"):
        scene(tmp_path, assets=hills, more=more)


def test_the_finger_is_felt_whatever_the_masks(tmp_path):
    body = scene(tmp_path, plate='contype="0" conaffinity="0"')
    names = [body.model.mj.body(int(b)).name for b in body.cell_foundation.scene.body_id]
    felt = np.array(names)[body.cell_foundation.scene.collides[0]]
    assert list(felt) == ["teacher_finger"]
