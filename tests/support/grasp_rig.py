"""Two flat paddles with skin that close on an object on a stand: small, and with forces in closed form."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from body_scenes import deployment_of

from skinnet.body.simulation import BodySimulation
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.environment.objects import OBJECTS, ObjectName
from skinnet.deployment.skin.patches import InterfaceSpec, LatticeSpec, PatchSpec

S = 1_000_000_000
MS = 1_000_000
CELLS_M2 = 4 * 1.5 * 3.0**0.5 * 0.014**2
"""Area of the four cells of a paddle."""
FOAM_PA_PER_M = 1.5e6
_APART_M = 0.9
"""Distance between the rigid faces of the two paddles in the beginning."""
_CLOSING_M_S = 0.4
_AT_X_M = 0.4
_RIG = """
<mujoco>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="base" pos="0 0 0.2">
      <geom type="box" size="0.05 0.05 0.05" mass="5"/>
    </body>
    <body name="left" pos="0.4 0.47 1.07">
      <joint name="left" type="slide" axis="0 -1 0"/>
      {left}
      <geom name="bare" type="box" size="0.01 0.02 0.03" pos="0 {bare_m} 0" mass="0.001"/>
    </body>
    <body name="right" pos="0.4 -0.47 1.07">
      <joint name="right" type="slide" axis="0 1 0"/>
      <geom name="right" type="box" size="0.10 0.02 0.04" mass="5"/>
    </body>
  </worldbody>
</mujoco>
"""
_FLAT = '<geom name="left" type="box" size="0.10 0.02 0.04" mass="5"/>'
_ROUND = '<geom name="left" type="cylinder" size="0.04 0.10" pos="0 0.02 0" euler="0 90 0" mass="5"/>'
_SERVO = {"kp_nm_per_rad": 1e6, "kv_nm_s_per_rad": 4e3, "torque_limit_nm": 1e5}
"""So stiff that a paddle is where it is told to be (N/m)."""


def _paddle(name: str, inwards: float) -> PatchSpec:
    origin_m, normal = (0.0, 0.02 * inwards, 0.0), (0.0, inwards, 0.0)
    lattice = LatticeSpec(columns=2, rows=2, origin_m=origin_m, normal=normal, up=(0.0, 0.0, 1.0))
    return PatchSpec(name=name, body=name, lattice=lattice, interfaces=(InterfaceSpec(cell=0, port=2),))


def rig_deployment(thing: ObjectName = "delivery_box", seed: int = 1, **stand: Any) -> Deployment:
    """The rig with an object between the paddles, the middle of which lies at x = 0.4 m."""
    scene = deployment_of((_paddle("left", -1.0), _paddle("right", 1.0)), ("left", "right"), servo=_SERVO)
    depth_m, nearer_m = (
        (0.3, 0.0) if thing == "none" else (OBJECTS[thing].size_m[0], OBJECTS[thing].shift_to_robot_m)
    )
    defaults = {
        "object_face_x_m": _AT_X_M - 0.5 * depth_m + nearer_m,
        "plate_edge_x_m": 0.25,
        "lower_stage": "hold",
    }
    keys = {"object": thing, "seed": seed, "stand": defaults | stand}
    return msgspec.convert(msgspec.to_builtins(scene) | keys, Deployment)


def rig(
    folder: Path,
    thing: ObjectName = "delivery_box",
    bare_m: float = 0.01,
    round_link: bool = False,
    **stand: Any,
) -> BodySimulation:
    """The body of the rig.

    With `bare_m` below -0.012 a bare block stands out from the left paddle's foam; with `round_link` the link
    under that foam is a cylinder.
    """
    (folder / "scene.xml").write_text(_RIG.format(bare_m=bare_m, left=_ROUND if round_link else _FLAT))
    return BodySimulation(rig_deployment(thing, **stand), folder)


def close(body: BodySimulation, overlap_m: float, width_m: float) -> None:
    """Closes both paddles until each lies `overlap_m` deep in an object of `width_m`, and waits."""
    way_m = 0.5 * (_APART_M - width_m) - body.thickness_m + overlap_m
    for share, speed_m_s in ((0.9, _CLOSING_M_S), (0.1, 0.1 * _CLOSING_M_S)):
        steps = round(share * way_m / (speed_m_s * 1e-3))
        body.set_command(np.full(2, share * way_m / (steps * 1e-3)))
        body.advance(body.t_ns + steps * MS)
    body.set_command(np.zeros(2))
    body.advance(body.t_ns + 300 * MS)
