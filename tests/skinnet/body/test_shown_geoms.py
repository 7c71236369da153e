"""What pictures show of a model: every surface once, of every body something."""

import body_scenes
import matplotlib.image
import mujoco
import numpy as np

from skinnet.body.rendering import render_body
from skinnet.body.shown_geoms import felt_geoms, shown_geoms
from skinnet.body.visual_shapes import VisualModel

MODEL = """
<mujoco>
  <asset>
    <mesh name="cube" vertex="-.1 -.1 -.1  .1 -.1 -.1  -.1 .1 -.1  .1 .1 -.1
                              -.1 -.1 .1  .1 -.1 .1  -.1 .1 .1  .1 .1 .1"/>
    <mesh name="badge" scale="0.1 0.1 0.1" vertex="-.1 -.1 -.1  .1 -.1 -.1  -.1 .1 -.1  .1 .1 -.1
                              -.1 -.1 .1  .1 -.1 .1  -.1 .1 .1  .1 .1 .1"/>
  </asset>
  <default>
    <geom rgba="0.9 0.1 0.1 1"/>
    <default class="visual"><geom contype="0" conaffinity="0" group="1"/></default>
  </default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom name="felt_twice" type="box" size="0.1 0.1 0.1"/>
      <geom name="seen" class="visual" type="mesh" mesh="cube"/>
      <body name="plain" pos="0 0 0.3">
        <joint name="turn" axis="0 0 1"/>
        <geom name="felt_once" type="box" size="0.1 0.1 0.1"/>
        <geom name="detail" class="visual" type="mesh" mesh="badge" pos="0.1 0 0"/>
        <geom name="stripe" class="visual" type="box" size="0.101 0.101 0.02"/>
      </body>
      <body name="hidden" pos="0 0 0.6"><geom name="felt_only" size="0.1" group="3"/></body>
      <body name="ghost" pos="0 0 0.9">
        <geom name="far" size="0.1" group="3"/><geom name="near" class="visual" size="0.1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_every_surface_is_shown_once(tmp_path):
    mj = mujoco.MjModel.from_xml_string(MODEL)
    shown = {mj.geom(geom).name for geom in np.flatnonzero(shown_geoms(mj))}
    assert shown == {"seen", "felt_once", "detail", "stripe", "felt_only", "near"}
    felt = {mj.geom(geom).name for geom in np.flatnonzero(felt_geoms(mj))}
    assert felt == {"felt_twice", "felt_once", "felt_only", "far"}


def test_viewers_get_the_same_and_felt_geometry_on_demand(tmp_path):
    (tmp_path / "scene.xml").write_text(MODEL)
    deployment = body_scenes.deployment_of((), ("turn",))
    model, finger = VisualModel(deployment, tmp_path), 2
    assert len(model.shapes) == 6 + finger
    assert len(model.felt_shapes) == 4 + finger - 1, "the finger's tip is felt, its shaft is not"


def test_a_model_without_lights_is_lit(tmp_path):
    """The red robot is about as bright with a light of its own as with none, before a bright sky."""
    light = '<worldbody><light directional="true" dir="-0.5 0.3 -0.8" castshadow="false"/>'
    brightness = []
    for mjcf in (MODEL, MODEL.replace("<worldbody>", light)):
        (tmp_path / "scene.xml").write_text(mjcf)
        deployment = body_scenes.deployment_of((), ("turn",))
        out = tmp_path / f"{len(brightness)}.png"
        file, why = render_body(deployment, tmp_path, out, [], size=(160, 120))
        if file is None:
            assert why.startswith("no picture")
            return
        image = matplotlib.image.imread(file)[:, :, :3]
        red = image[:, :, 0] > 2.0 * image[:, :, 2]
        brightness.append(float(image[red][:, 0].mean()))
        assert image[~red].mean() > 0.6
    assert brightness[0] > 0.8 * brightness[1]
    assert brightness[0] > 0.4
