"""The release of the payload does not depend on the physics step (its path: test_step_convergence)."""

import math

import msgspec
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
SPEC = PayloadSpec(position_m=(0, 0, 0), closing_joints={}, release_delay_s=0.0, release_ramp_s=1.0)


def speed_after(step_ms: float, duration_ms: int, **times_s: float) -> float:
    """Speed left of 1 m/s after a time of release, without any force."""
    data = mujoco.MjData(mujoco.MjModel.from_xml_string(SCENE))
    spec = msgspec.structs.replace(SPEC, **times_s)
    payload = Payload(data, spec, step_ms * 1e-3)
    payload.begin_stage(spec.release_stage, 0)
    data.qvel[0] = 1.0
    for step in range(round(duration_ms / step_ms)):
        t_ns = round((step + 1) * step_ms * 1e6)
        if payload.is_free(t_ns):  # what is fixed stays at rest, which is of no interest here
            payload.update(t_ns)
    return float(data.qvel[0])


@pytest.mark.parametrize(("step_ms", "t_ms"), [(1.0, 7), (2.0, 8), (4.0, 8)])
def test_a_release_between_two_steps_damps_for_its_time_only(step_ms: float, t_ms: int) -> None:
    """Released at 0.5 ms for 5 ms: whatever the step, that is the time in which the payload is damped."""
    damped = speed_after(step_ms, t_ms, release_delay_s=0.5e-3, release_ramp_s=5e-3)
    assert damped == pytest.approx(math.exp(-105.36e-3 * 5), rel=1e-9)


@pytest.mark.parametrize("step_ms", [0.5, 2.0])
def test_a_released_payload_moves_at_its_velocity(step_ms: float) -> None:
    """Pose and velocity belong together, as foam sees the velocity only: a step moves by its last one."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    model.opt.timestep = step_ms * 1e-3
    data = mujoco.MjData(model)
    payload = Payload(data, SPEC, step_ms * 1e-3)
    payload.begin_stage(SPEC.release_stage, 0)
    data.qvel[:] = (1.0, -0.5, 0.2, 2.0, 3.0, -1.0)
    for step in range(5):
        before = data.qpos.copy()
        mujoco.mj_step(model, data)
        payload.update(round((step + 1) * step_ms * 1e6))
        mujoco.mj_integratePos(model, before, data.qvel, step_ms * 1e-3)
        assert data.qpos == pytest.approx(before, abs=1e-15)


@pytest.mark.parametrize("step_ms", [0.125, 0.25, 0.5, 1.0, 2.0])
def test_a_released_payload_slows_down_at_a_rate(step_ms: float) -> None:
    speeds = np.array([speed_after(step_ms, t_ms) for t_ms in (2, 10, 20)])
    assert speeds == pytest.approx([math.exp(-105.36e-3 * t_ms) for t_ms in (2, 10, 20)], rel=1e-9)
