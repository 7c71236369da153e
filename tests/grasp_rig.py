"""Two flat paddles with skin that close on an object on a stand: small, and with forces in closed form."""

from pathlib import Path

import msgspec
import numpy as np
from body_scenes import deployment_of

from skinnet.body.simulation import Body
from skinnet.deployment.schema import Deployment, InterfaceSpec, LatticeSpec, PatchSpec
from skinnet.deployment.stand import StandSpec
from skinnet.deployment.things import ObjectName

S = 1_000_000_000
MS = 1_000_000
CELL_M2 = 1.5 * 3.0**0.5 * 0.014**2
PADDLES_M = 0.5
"""Distance between the rigid faces of the two paddles in the beginning."""
RIG = """
<mujoco>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="base" pos="0 0 0.2">
      <geom type="box" size="0.05 0.05 0.05" mass="5"/>
    </body>
    <body name="left" pos="0.4 0.27 1.07">
      <joint name="left" type="slide" axis="0 -1 0"/>
      <geom name="left" type="box" size="0.10 0.02 0.04" mass="5"/>
      <geom name="bare" type="box" size="0.01 0.02 0.04" pos="0 {bare} 0" mass="0.001"/>
    </body>
    <body name="right" pos="0.4 -0.27 1.07">
      <joint name="right" type="slide" axis="0 1 0"/>
      <geom name="right" type="box" size="0.10 0.02 0.04" mass="5"/>
    </body>
  </worldbody>
</mujoco>
"""
"""The bare geom is out of the way unless it stands out towards the object."""
SERVO = {"kp_nm_per_rad": 1e6, "kv_nm_s_per_rad": 4e3, "torque_limit_nm": 1e5}
"""So stiff that a paddle is where it is told to be, in N/m."""


def paddle_patch(name: str, inwards: float) -> PatchSpec:
    lattice = LatticeSpec(
        columns=2, rows=2, origin_m=(0.0, 0.02 * inwards, 0.0), normal=(0.0, inwards, 0.0), up=(0.0, 0.0, 1.0)
    )
    return PatchSpec(name=name, body=name, lattice=lattice, interfaces=(InterfaceSpec(cell=0, port=2),))


def rig_deployment(
    thing: ObjectName = "delivery_box", foam: dict | None = None, **stand: object
) -> Deployment:
    """The rig with an object between the paddles."""
    patches = (paddle_patch("left", -1.0), paddle_patch("right", 1.0))
    deployment = deployment_of(patches, ("left", "right"), servo=SERVO, foam=foam or {})
    spec = StandSpec(**{"near_x_m": 0.27, "lower_stage": "hold", "lower_s": 0.1, "speed_m_s": 0.5, **stand})
    return msgspec.convert(
        msgspec.to_builtins(msgspec.structs.replace(deployment, object=thing, stand=spec)), Deployment
    )


def rig(folder: Path, *args: str, bare: float = 0.0, **kwargs: object) -> Body:
    (folder / "scene.xml").write_text(RIG.format(bare=bare))
    return Body(rig_deployment(*args, **kwargs), folder)


def close(body: Body, overlap_m: float, width_m: float, speed_m_s: float = 0.1) -> None:
    """Closes both paddles until each lies `overlap_m` deep in an object of `width_m`."""
    way_m = 0.5 * (PADDLES_M - width_m) - body.thickness_m + overlap_m
    steps = round(way_m / (speed_m_s * 1e-3))
    body.set_command(np.full(2, way_m / (steps * 1e-3)))
    body.advance(body.t_ns + steps * MS)
    body.set_command(np.zeros(2))
    body.advance(body.t_ns + 300 * MS)
