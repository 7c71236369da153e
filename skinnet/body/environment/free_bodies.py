"""Poses of free bodies in the world: finger, payload, stand and object."""

import mujoco
import numpy as np

from skinnet.body.added_elements import FINGER, added_id
from skinnet.body.environment.stand_model import OBJECT, STAND
from skinnet.body.model import PAYLOAD

__all__ = ["FreeBodies", "free_body_ids"]

_FREE_BODIES = {"finger": FINGER, "payload": PAYLOAD, "stand": STAND, "object": OBJECT}
"""Names of free bodies in messages, mapped to their body names in the model."""


def free_body_ids(mj: mujoco.MjModel) -> dict[str, int]:
    """Find the ids of the free bodies of a model, by their names in messages."""
    ids = {name: added_id(mj, mujoco.mjtObj.mjOBJ_BODY, body) for name, body in _FREE_BODIES.items()}
    return {name: index for name, index in ids.items() if index >= 0}


class FreeBodies:
    """Free bodies of a simulation; poses come from the generalised state, valid between two steps.

    Args:
        data: MuJoCo's state; read, never written.
    """

    def __init__(self, data: mujoco.MjData) -> None:
        self._data = data
        self._body = free_body_ids(data.model)

    def poses(self) -> dict[str, list[float]]:
        """Poses of all free bodies: position [m] and quaternion (w, x, y, z), world, by name."""
        return {name: self._pose(body) for name, body in self._body.items()}

    def _pose(self, body: int) -> list[float]:
        data, mj = self._data, self._data.model
        mocap = mj.body_mocapid[body]
        if mocap >= 0:
            return [*data.mocap_pos[mocap].tolist(), *data.mocap_quat[mocap].tolist()]
        joint = mj.body_jntadr[body]
        at = mj.jnt_qposadr[joint] if joint >= 0 else -1
        if joint >= 0 and mj.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            return list(data.qpos[at : at + 7].tolist())
        position_m = np.array(mj.body_pos[body])
        if joint >= 0:  # the stand has a slide joint only
            position_m += data.qpos[at] * mj.jnt_axis[joint]
        elif mj.body_parentid[body] != 0:  # an object fixed to the stand moves with it
            position_m += self._pose(int(mj.body_parentid[body]))[:3]
        return [*position_m.tolist(), *mj.body_quat[body].tolist()]
