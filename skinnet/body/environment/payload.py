"""Payload in the robot's arms: fixed in the world until its release, then free; ground truth of its motion.

The arms close on it before the run begins: the paper takes the held object as given "by a certain method"
[R11, III].
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.winkler import ContactState
from skinnet.body.model import PAYLOAD, BodyModel
from skinnet.clock import NS_PER_S
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.errors import DeploymentError

__all__ = ["GripController", "Payload"]

Floats = NDArray[np.float64]
_GRIP_TOLERANCE = 0.005
"""Relative tolerance of the grip force on each side (assumed)."""
_SETTLING_S = 0.2
"""Settling time [s] within the tolerance after which the grip is complete (assumed)."""
_TIMEOUT_S = 10.0
_RELEASE_DAMPING = 0.9
"""Velocity damping factor per physics step of the payload during its release: overdamped (assumed)."""


class Payload:
    """Payload: fixed in the world until its release, then free.

    Attributes:
        released_ns: Time of its release [ns]; None until the controller's release stage begins.
        dropped_ns: Time at which it had fallen [ns], or None.
        sliding_distance_m: Sliding distance over the skin since the release [m], force-weighted mean over the
            contact: a path length, which never shrinks; creep and rolling without sliding add nothing.
    """

    def __init__(
        self, data: mujoco.MjData, spec: PayloadSpec, sheet_contact: ContactState, period_ns: int
    ) -> None:
        """Initialise the payload at its pose in the model.

        Args:
            data: MuJoCo's state.
            spec: Payload section of the deployment.
            sheet_contact: Contact state of the sheets' foundation.
            period_ns: Recording period of its poses [ns].
        """
        self.released_ns: int | None = None
        self.dropped_ns: int | None = None
        self.sliding_distance_m = 0.0
        self._data, self._spec, self._sheet_contact = data, spec, sheet_contact
        self._period_ns = period_ns
        joint = data.model.joint(PAYLOAD)
        self._body = int(data.model.body(PAYLOAD).id)
        self._qpos = slice(int(joint.qposadr[0]), int(joint.qposadr[0]) + 7)
        self._qvel = slice(int(joint.dofadr[0]), int(joint.dofadr[0]) + 6)
        self._held_pose: Floats = data.qpos[self._qpos].copy()
        self._t_ns: list[int] = []
        self._poses: list[Floats] = []
        self._sliding_distances_m: list[float] = []

    def begin_stage(self, name: str, t_ns: int) -> None:
        """Begin stage `name` of the program at `t_ns` [ns]; the release stage schedules the release."""
        if self.released_ns is None and name == self._spec.release_stage:
            self.released_ns = t_ns + round(self._spec.release_delay_s * NS_PER_S)

    def fix_pose(self) -> None:
        """Fix the payload: reset its pose and velocity to the held pose."""
        self._data.qpos[self._qpos] = self._held_pose
        self._data.qvel[self._qvel] = 0.0

    def update(self, t_ns: int) -> None:
        """Update the payload at `t_ns` [ns], after a physics step: fix, damp or track it, and record."""
        if self.released_ns is None or t_ns <= self.released_ns:
            self.fix_pose()
        else:
            if t_ns <= self.released_ns + round(self._spec.release_ramp_s * NS_PER_S):
                self._data.qvel[self._qvel] *= _RELEASE_DAMPING
            self._track(t_ns)
        if t_ns % self._period_ns == 0:
            self._t_ns.append(t_ns)
            self._poses.append(self._data.qpos[self._qpos].copy())
            self._sliding_distances_m.append(self.sliding_distance_m)

    def _track(self, t_ns: int) -> None:
        pressed_n = self._sheet_contact.body_normal_force_n[self._body]
        if pressed_n > 0.0:
            self.sliding_distance_m += float(
                self._sheet_contact.force_weighted_slip_n_m[self._body] / pressed_n
            )
        fallen_m = self._held_pose[2] - self._data.qpos[self._qpos][2]
        if self.dropped_ns is None and fallen_m > self._spec.drop_threshold_m:
            self.dropped_ns = t_ns

    def facts(self) -> dict[str, Any]:
        """Facts of the payload for the body's process result."""
        return {
            "released_ns": self.released_ns,
            "dropped_ns": self.dropped_ns,
            "sliding_distance_m": self.sliding_distance_m,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Time series of the payload: position [m] and quaternion (w, x, y, z), sliding distance [m]."""
        return {
            "object_t_ns": np.array(self._t_ns, dtype=np.int64),
            "object_pose": np.array(self._poses, dtype=np.float64).reshape(-1, 7),
            "object_sliding_distance_m": np.array(self._sliding_distances_m, dtype=np.float64),
        }


class GripController:
    """Grip controller that closes the arms before time zero: integral force control of each joint."""

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
                raise DeploymentError(f"payload.closing_joints.{name}: body.joints does not name that joint")
        self._spec, self._step_s, self._n = spec, step_s, len(names)
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
        force_n = self._subtree_masks @ body_force_n
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
        speeds = np.zeros(self._n)
        speeds[self._joint] = self._direction * self._spec.closing_speed_rad_s * np.clip(missing, -1.0, 1.0)
        return speeds


def _subtree_mask(mj: mujoco.MjModel, root: int) -> Floats:
    """Subtree mask (nbody,): 1 for `root` and its descendants, else 0."""
    moved = np.zeros(mj.nbody)
    moved[root] = 1.0
    for body in range(root + 1, mj.nbody):
        moved[body] = moved[mj.body_parentid[body]]
    return moved
