"""Joint velocities that a user adds to the controller's own: the newest, while it is fresh. No I/O."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.messages import decode
from skinnet.outside_messages import Velocity

__all__ = ["OutsideVelocity"]

_FRESH_NS = 100_000_000
"""Simulated time after which a velocity counts no more, if no other comes; an assumption."""


class OutsideVelocity:
    """What comes in from outside, if the deployment lets it; whatever makes no sense stops it.

    Args:
        allowed: Whether anything may come in.
        n_dofs: D, number of joints.
        counters: Where to count what came in.
    """

    def __init__(self, allowed: bool, n_dofs: int, counters: Counter[str]) -> None:
        self._allowed, self._n_dofs, self._counters = allowed, n_dofs, counters
        self._velocity_rad_s = np.zeros(n_dofs)
        self._until_ns = -1

    def take(self, t_ns: int, payload: bytes) -> None:
        """A message came in before the tick of `t_ns`.

        Raises:
            ProtocolError: it is none, nothing may come in, or it has another length or is not finite.
        """
        self._until_ns = -1
        if not self._allowed:
            raise ProtocolError(
                "this run takes no velocities; start it with controller.outside_velocity=true"
            )
        wanted = np.array(decode(payload, Velocity).velocity_rad_s, dtype=np.float64)
        if len(wanted) != self._n_dofs:
            raise ProtocolError(f"velocities of {len(wanted)} joints; this run has {self._n_dofs}")
        if not np.isfinite(wanted).all():
            raise ProtocolError("joint velocities that are not finite")
        self._counters["velocities_from_outside"] += 1
        self._velocity_rad_s, self._until_ns = wanted, t_ns + _FRESH_NS

    def at(self, t_ns: int) -> NDArray[np.float64] | None:
        """(D,) what to add at the tick of `t_ns` [rad/s]; None if nothing fresh is there."""
        return self._velocity_rad_s if t_ns < self._until_ns else None
