"""Settling of a body: physics and servos at home, without network, and what comes of it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model_file import gravity_m_s2
from skinnet.body.simulation import BodySimulation
from skinnet.clock import NS_PER_S
from skinnet.deployment import Deployment
from skinnet.errors import ModelError

__all__ = ["Settled", "settle"]

Floats = NDArray[np.float64]

_AVERAGED_NS = NS_PER_S // 10
"""Forces are averaged over the end of the time: of this length."""


@dataclass(frozen=True)
class Settled:
    """Outcome of a settling.

    Attributes:
        metrics: By name, see `settle`.
        force_n: (n_cells,) normal force on each cell, mean of the last 0.1 s [N].
        patch_body_force_n: (p, nbody) normal force of each patch on each body, likewise [N].
        start_qpos: (nq,) configuration at the start.
        end_qpos: (nq,) configuration at the end.
        first_speed_rad_s: (D,) largest speed of each controlled joint in the first third of the time.
        last_speed_rad_s: (D,) that in the last third.
        n_reversals: (D,) changes of the direction of motion in the last third.
    """

    metrics: dict[str, Any]
    force_n: Floats
    patch_body_force_n: Floats
    start_qpos: Floats
    end_qpos: Floats
    first_speed_rad_s: Floats
    last_speed_rad_s: Floats
    n_reversals: NDArray[np.int64]


def settle(
    simulation: BodySimulation,
    deployment: Deployment,
    duration_ns: int,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> Settled:
    """Simulate body and servos at home for `duration_ns` [ns], whole physics steps.

    The metrics are, by name: `settle.force_n.<patch or sheet>`, the sum of normal forces, mean of the last
    0.1 s [N]; `settle.unsensed_n`, the load of the rigid shell under skin (`UnsensedForce`), likewise;
    `settle.peak_unsensed_n`; `settle.rise_mm.<free body>`, the largest height above its start;
    `settle.drift_rad.<joint>` of the controlled hinges, `settle.drift_m.<joint>` of the slide joints;
    `settle.energy_ratio`, the largest energy of all that can move (kinetic, potential above z = 0 of the
    world, foam) over that of the start, None unless that is above zero; `settle.left_out`, what of the
    model's file is left out or overridden.

    Args:
        simulation: Body of `deployment`, at the start.
        deployment: The deployment.
        duration_ns: Time to simulate [ns].
        progress: Called with the fraction that is done.

    Raises:
        ModelError: the simulation became unstable.
    """
    record = _SettlingRecord(simulation)
    step_ns = deployment.body.timestep_ns
    n_steps = duration_ns // step_ns
    first_averaged = max(n_steps - _AVERAGED_NS // step_ns, 0)
    try:
        for step in range(n_steps):
            simulation.advance((step + 1) * step_ns)
            record.observe((step + 1) / n_steps, is_averaged=step >= first_averaged)
            if step % 100 == 0:
                progress(step / n_steps)
    except ModelError as error:
        raise ModelError(f"settling: {error}") from error
    return record.settled(deployment)


class _SettlingRecord:
    """Extremes and means of one simulation, observed after each physics step."""

    def __init__(self, simulation: BodySimulation) -> None:
        self._simulation = simulation
        self._n_averaged, self._unsensed_sum_n = 0, 0.0
        mj, data = simulation.model.mj, simulation.data
        free = np.flatnonzero(mj.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        bodies = mj.jnt_bodyid[free].tolist()
        self._free_bodies = {mj.body(body).name or f"body {body}": body for body in bodies}
        self._start_m = data.xpos[:, 2].copy()
        self._rise_m = np.zeros(mj.nbody)
        self._start_qpos = data.qpos.copy()
        self._start_rad = simulation.joints()
        self._force_sum_n = np.zeros(simulation.n_cells)
        self._patch_body_sum_n = np.zeros((len(simulation.patches), mj.nbody))
        self._pressure_sum_kpa = np.zeros(simulation.n_elements)
        n_dofs = simulation.n_dofs
        self._first_speed, self._last_speed = np.zeros(n_dofs), np.zeros(n_dofs)
        self._direction = np.zeros(n_dofs)
        self._n_reversals = np.zeros(n_dofs, dtype=np.int64)
        is_fixed = mj.body_weldid == 0
        weight_n = mj.body_mass[is_fixed, None] * gravity_m_s2(mj)
        self._fixed_j = -float((weight_n * data.xipos[is_fixed]).sum())
        simulation.pressures()  # evaluates the contact at the start: foam may be compressed there
        self._start_j = self._largest_j = self._energy_j()

    def observe(self, fraction: float, *, is_averaged: bool) -> None:
        """Observe the present state, after `fraction` of the time; add its forces to the means if asked."""
        simulation = self._simulation
        pressure_kpa = simulation.pressures()  # evaluates the contact of the present state
        self._rise_m = np.maximum(self._rise_m, simulation.data.xpos[:, 2] - self._start_m)
        self._largest_j = max(self._largest_j, self._energy_j())
        self._observe_speeds(fraction)
        if is_averaged:
            self._n_averaged += 1
            contact = simulation.cell_foundation.contact
            self._unsensed_sum_n += simulation.unsensed_force.now_n
            self._force_sum_n += contact.force_n.sum(axis=1)
            self._patch_body_sum_n += contact.patch_body_force_n
            self._pressure_sum_kpa += pressure_kpa

    def settled(self, deployment: Deployment) -> Settled:
        """Return the outcome, see `settle`."""
        n = max(self._n_averaged, 1)
        return Settled(
            metrics=self._metrics(deployment),
            force_n=self._force_sum_n / n,
            patch_body_force_n=self._patch_body_sum_n / n,
            start_qpos=self._start_qpos,
            end_qpos=self._simulation.data.qpos.copy(),
            first_speed_rad_s=self._first_speed,
            last_speed_rad_s=self._last_speed,
            n_reversals=self._n_reversals,
        )

    def _observe_speeds(self, fraction: float) -> None:
        velocity_rad_s = self._simulation.data.qvel[self._simulation.model.dof_address]
        if fraction <= 1.0 / 3.0:
            self._first_speed = np.maximum(self._first_speed, np.abs(velocity_rad_s))
        elif fraction > 2.0 / 3.0:
            self._last_speed = np.maximum(self._last_speed, np.abs(velocity_rad_s))
            direction = np.sign(velocity_rad_s)
            self._n_reversals += direction * self._direction < 0.0
            self._direction = direction

    def _metrics(self, deployment: Deployment) -> dict[str, Any]:
        simulation, n = self._simulation, max(self._n_averaged, 1)
        metrics: dict[str, Any] = {}
        for name, rows in simulation.cells.items():
            metrics[f"settle.force_n.{name}"] = float(self._force_sum_n[rows].sum()) / n
        start = 0
        for sheet in simulation.sheets:
            end = start + sheet.n_elements
            force_n = self._pressure_sum_kpa[start:end].sum() * 1e3 * sheet.area_m2
            metrics[f"settle.force_n.{sheet.name}"] = float(force_n) / n
            start = end
        metrics["settle.unsensed_n"] = self._unsensed_sum_n / n
        metrics["settle.peak_unsensed_n"] = simulation.unsensed_force.peak_n
        for name, body in self._free_bodies.items():
            metrics[f"settle.rise_mm.{name}"] = 1e3 * float(self._rise_m[body])
        drift_rad = simulation.joints() - self._start_rad
        units = simulation.model.joint_units
        for name, unit, drift in zip(deployment.body.joints, units, drift_rad.tolist(), strict=True):
            metrics[f"settle.drift_{unit}.{name}"] = drift
        metrics["settle.energy_ratio"] = self._largest_j / self._start_j if self._start_j > 0.0 else None
        metrics["settle.left_out"] = list(simulation.model.left_out)
        return metrics

    def _energy_j(self) -> float:
        """Energy of all that can move: kinetic, potential of gravity and springs, and of the foam [J]."""
        mj, data = self._simulation.model.mj, self._simulation.data
        mujoco.mj_energyPos(mj, data)
        mujoco.mj_energyVel(mj, data)
        return float(data.energy.sum()) - self._fixed_j + self._simulation.dynamics.elastic_energy_j
