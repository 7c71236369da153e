"""Energy of passive scenes with foam: it must never grow."""

import mujoco
import numpy as np

from skinnet.body.simulation import BodySimulation


def energies_j(body: BodySimulation, duration_s: float) -> np.ndarray:
    """Energy of all bodies and of the foam [J], every step."""
    mj, data, found = body.model.mj, body.data, []
    step_ns = round(body.dynamics.step_s * 1e9)
    for _ in range(round(duration_s / body.dynamics.step_s)):
        body.ground_truth()  # evaluates the present state
        mujoco.mj_energyPos(mj, data)
        mujoco.mj_energyVel(mj, data)
        found.append(float(data.energy.sum()) + body.dynamics.elastic_energy_j)
        body.advance(body.t_ns + step_ns)
    return np.array(found)


def worst_ratio(energy_j: np.ndarray) -> float:
    """Largest later energy, as a fraction of that at the start, above the least."""
    return float((energy_j.max() - energy_j.min()) / (energy_j[0] - energy_j.min()))


def check(energy_j: np.ndarray) -> None:
    """Assert that energy stays within 1 % of its start and has no trend."""
    assert np.isfinite(energy_j).all()
    assert worst_ratio(energy_j) <= 1.01
    late = energy_j[len(energy_j) // 2 :]
    assert late.max() - energy_j.min() <= 1.01 * (energy_j[: len(late)].max() - energy_j.min()), "no trend"
