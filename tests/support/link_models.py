"""Small models of single links and pairs of links, for tests of covering."""

import math
from pathlib import Path

import mujoco
import numpy as np

from skinnet.covering.felt_solids import link_of_body
from skinnet.covering.link_covering import CellSize, LinkGround, prepare_ground
from skinnet.deployment.skin.covers import CoverSpec

SIDE_M = 0.014
PITCH_M = math.sqrt(3.0) * SIDE_M
SIZE = CellSize(SIDE_M, PITCH_M, 0.012)

BOX = '<geom type="box" size=".05 .05 .05"/>'
SMALL_CUBE = '<geom type="box" size=".02 .02 .02"/>'
PLATE = '<geom type="box" size=".06 .06 .005"/>'
SPHERE = '<geom type="sphere" size=".06"/>'
CAPSULE = '<geom type="capsule" size=".05 .1"/>'
CYLINDER = '<geom type="cylinder" size=".04 .1"/>'
TEE = '<geom type="cylinder" size=".04 .1"/><geom type="box" pos=".09 0 0" size=".06 .03 .03"/>'
"""A cylinder that a box goes into."""


def hull_of_points(n: int = 150, scale: tuple[float, float, float] = (0.05, 0.06, 0.11)) -> tuple[str, str]:
    """Assets and geom of a mesh whose hull is an ellipsoid of `n` corners."""
    i = np.arange(n) + 0.5
    z, turn = 1.0 - 2.0 * i / n, i * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    points = np.column_stack([across * np.cos(turn), across * np.sin(turn), z]) * scale
    text = " ".join(f"{value:.6f}" for value in points.ravel())
    return f'<asset><mesh name="m" vertex="{text}"/></asset>', '<geom type="mesh" mesh="m"/>'


def model_of(geoms: str, asset: str = "", joint: str = "") -> mujoco.MjModel:
    """A body `link` with `geoms`."""
    return mujoco.MjModel.from_xml_string(
        f'<mujoco>{asset}<worldbody><body name="link">{joint}{geoms}</body></worldbody></mujoco>'
    )


def ground_of(
    mj: mujoco.MjModel, body: str = "link", home_qpos: np.ndarray | None = None, **cover: object
) -> LinkGround:
    """What a cover of `body` asks for."""
    home_qpos = mj.qpos0 if home_qpos is None else home_qpos
    spec = CoverSpec(name="c", body=body, **cover)  # type: ignore[arg-type]
    return prepare_ground(mj, link_of_body(mj, mj.body(body).id), body, spec, SIZE, home_qpos)


TWO_LINKS = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="base">
      <geom name="pedestal" type="box" size=".06 .06 .06" mass="5"/>
      <body name="upper" pos="0 0 .08">
        <joint name="shoulder" axis="0 1 0" range="-1.2 1.2" limited="true"/>
        <geom name="arm" type="capsule" size=".045" fromto="0 0 .05 0 0 .3" mass="2"/>
        <body name="bracket" pos="0 0 .3">
          <geom name="bracket" type="box" size=".03 .03 .03" mass=".2"/></body>
        <body name="fore" pos="0 0 .36">
          <joint name="elbow" axis="0 1 0" range="-1.5 1.5" limited="true"/>
          <geom name="forearm" type="cylinder" size=".04 .1" pos="0 0 .12" mass="1"/>
          <geom name="shell" type="box" size=".05 .05 .05" contype="0" conaffinity="0" mass=".1"/>
          <body name="needle" pos="0 0 .22"><joint name="wrist" axis="0 0 1"/>
            <geom name="needle" type="capsule" size=".004" fromto="0 0 .02 0 0 .05" mass=".1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def write_two_links(folder: Path, cover: str) -> Path:
    """Write a deployment of the two links with the lines of `cover`; return its file."""
    (folder / "two.xml").write_text(TWO_LINKS, encoding="utf-8")
    file = folder / "two.toml"
    file.write_text(
        'format = 2\nname = "two"\nrobot = "two"\n'
        '[body]\nmodel = "two.xml"\nreference_body = "base"\njoints = ["shoulder", "elbow"]\n'
        '[controller]\nprogram = ["home"]\n[controller.stages]\nhome = { kind = "posture" }\n' + cover,
        encoding="utf-8",
    )
    return file
