"""Cost of a physics step of the body, by its parts: measured time of this computer, not simulated time."""

import time
from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

from skinnet.body.simulation import BodySimulation
from skinnet.clock import NS_PER_S

__all__ = ["StepCost", "measure_step_cost"]

_N_STEPS = 40
_N_SAMPLES = 5


class StepCost(NamedTuple):
    """Cost of body and sensing of one simulated second [s], by part; medians of some steps.

    Attributes:
        collision_s: Kinematics and collisions of MuJoCo.
        skin_contact_s: Contact of the skin.
        dynamics_s: The rest of MuJoCo's step.
        sensing_s: Stimulus of all cells, per stimulus period.
    """

    collision_s: float
    skin_contact_s: float
    dynamics_s: float
    sensing_s: float


def measure_step_cost(body: BodySimulation, stimulus_period_ns: int) -> StepCost:
    """Measure the CPU time of physics and stimulus in the present state; advances `body` by some steps.

    CPU time, as other work on the computer takes time too.
    """
    dynamics, mj, data = body.dynamics, body.model.mj, body.data
    step_ns = round(dynamics.step_s * NS_PER_S)
    sensing_s = []
    for _ in range(_N_SAMPLES):
        body.advance(body.t_ns + step_ns)
        body.pressures()
        sensing_s.append(_duration_s(body.stimulus))
    spent = np.zeros((_N_STEPS, 4))
    for row in spent:
        row[0] = _duration_s(lambda: mujoco.mj_fwdPosition(mj, data))
        row[1] = _duration_s(dynamics.compute_contact)
        row[2] = _duration_s(dynamics.compute_accelerations)
        row[3] = _duration_s(dynamics.integrate)
    position_s, contact_s, acceleration_s, integration_s = np.median(spent, axis=0).tolist()
    per_s = 1.0 / dynamics.step_s
    return StepCost(
        collision_s=per_s * position_s,
        skin_contact_s=per_s * max(contact_s - position_s, 0.0),
        dynamics_s=per_s * (acceleration_s + integration_s),
        sensing_s=float(np.median(sensing_s)) * NS_PER_S / stimulus_period_ns,
    )


def _duration_s(function: Callable[[], object]) -> float:
    start_s = time.process_time()
    function()
    return time.process_time() - start_s
