"""Payload in the robot's arms: fixed in the world until its release, then free."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.added_elements import added_id
from skinnet.body.model import PAYLOAD
from skinnet.clock import NS_PER_S
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.deployment.types import ns_of_s

__all__ = ["Payload"]

Floats = NDArray[np.float64]
_RELEASE_DAMPING_PER_S = 105.36
"""Rate [1/s] at which the payload's velocity decays during its release: 0.9 in 1 ms, overdamped (assumed)."""


class Payload:
    """Payload: fixed in the world until its release, then free.

    Attributes:
        released_ns: Time of its release [ns]; None until the controller's release stage begins.
    """

    def __init__(self, data: mujoco.MjData, spec: PayloadSpec, step_s: float) -> None:
        """Initialise the payload at its pose in the model; it is updated every `step_s` [s]."""
        self.released_ns: int | None = None
        self._data, self._spec = data, spec
        self._step_s, self._step_ns = step_s, ns_of_s(step_s)
        joint = data.model.joint(added_id(data.model, mujoco.mjtObj.mjOBJ_JOINT, PAYLOAD))
        self._qpos = slice(int(joint.qposadr[0]), int(joint.qposadr[0]) + 7)
        self._qvel = slice(int(joint.dofadr[0]), int(joint.dofadr[0]) + 6)
        self._held_pose: Floats = data.qpos[self._qpos].copy()

    @property
    def pose(self) -> Floats:
        """Present pose (7,): position [m] and quaternion (w, x, y, z), world; a copy."""
        pose: Floats = self._data.qpos[self._qpos].copy()
        return pose

    def is_free(self, t_ns: int) -> bool:
        """Return True if the payload is free at `t_ns` [ns], after its release."""
        return self.released_ns is not None and t_ns > self.released_ns

    def begin_stage(self, name: str, t_ns: int) -> None:
        """Begin stage `name` of the program at `t_ns` [ns]; the release stage schedules the release."""
        if self.released_ns is None and name == self._spec.release_stage:
            self.released_ns = t_ns + ns_of_s(self._spec.release_delay_s)

    def fix_pose(self) -> None:
        """Fix the payload: reset its pose and velocity to the held pose."""
        self._data.qpos[self._qpos] = self._held_pose
        self._data.qvel[self._qvel] = 0.0

    def update(self, t_ns: int) -> None:
        """Update the payload at `t_ns` [ns], after a physics step: fix it, or damp it during its release."""
        if self.released_ns is None or t_ns <= self.released_ns:
            self.fix_pose()
            return
        begin_ns = max(self.released_ns, t_ns - self._step_ns)
        end_ns = min(self.released_ns + ns_of_s(self._spec.release_ramp_s), t_ns)
        if end_ns > begin_ns:
            self._damp((end_ns - begin_ns) / NS_PER_S)

    def _damp(self, damped_s: float) -> None:
        """Damp the velocity for `damped_s` [s], and the step's motion, which MuJoCo made at that before.

        A step moves the pose by its last velocity. Foam shears by that velocity times the step: without the
        second part it would stay behind the pose, by a tenth at 1 ms.
        """
        pose, velocity = self._data.qpos[self._qpos], self._data.qvel[self._qvel]
        change = pinned_math.expm1(-_RELEASE_DAMPING_PER_S * damped_s)
        pose[:3] += change * self._step_s * velocity[:3]
        mujoco.mju_quatIntegrate(pose[3:], velocity[3:], change * self._step_s)
        velocity *= 1.0 + change
