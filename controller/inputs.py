"""Inputs of the controller apart from skin and requests: joint positions and external velocities. No I/O."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import Joints, decode

__all__ = ["ExternalVelocityInput", "JointInput"]

_VALIDITY_NS = 100_000_000
"""Simulated time [ns] for which an external velocity is valid; an assumption."""


class JointInput:
    """Joint positions by their time, until the tick that uses them.

    Args:
        n_dofs: D, number of joints.
    """

    def __init__(self, n_dofs: int) -> None:
        self._n_dofs = n_dofs
        self._position_rad: dict[int, NDArray[np.float64]] = {}

    def accept(self, payload: bytes) -> int:
        """Accept a joint message; return its watermark [ns].

        Raises:
            ProtocolError: the message is malformed, of the wrong length or not finite.
        """
        joints = decode(payload, Joints)
        position = np.array(joints.position_rad, dtype=np.float64)
        if len(position) != self._n_dofs:
            raise ProtocolError(f"joint feedback has {len(position)} positions; expected {self._n_dofs}")
        if not np.isfinite(position).all():
            raise ProtocolError("joint positions are not finite")
        self._position_rad[joints.t_ns] = position
        return joints.watermark_ns

    def take(self, t_ns: int) -> NDArray[np.float64]:
        """Remove and return the positions (D,) [rad] measured at `t_ns`, which must have arrived."""
        return self._position_rad.pop(t_ns)


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
            raise ProtocolError(
                f"external velocity has {len(wanted)} entries; expected one for each of {self._n_dofs} joints"
            )
        if not np.isfinite(wanted).all():
            raise ProtocolError("external joint velocities are not finite")
        self._counters["external_velocities"] += 1
        self._velocity_rad_s, self._valid_until_ns = wanted, t_ns + _VALIDITY_NS

    def at(self, t_ns: int) -> NDArray[np.float64] | None:
        """Return the velocities (D,) [rad/s] to add at the tick at `t_ns`; None without fresh ones."""
        return self._velocity_rad_s if t_ns < self._valid_until_ns else None
