"""Payload ground truth: release, drop, sliding over the skin, and the pose over time."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import added_id
from skinnet.body.contact.winkler import ContactState
from skinnet.body.environment.payload import Payload
from skinnet.body.model import PAYLOAD, BodyModel

__all__ = ["PayloadGroundTruth"]

Floats = NDArray[np.float64]


class PayloadGroundTruth:
    """Ground-truth recorder of the payload.

    Attributes:
        dropped_ns: Time at which it had fallen [ns], or None.
        sliding_distance_m: Sliding distance over the skin since the release [m], force-weighted mean over the
            contact: a path length, which never shrinks; creep and rolling without sliding add nothing.
    """

    def __init__(
        self,
        model: BodyModel,
        payload: Payload,
        sheet_contact: ContactState,
        drop_threshold_m: float,
        period_ns: int,
    ) -> None:
        """Initialise the recorder.

        Args:
            model: The robot model.
            payload: The payload.
            sheet_contact: Contact state of the sheets' foundation.
            drop_threshold_m: Fall [m] beyond which it counts as dropped.
            period_ns: Recording period [ns].
        """
        self.dropped_ns: int | None = None
        self.sliding_distance_m = 0.0
        self._payload, self._sheet_contact = payload, sheet_contact
        self._drop_threshold_m, self._period_ns = drop_threshold_m, period_ns
        self._body_id = added_id(model.mj, mujoco.mjtObj.mjOBJ_BODY, PAYLOAD)
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
        pressed_n = self._sheet_contact.body_normal_force_n[self._body_id]
        if pressed_n > 0.0:
            self.sliding_distance_m += float(
                self._sheet_contact.force_weighted_slip_n_m[self._body_id] / pressed_n
            )
        if self.dropped_ns is None and self._payload.fall_m > self._drop_threshold_m:
            self.dropped_ns = t_ns
