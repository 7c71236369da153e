"""External joint velocities, added to the controller's own while they are fresh. No I/O."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import decode

__all__ = ["ExternalVelocityInput"]

_VALIDITY_NS = 100_000_000
"""Simulated time [ns] for which an external velocity is valid; an assumption."""


class ExternalVelocityInput:
    """External velocity command, if the deployment allows it; an invalid message cancels it.

    Args:
        allowed: True if the deployment accepts external velocities.
        n_dofs: D, number of joints.
        counters: Counters of the process; accepted messages are counted.
    """

    def __init__(self, allowed: bool, n_dofs: int, counters: Counter[str]) -> None:
        self._allowed, self._n_dofs, self._counters = allowed, n_dofs, counters
        self._velocity_rad_s = np.zeros(n_dofs)
        self._valid_until_ns = -1

    def accept(self, t_ns: int, payload: bytes) -> None:
        """Accept a velocity message before the tick at `t_ns`.

        Raises:
            ProtocolError: the message is malformed, not allowed, of the wrong length or not finite.
        """
        self._valid_until_ns = -1
        if not self._allowed:
            raise ProtocolError(
                "this run takes no velocities; start it with controller.external_velocity=true"
            )
        wanted = np.array(decode(payload, ExternalVelocity).velocity_rad_s, dtype=np.float64)
        if len(wanted) != self._n_dofs:
            raise ProtocolError(f"velocities of {len(wanted)} joints; this run has {self._n_dofs}")
        if not np.isfinite(wanted).all():
            raise ProtocolError("joint velocities that are not finite")
        self._counters["external_velocities"] += 1
        self._velocity_rad_s, self._valid_until_ns = wanted, t_ns + _VALIDITY_NS

    def at(self, t_ns: int) -> NDArray[np.float64] | None:
        """Return the velocities (D,) [rad/s] to add at the tick at `t_ns`; None without fresh ones."""
        return self._velocity_rad_s if t_ns < self._valid_until_ns else None
