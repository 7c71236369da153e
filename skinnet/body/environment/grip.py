"""Grip of the arms on the payload before time zero: integral force control of the closing joints.

The paper takes the held object as given "by a certain method" [R11, III].
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.dynamics import Dynamics
from skinnet.body.environment.payload import Payload
from skinnet.body.model import BodyModel
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.errors import DeploymentError
from skinnet.pinned_linalg import matmul

__all__ = ["GripController", "close_grip"]

Floats = NDArray[np.float64]
_GRIP_TOLERANCE = 0.005
"""Relative tolerance of the grip force on each side (assumed)."""
_SETTLING_S = 0.2
"""Settling time [s] within the tolerance after which the grip is complete (assumed)."""
_TIMEOUT_S = 10.0


class GripController:
    """Grip controller: integral force control of each closing joint.

    Attributes:
        n_joints: D, number of controlled joints.
    """

    def __init__(self, model: BodyModel, names: Sequence[str], spec: PayloadSpec, step_s: float) -> None:
        """Initialise the grip controller with open arms.

        Args:
            model: The robot model.
            names: Names of the controlled joints.
            spec: The payload.
            step_s: Physics step [s].

        Raises:
            DeploymentError: a closing joint is not controlled, or there is none.
        """
        if not spec.closing_joints:
            raise DeploymentError("payload.closing_joints: name at least one joint that closes the arms")
        for name in spec.closing_joints:
            if name not in names:
                raise DeploymentError(f"payload.closing_joints.{name}: must be one of body.joints")
        self.n_joints = len(names)
        self._spec, self._step_s = spec, step_s
        self._joint = np.array([names.index(name) for name in spec.closing_joints])
        self._direction = np.array(list(spec.closing_joints.values()))
        moved = model.mj.jnt_bodyid[model.joint_id[self._joint]]
        self._subtree_masks = np.array([_subtree_mask(model.mj, int(body)) for body in moved])
        self._elapsed_s = self._settled_s = 0.0

    def closing_velocity_rad_s(self, body_force_n: Floats) -> Floats | None:
        """Compute closing velocities (D,) of the controlled joints [rad/s]; None when the grip has settled.

        Args:
            body_force_n: (nbody,) normal forces on the sheets of each body [N].

        Raises:
            DeploymentError: the grip does not settle within 10 s.
        """
        force_n = matmul(self._subtree_masks, body_force_n)
        missing = (self._spec.grip_force_n - force_n) / self._spec.grip_force_n
        closed = bool(np.all(np.abs(missing) < _GRIP_TOLERANCE))
        self._settled_s = self._settled_s + self._step_s if closed else 0.0
        self._elapsed_s += self._step_s
        if self._settled_s >= _SETTLING_S:
            return None
        if self._elapsed_s > _TIMEOUT_S:
            felt = ", ".join(f"{n:.1f} N" for n in force_n)
            raise DeploymentError(
                f"payload: after {_TIMEOUT_S:g} s {', '.join(self._spec.closing_joints)} press with {felt} "
                f"instead of {self._spec.grip_force_n:g} N; check payload.position_m, closing_joints and "
                "body.home_rad"
            )
        speeds = np.zeros(self.n_joints)
        speeds[self._joint] = self._direction * self._spec.closing_speed_rad_s * np.clip(missing, -1.0, 1.0)
        return speeds


def close_grip(dynamics: Dynamics, controller: GripController, payload: Payload) -> None:
    """Close the arms on the payload, which stays where it is, until the grip force has settled.

    Raises:
        DeploymentError: the grip does not settle within 10 s.
    """
    while True:
        dynamics.compute_contact()
        speeds_rad_s = controller.closing_velocity_rad_s(dynamics.sheet_foundation.body_force_n())
        dynamics.actuation.command(np.zeros(controller.n_joints) if speeds_rad_s is None else speeds_rad_s)
        if speeds_rad_s is None:
            break
        dynamics.compute_accelerations()
        dynamics.integrate()
        payload.fix_pose()
    dynamics.data.time = 0.0


def _subtree_mask(mj: mujoco.MjModel, root: int) -> Floats:
    """Subtree mask (nbody,): 1 for `root` and its descendants, else 0."""
    moved = np.zeros(mj.nbody)
    moved[root] = 1.0
    for body in range(root + 1, mj.nbody):
        moved[body] = moved[mj.body_parentid[body]]
    return moved
