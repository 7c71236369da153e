"""Payload ground truth: release, drop, sliding in the arms, and the pose over time."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import added_id
from skinnet.body.contact.sheet_foundation import SheetFoundation
from skinnet.body.environment.payload import Payload
from skinnet.body.model import PAYLOAD
from skinnet.clock import NS_PER_S
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.pinned_linalg import matmul, norm

__all__ = ["PayloadGroundTruth"]

Floats = NDArray[np.float64]


class PayloadGroundTruth:
    """Ground-truth recorder of the payload.

    It is dropped when it has left the arms: its centre has moved relative to them by more than
    `drop_threshold_m`, nothing of the robot has touched it for `drop_unsupported_s`, or it lies on the
    ground. Its height alone says nothing: the arms may have moved down with it.

    Attributes:
        dropped_ns: Time at which it had been dropped [ns], or None.
        dropped_by: Cause of the drop: `slid`, `unsupported` or `ground`; empty without one.
        slid_m: Largest displacement of its centre relative to the arms since the release [m].
        sliding_distance_m: Sliding distance over the skin since the release [m], force-weighted mean over the
            contact: a path length, which never shrinks; creep and rolling without sliding add nothing.
    """

    def __init__(
        self,
        data: mujoco.MjData,
        payload: Payload,
        sheets: SheetFoundation,
        spec: PayloadSpec,
        period_ns: int,
    ) -> None:
        """Initialise the recorder.

        Args:
            data: MuJoCo's state.
            payload: The payload.
            sheets: Foundation of the sheets.
            spec: Thresholds of a drop.
            period_ns: Recording period [ns].
        """
        self.dropped_ns: int | None = None
        self.dropped_by = ""
        self.slid_m = self.sliding_distance_m = 0.0
        self._data, self._payload, self._sheet_contact = data, payload, sheets.contact
        self._spec, self._period_ns = spec, period_ns
        self._body_id = added_id(data.model, mujoco.mjtObj.mjOBJ_BODY, PAYLOAD)
        self._sheet_body_id = sheets.surface.patch_body_id
        self._arms: list[tuple[int, Floats]] = []
        self._supported_ns = 0
        self._t_ns: list[int] = []
        self._poses: list[Floats] = []
        self._sliding_distances_m: list[float] = []

    def record(self, t_ns: int) -> None:
        """Record the payload at `t_ns` [ns], after it was updated for this physics step."""
        if self._payload.is_free(t_ns):
            self._track(t_ns)
        if t_ns % self._period_ns == 0:
            self._t_ns.append(t_ns)
            self._poses.append(self._payload.pose)
            self._sliding_distances_m.append(self.sliding_distance_m)

    def facts(self) -> dict[str, Any]:
        """Facts of the payload for the body's process result."""
        return {
            "released_ns": self._payload.released_ns,
            "dropped_ns": self.dropped_ns,
            "dropped_by": self.dropped_by,
            "slid_m": self.slid_m,
            "sliding_distance_m": self.sliding_distance_m,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Time series of the payload: position [m] and quaternion (w, x, y, z), sliding distance [m]."""
        return {
            "object_t_ns": np.array(self._t_ns, dtype=np.int64),
            "object_pose": np.array(self._poses, dtype=np.float64).reshape(-1, 7),
            "object_sliding_distance_m": np.array(self._sliding_distances_m, dtype=np.float64),
        }

    def _track(self, t_ns: int) -> None:
        if not self._arms:
            self._hold(t_ns)
        pressed_n = self._sheet_contact.body_normal_force_n[self._body_id]
        if pressed_n > 0.0:
            self.sliding_distance_m += float(
                self._sheet_contact.force_weighted_slip_n_m[self._body_id] / pressed_n
            )
        if pressed_n > 0.0 or self._touched_bodies() - {0}:
            self._supported_ns = t_ns
        if t_ns % self._period_ns == 0:
            self.slid_m = max(self.slid_m, self._displacement_m())
        if self.dropped_ns is None and (cause := self._drop_cause(t_ns)):
            self.dropped_ns, self.dropped_by = t_ns, cause

    def _hold(self, t_ns: int) -> None:
        """Remember the place of the payload's centre in the frames of the links that hold it."""
        holding = self._sheet_contact.patch_body_force_n[:, self._body_id] > 0.0
        bodies = np.unique(self._sheet_body_id[holding] if holding.any() else self._sheet_body_id).tolist()
        xpos, xmat = self._data.xpos, self._data.xmat
        centre_m = xpos[self._body_id]
        self._arms = [(body, matmul(xmat[body].reshape(3, 3).T, centre_m - xpos[body])) for body in bodies]
        self._supported_ns = t_ns

    def _displacement_m(self) -> float:
        """Displacement of the centre [m] from where it was held, mean over the links that held it."""
        xpos, xmat = self._data.xpos, self._data.xmat
        held_m = [xpos[body] + matmul(xmat[body].reshape(3, 3), place_m) for body, place_m in self._arms]
        return norm(xpos[self._body_id] - np.mean(held_m, axis=0))

    def _drop_cause(self, t_ns: int) -> str:
        if self.slid_m > self._spec.drop_threshold_m:
            return "slid"
        if t_ns - self._supported_ns > round(self._spec.drop_unsupported_s * NS_PER_S):
            return "unsupported"
        return "ground" if t_ns % self._period_ns == 0 and 0 in self._touched_bodies() else ""

    def _touched_bodies(self) -> set[int]:
        """Ids of the bodies in rigid contact with the payload; 0 is the world."""
        if not self._data.ncon:
            return set()
        pairs = self._data.model.geom_bodyid[self._data.contact.geom]
        touching = pairs[(pairs == self._body_id).any(axis=1)]
        return set(touching.ravel().tolist()) - {self._body_id}
