"""Findings on filters, margins and meshes: what they say."""

import body_scenes
import pytest

from skinnet.diagnosis.felt_geometry import felt_geometry_findings

SCENE = """
<mujoco>
  <asset><mesh name="roof" vertex="0 0 0  0.2 0 0  0.2 0.2 0  0 0.2 0  0.1 0.1 0.1" face="{face}"/></asset>
  <worldbody>
    <body name="base">
      <joint name="turn" axis="0 0 1"/>
      <geom name="plate" type="box" size="0.12 0.12 0.02" pos="0 0 -0.02" mass="50" {plate}/>
    </body>
    <body name="load" pos="0 0 1"><freejoint/><geom type="mesh" mesh="roof" mass="1"/></body>
  </worldbody>
  {rest}
</mujoco>
"""
CLOSED = "0 2 1 0 3 2 0 1 4 1 2 4 2 3 4 3 0 4"


def notices(folder, *, face=CLOSED, plate="", rest="") -> list[str]:
    (folder / "scene.xml").write_text(SCENE.format(face=face, plate=plate, rest=rest))
    skin = (body_scenes.lattice_patch("skin", "base", 3, 3),)
    found = felt_geometry_findings(body_scenes.deployment_of(skin, ("turn",)), folder)
    return [f"{finding.subject}: {finding.text}" for finding in found]


def test_a_convex_mesh_has_no_gap(tmp_path):
    assert notices(tmp_path) == []


def test_open_and_inward_meshes_are_named(tmp_path):
    open_mesh = notices(tmp_path, face=CLOSED.removesuffix(" 3 0 4"))
    assert open_mesh[1:] == ['mesh "roof": it is open, 3 edges lack a second face; its convex hull is felt']
    assert float(open_mesh[0].split("at most ")[1].split(" mm")[0]) > 10.0
    inwards = " ".join(reversed(CLOSED.split()))
    assert notices(tmp_path, face=inwards) == [
        'mesh "roof": its faces are inwards (negative volume); its convex hull is felt'
    ]


def test_margins_that_were_cleared_are_listed(tmp_path):
    (line,) = notices(tmp_path, plate='margin="0.02" gap="0.001"')
    assert "set to 0" in line
    assert line.endswith(': geom "plate" (margin 20 mm, gap 1 mm)')


@pytest.mark.parametrize(
    ("plate", "rest", "told"),
    [
        ('contype="0" conaffinity="0"', "", 'body "base": no geom of it can collide'),
        ("", '<option><flag contact="disable"/></option>', "model: it disables contacts"),
    ],
)
def test_skin_that_nothing_can_touch_is_named(tmp_path, plate, rest, told):
    assert notices(tmp_path, plate=plate, rest=rest)[0].startswith(told)
    assert all("mesh" not in line for line in notices(tmp_path, plate=plate, rest=rest))
