"""Payload in the robot's arms: fixed in the world until its release, then free; ground truth of its motion.

The arms close on it before the run begins: the paper takes the held object as given "by a certain method"
[R11, III].
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import PAYLOAD, BodyModel
from skinnet.body.winkler import Pressed
from skinnet.clock import NS_PER_S
from skinnet.deployment.payload import PayloadSpec
from skinnet.errors import DeploymentError

__all__ = ["Closing", "Payload"]

Floats = NDArray[np.float64]
_CLOSED = 0.005
"""Relative tolerance of the grip force on each side (assumed)."""
_QUIET_S = 0.2
"""Settling time [s] within the tolerance after which the grip is complete (assumed)."""
_PATIENCE_S = 10.0
_EASED = 0.9
"""Velocity damping factor per physics step of the payload during its release: overdamped (assumed)."""


class Payload:
    """Payload: fixed in the world until its release, then free.

    Attributes:
        released_ns: Time of its release [ns]; None until the controller's release stage begins.
        dropped_ns: Time at which it had fallen [ns], or None.
        slid_m: Sliding distance over the skin since the release [m], force-weighted mean over the contact: a
            path length, which never shrinks; creep and rolling without sliding add nothing.
    """

    def __init__(self, data: mujoco.MjData, spec: PayloadSpec, sheets: Pressed, every_ns: int) -> None:
        """Initialise the payload at its pose in the model.

        Args:
            data: MuJoCo's state.
            spec: Payload section of the deployment.
            sheets: Contact state of the sheets' foundation.
            every_ns: Recording period of its poses [ns].
        """
        self.released_ns: int | None = None
        self.dropped_ns: int | None = None
        self.slid_m = 0.0
        self._data, self._spec, self._sheets = data, spec, sheets
        self._every_ns = every_ns
        joint = data.model.joint(PAYLOAD)
        self._body = int(data.model.body(PAYLOAD).id)
        self._qpos = slice(int(joint.qposadr[0]), int(joint.qposadr[0]) + 7)
        self._qvel = slice(int(joint.dofadr[0]), int(joint.dofadr[0]) + 6)
        self._held_pose: Floats = data.qpos[self._qpos].copy()
        self._t_ns: list[int] = []
        self._poses: list[Floats] = []
        self._slid_m: list[float] = []

    def begin_stage(self, name: str, t_ns: int) -> None:
        """Begin stage `name` of the program at `t_ns` [ns]; the release stage schedules the release."""
        if self.released_ns is None and name == self._spec.release_stage:
            self.released_ns = t_ns + round(self._spec.release_s * NS_PER_S)

    def hold(self) -> None:
        """Fix the payload: reset its pose and velocity to the held pose."""
        self._data.qpos[self._qpos] = self._held_pose
        self._data.qvel[self._qvel] = 0.0

    def observe(self, t_ns: int) -> None:
        """Update the payload at `t_ns` [ns], after a physics step: fix, damp or track it, and record."""
        if self.released_ns is None or t_ns <= self.released_ns:
            self.hold()
        else:
            if t_ns <= self.released_ns + round(self._spec.easing_s * NS_PER_S):
                self._data.qvel[self._qvel] *= _EASED
            self._follow(t_ns)
        if t_ns % self._every_ns == 0:
            self._t_ns.append(t_ns)
            self._poses.append(self._data.qpos[self._qpos].copy())
            self._slid_m.append(self.slid_m)

    def _follow(self, t_ns: int) -> None:
        pressed_n = self._sheets.on_body_n[self._body]
        if pressed_n > 0.0:
            self.slid_m += float(self._sheets.slid_n_m[self._body] / pressed_n)
        fallen_m = self._held_pose[2] - self._data.qpos[self._qpos][2]
        if self.dropped_ns is None and fallen_m > self._spec.fallen_m:
            self.dropped_ns = t_ns

    def facts(self) -> dict[str, Any]:
        """Facts of the payload for the body's process result."""
        return {"released_ns": self.released_ns, "dropped_ns": self.dropped_ns, "slid_m": self.slid_m}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Time series of the payload: position [m] and quaternion (w, x, y, z), sliding distance [m]."""
        return {
            "object_t_ns": np.array(self._t_ns, dtype=np.int64),
            "object_pose": np.array(self._poses, dtype=np.float64).reshape(-1, 7),
            "object_slid_m": np.array(self._slid_m, dtype=np.float64),
        }


class Closing:
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
        if not spec.closing:
            raise DeploymentError("payload.closing: name at least one joint that closes the arms")
        for name in spec.closing:
            if name not in names:
                raise DeploymentError(f"payload.closing.{name}: body.joints does not name that joint")
        self._spec, self._step_s, self._n = spec, step_s, len(names)
        self._joint = np.array([names.index(name) for name in spec.closing])
        self._direction = np.array(list(spec.closing.values()))
        moved = model.mj.jnt_bodyid[model.joint[self._joint]]
        self._beyond = np.array([_beyond(model.mj, int(body)) for body in moved])
        self._spent_s = self._quiet_s = 0.0

    def speeds_rad_s(self, body_force_n: Floats) -> Floats | None:
        """Compute closing velocities (D,) of the controlled joints [rad/s]; None when the grip has settled.

        Args:
            body_force_n: (nbody,) normal forces on the sheets of each body [N].

        Raises:
            DeploymentError: the grip does not settle within 10 s.
        """
        force_n = self._beyond @ body_force_n
        missing = (self._spec.grip_n - force_n) / self._spec.grip_n
        closed = bool(np.all(np.abs(missing) < _CLOSED))
        self._quiet_s = self._quiet_s + self._step_s if closed else 0.0
        self._spent_s += self._step_s
        if self._quiet_s >= _QUIET_S:
            return None
        if self._spent_s > _PATIENCE_S:
            felt = ", ".join(f"{n:.1f} N" for n in force_n)
            raise DeploymentError(
                f"payload: after {_PATIENCE_S:g} s {', '.join(self._spec.closing)} press with {felt} instead "
                f"of {self._spec.grip_n:g} N; check payload.position_m, closing and body.home_rad"
            )
        speeds = np.zeros(self._n)
        speeds[self._joint] = self._direction * self._spec.closing_rad_s * np.clip(missing, -1.0, 1.0)
        return speeds


def _beyond(mj: mujoco.MjModel, root: int) -> Floats:
    """Subtree mask (nbody,): 1 for `root` and its descendants, else 0."""
    moved = np.zeros(mj.nbody)
    moved[root] = 1.0
    for body in range(root + 1, mj.nbody):
        moved[body] = moved[mj.body_parentid[body]]
    return moved
