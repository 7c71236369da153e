"""Dynamics of the body: skin contact, accelerations and integration of one MuJoCo simulation."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.actuation import Actuation
from skinnet.body.contact.foam_response import elastic_energy_j
from skinnet.body.contact.implicit_step import ImplicitContact
from skinnet.body.contact.sheet_foundation import SheetFoundation
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.model import BodyModel
from skinnet.body.teacher.finger import Finger

__all__ = ["Dynamics"]

_STEPPED_STATE = (
    mujoco.mjtState.mjSTATE_PHYSICS | mujoco.mjtState.mjSTATE_TIME | mujoco.mjtState.mjSTATE_WARMSTART
)
"""Parts of MuJoCo's state that the integrator changes."""


class Dynamics:
    """Dynamics of robot, skin and finger, in steps of equal length.

    A step is `compute_contact`, `compute_accelerations`, `integrate`, in this order.

    Attributes:
        data: MuJoCo's state.
        step_s: Physics step [s].
        actuation: Servos of the controlled joints.
        cell_foundation: Elastic foundation of the cells.
        sheet_foundation: Elastic foundation of the tactile sheets.
    """

    def __init__(
        self,
        model: BodyModel,
        data: mujoco.MjData,
        step_s: float,
        actuation: Actuation,
        foundations: tuple[Foundation, SheetFoundation],
        finger: Finger,
    ) -> None:
        self.data, self.step_s, self.actuation = data, step_s, actuation
        self.cell_foundation, self.sheet_foundation = foundations
        self._mj, self._finger = model.mj, finger
        self._implicit_contact = ImplicitContact(model.mj, data, foundations)
        self._state = np.empty(mujoco.mj_stateSize(model.mj, _STEPPED_STATE))

    @property
    def is_finite(self) -> bool:
        """False once the simulation has become unstable."""
        return bool(np.isfinite(self.data.qacc).all() and np.isfinite(self.data.qpos).all())

    @property
    def foam_is_loaded(self) -> bool:
        """True if foam is compressed now, or may be within the coming step."""
        return bool(
            self.cell_foundation.problem.points.total[0] or self.sheet_foundation.problem.points.total[0]
        )

    @property
    def elastic_energy_j(self) -> float:
        """Elastic energy of all foam, and of elastic solids on it, after `compute_contact` [J]."""
        foundations = (self.cell_foundation, self.sheet_foundation)
        return sum(elastic_energy_j(each.problem) for each in foundations)

    def compute_contact(self) -> None:
        """Compute poses, velocities and skin contact forces at the present state."""
        mujoco.mj_fwdPosition(self._mj, self.data)
        mujoco.mj_fwdVelocity(self._mj, self.data)
        self._finger.write_velocity()
        self.data.xfrc_applied[:] = 0.0
        self.cell_foundation.compute_contact(self.step_s)
        self.sheet_foundation.compute_contact(self.step_s)

    def compute_accelerations(self) -> None:
        """Compute accelerations in the coming step, after `compute_contact`.

        The foam's forces are those at the end of the step (`implicit_step`); `xfrc_applied` keeps those of
        the present state.
        """
        data = self.data
        self.actuation.compensate()
        mujoco.mj_fwdActuation(self._mj, data)
        if self.foam_is_loaded:
            present_wrench = data.xfrc_applied.copy()
            data.xfrc_applied[:] = 0.0
            mujoco.mj_fwdAcceleration(self._mj, data)
            data.xfrc_applied[:] = present_wrench
            self._implicit_contact.add_forces(self.step_s)
            data.qacc_smooth[:] = data.qfrc_smooth
            mujoco.mj_solveM(self._mj, data, data.qacc_smooth[None], data.qfrc_smooth[None])
        else:
            mujoco.mj_fwdAcceleration(self._mj, data)
        mujoco.mj_fwdConstraint(self._mj, data)

    def integrate(self) -> None:
        """Integrate state and servo targets over one step, after `compute_accelerations`."""
        self._integrate_state()
        self.actuation.advance(self.step_s)

    def realised_acceleration(self) -> NDArray[np.float64]:
        """Acceleration (nv,) [rad/s², m/s²] that `integrate` will realise: its change of velocity per step.

        MuJoCo's `qacc` = M⁻¹ f is not what happens: the implicit integrator solves (M − h ∂f/∂v) v̇ = f, so
        that a servo damping kv on the inertia M makes it smaller by 1 / (1 + h kv / M). To be called after
        `compute_accelerations`; changes nothing.
        """
        before = self.data.qvel.copy()
        mujoco.mj_getState(self._mj, self.data, self._state, _STEPPED_STATE)
        self._integrate_state()
        realised: NDArray[np.float64] = (self.data.qvel - before) / self.step_s
        mujoco.mj_setState(self._mj, self.data, self._state, _STEPPED_STATE)
        return realised

    def _integrate_state(self) -> None:
        """Integrate MuJoCo's state over one step."""
        mujoco.mj_implicit(self._mj, self.data)
