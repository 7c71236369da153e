"""The release of the payload does not depend on the physics step."""

import math

import mujoco
import numpy as np
import pytest

from skinnet.body.environment.payload import Payload
from skinnet.body.model import PAYLOAD
from skinnet.deployment.environment.payload import PayloadSpec

SCENE = f"""
<mujoco>
  <worldbody>
    <body name="{PAYLOAD}"><freejoint name="{PAYLOAD}"/><geom type="sphere" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""


def speed_after(step_ms: float, duration_ms: int) -> float:
    """Speed left of 1 m/s after a time of release, without any force."""
    data = mujoco.MjData(mujoco.MjModel.from_xml_string(SCENE))
    spec = PayloadSpec(position_m=(0, 0, 0), closing_joints={}, release_delay_s=0.0, release_ramp_s=1.0)
    payload = Payload(data, spec, step_ms * 1e-3)
    payload.begin_stage(spec.release_stage, 0)
    data.qvel[0] = 1.0
    for step in range(round(duration_ms / step_ms)):
        payload.update(round((step + 1) * step_ms * 1e6))
    return float(data.qvel[0])


@pytest.mark.parametrize("step_ms", [0.125, 0.25, 0.5, 1.0, 2.0])
def test_a_released_payload_slows_down_at_a_rate(step_ms: float) -> None:
    speeds = np.array([speed_after(step_ms, t_ms) for t_ms in (2, 10, 20)])
    assert speeds == pytest.approx([math.exp(-105.36e-3 * t_ms) for t_ms in (2, 10, 20)], rel=1e-9)
