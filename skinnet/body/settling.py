"""Settling of a body: physics and servos at home, without network, and what comes of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.simulation import BodySimulation
from skinnet.clock import NS_PER_S
from skinnet.deployment import Deployment
from skinnet.errors import ModelError

__all__ = ["settle"]

Floats = NDArray[np.float64]

_AVERAGED_NS = NS_PER_S // 10
"""Forces are averaged over the end of the time: of this length."""


def settle(
    deployment: Deployment,
    base_dir: Path,
    duration_ns: int,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> dict[str, Any]:
    """Simulate body and servos at home for `duration_ns` [ns], whole physics steps; compute metrics.

    Returns:
        By name: `settle.force_n.<patch or sheet>`, the sum of normal forces, mean of the last 0.1 s [N];
        `settle.unsensed_n`, the load of the rigid shell under skin (`UnsensedForce`), likewise;
        `settle.peak_unsensed_n`; `settle.rise_mm.<free body>`, the largest height above its start;
        `settle.drift_rad.<joint>` of the controlled hinges, `settle.drift_m.<joint>` of the slide joints;
        `settle.energy_ratio`, the largest energy of all that can move (kinetic, potential above z = 0 of the
        world, foam) over that of the start, None unless that is above zero; `settle.left_out`, what of the
        model's file is left out or overridden.

    Raises:
        ModelError: the simulation became unstable.
        DeploymentError: the deployment contradicts itself or the model.
    """
    simulation = BodySimulation(deployment, base_dir)
    record = _SettlingRecord(simulation)
    step_ns = deployment.body.timestep_ns
    n_steps = duration_ns // step_ns
    first_averaged = max(n_steps - _AVERAGED_NS // step_ns, 0)
    try:
        for step in range(n_steps):
            simulation.advance((step + 1) * step_ns)
            record.observe(is_averaged=step >= first_averaged)
            if step % 100 == 0:
                progress(step / n_steps)
    except ModelError as error:
        raise ModelError(f"settling: {error}") from error
    return record.metrics(deployment)


@dataclass
class _SettlingRecord:
    """Extremes and means of one simulation, observed after each physics step."""

    simulation: BodySimulation
    n_averaged: int = 0
    unsensed_sum_n: float = 0.0
    _force_sum_n: Floats = field(init=False)
    _pressure_sum_kpa: Floats = field(init=False)

    def __post_init__(self) -> None:
        simulation = self.simulation
        mj, data = simulation.model.mj, simulation.data
        free = np.flatnonzero(mj.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        bodies = mj.jnt_bodyid[free].tolist()
        self._free_bodies = {mj.body(body).name or f"body {body}": body for body in bodies}
        self._start_m = data.xpos[:, 2].copy()
        self._rise_m = np.zeros(mj.nbody)
        self._start_rad = simulation.joints()
        self._force_sum_n = np.zeros(simulation.n_cells)
        self._pressure_sum_kpa = np.zeros(simulation.n_elements)
        is_fixed = mj.body_weldid == 0
        weight_n = mj.body_mass[is_fixed, None] * mj.opt.gravity
        self._fixed_j = -float((weight_n * data.xipos[is_fixed]).sum())
        simulation.pressures()  # evaluates the contact at the start: foam may be compressed there
        self._start_j = self._largest_j = self._energy_j()

    def observe(self, *, is_averaged: bool) -> None:
        """Observe the present state; add its forces to the means if `is_averaged`."""
        simulation = self.simulation
        pressure_kpa = simulation.pressures()  # evaluates the contact of the present state
        self._rise_m = np.maximum(self._rise_m, simulation.data.xpos[:, 2] - self._start_m)
        self._largest_j = max(self._largest_j, self._energy_j())
        if is_averaged:
            self.n_averaged += 1
            self.unsensed_sum_n += simulation.unsensed_force.now_n
            self._force_sum_n += simulation.cell_foundation.contact.force_n.sum(axis=1)
            self._pressure_sum_kpa += pressure_kpa

    def metrics(self, deployment: Deployment) -> dict[str, Any]:
        """Compute the metrics, see `settle`."""
        simulation, n = self.simulation, max(self.n_averaged, 1)
        metrics: dict[str, Any] = {}
        for name, rows in simulation.cells.items():
            metrics[f"settle.force_n.{name}"] = float(self._force_sum_n[rows].sum()) / n
        start = 0
        for sheet in simulation.sheets:
            end = start + sheet.n_elements
            force_n = self._pressure_sum_kpa[start:end].sum() * 1e3 * sheet.area_m2
            metrics[f"settle.force_n.{sheet.name}"] = float(force_n) / n
            start = end
        metrics["settle.unsensed_n"] = self.unsensed_sum_n / n
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
        mj, data = self.simulation.model.mj, self.simulation.data
        mujoco.mj_energyPos(mj, data)
        mujoco.mj_energyVel(mj, data)
        return float(data.energy.sum()) - self._fixed_j + self.simulation.dynamics.elastic_energy_j
