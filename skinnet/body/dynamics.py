"""Dynamics of the body: skin contact, accelerations and integration of one MuJoCo simulation."""

import mujoco
import numpy as np

from skinnet.body.actuation import Actuation
from skinnet.body.contact.sheet_foundation import SheetFoundation
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.model import BodyModel
from skinnet.body.teacher.finger import Finger

__all__ = ["Dynamics"]


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

    @property
    def is_finite(self) -> bool:
        """False once the simulation has become unstable."""
        return bool(np.isfinite(self.data.qacc).all() and np.isfinite(self.data.qpos).all())

    def compute_contact(self) -> None:
        """Compute poses, velocities and skin contact forces at the present state."""
        mujoco.mj_fwdPosition(self._mj, self.data)
        mujoco.mj_fwdVelocity(self._mj, self.data)
        self._finger.write_velocity()
        self.data.xfrc_applied[:] = 0.0
        self.cell_foundation.compute_contact(self.step_s)
        self.sheet_foundation.compute_contact(self.step_s)

    def compute_accelerations(self) -> None:
        """Compute accelerations at the present state, after `compute_contact`."""
        mujoco.mj_fwdActuation(self._mj, self.data)
        mujoco.mj_fwdAcceleration(self._mj, self.data)
        mujoco.mj_fwdConstraint(self._mj, self.data)

    def integrate(self) -> None:
        """Integrate state and servo targets over one step, after `compute_accelerations`."""
        mujoco.mj_implicit(self._mj, self.data)
        self.actuation.advance(self.step_s)
