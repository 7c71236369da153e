"""Roll-out of a small MuJoCo model, as a sample of the arithmetic of MuJoCo on this computer."""

import mujoco

__all__ = ["roll_out"]

_MODEL = """
<mujoco>
  <option integrator="implicitfast" timestep="0.001"/>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 .5"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
      <body pos=".3 0 0"><joint axis="1 .3 0"/><geom type="box" size=".1 .04 .03" pos=".1 0 0"/></body>
    </body>
    <body pos=".5 .5 .3"><freejoint/><geom type="ellipsoid" size=".05 .04 .03"/></body>
  </worldbody>
</mujoco>
"""
_STEPS = 300


def roll_out() -> bytes:
    """Return the bytes of the state after 300 steps of two joints and a free body that falls on a plane."""
    model = mujoco.MjModel.from_xml_string(_MODEL)
    data = mujoco.MjData(model)
    data.qpos[:2] = 0.3, 0.2
    data.qvel[-3:] = 1.0, 2.0, 3.0
    for _ in range(_STEPS):
        mujoco.mj_step(model, data)
    return bytes(data.qpos.tobytes() + data.qvel.tobytes() + mujoco.mj_versionString().encode())
