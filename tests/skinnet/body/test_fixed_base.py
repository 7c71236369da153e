"""Bases: free, fixed by the deployment, or none at all where the world is the reference."""

import body_scenes
import mujoco
import numpy as np
import pytest

from skinnet.body.link_kinematics import LinkKinematics
from skinnet.body.model import load_model
from skinnet.errors import ModelError

WALKER = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body name="trunk" pos="0 0 0.7" euler="0.1 0 0.3">
      {free}
      <geom type="box" size="0.2 0.1 0.05" mass="5"/>
      <body name="leg" pos="0 0 -0.1">
        <joint name="hip" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="1"/>
      </body>
    </body>
    <body name="ball" pos="1 0 0.1"><freejoint/><geom size="0.1" mass="0.2"/></body>
  </worldbody>
  <sensor>{sensor}</sensor>
  <keyframe><key name="stand" qpos="0 0 0.3 1 0 0 0 0.2 1 0 0.1 1 0 0 0"/></keyframe>
</mujoco>
"""


def deployment(folder, *, free="<freejoint/>", sensor="", **body):
    (folder / "scene.xml").write_text(WALKER.format(free=free, sensor=sensor))
    keys = {"reference_body": "trunk", **body}
    return body_scenes.deployment_of((), ("hip",), **keys)


@pytest.mark.parametrize(
    "free", ["<freejoint/>", '<freejoint name="root"/>', '<joint type="free" name="root"/>']
)
def test_a_fixed_base_stands_where_the_file_draws_it(tmp_path, free):
    model = load_model(deployment(tmp_path, free=free, fixed_base=True), tmp_path)
    left = [line for line in model.left_out if "fixed_base" in line]
    assert len(left) == 1
    assert left[0].startswith('free joint "')
    assert 'of "trunk"' in left[0]
    data = mujoco.MjData(model.mj)
    data.qpos[:] = model.home_qpos
    data.ctrl[:] = 0.0
    for _ in range(300):
        mujoco.mj_step(model.mj, data)
    trunk = model.mj.body("trunk").id
    assert data.xpos[trunk].tolist() == [0.0, 0.0, 0.7]
    drawn = mujoco.MjModel.from_xml_string(WALKER.format(free=free, sensor=""))
    np.testing.assert_array_equal(data.xquat[trunk], drawn.qpos0[3:7])
    assert data.xpos[model.mj.body("ball").id][2] < 0.11, "other free bodies stay free"
    assert model.mj.nv == 7


def test_a_free_base_stays_free_unless_it_is_fixed(tmp_path):
    model = load_model(deployment(tmp_path), tmp_path)
    assert model.mj.nv == 13
    assert not any("free joint" in line for line in model.left_out)


def test_a_base_that_is_fixed_already_loses_nothing(tmp_path):
    model = load_model(deployment(tmp_path, free="", fixed_base=True), tmp_path)
    assert not any("free joint" in line for line in model.left_out)


def test_what_refers_to_the_free_joint_goes_with_it(tmp_path):
    sensor = '<user name="seen" objtype="joint" objname="root" dim="1" needstage="pos" datatype="real"/>'
    free = '<freejoint name="root"/>'
    model = load_model(deployment(tmp_path, free=free, sensor=sensor, fixed_base=True), tmp_path)
    assert model.mj.nsensor == 0
    assert any(line.startswith('sensor "seen"') for line in model.left_out)


def test_the_world_may_be_the_reference(tmp_path):
    """A robot whose first body moves is bolted to the world, which no free joint can carry."""
    spec = deployment(tmp_path, reference_body="world", fixed_base=True)
    assert load_model(spec, tmp_path).mj.nv == 7, "the base of the controlled joint is fixed"
    names = LinkKinematics(spec, tmp_path).names
    assert names == ["trunk", "leg"]
    with pytest.raises(ModelError, match=r'reference_body = "world2": .*did you mean world\?'):
        load_model(deployment(tmp_path, reference_body="world2"), tmp_path)
