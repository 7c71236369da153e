"""Inputs of the controller apart from skin and requests: joint positions and external velocities. No I/O."""

from collections import Counter, deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import JointRanges, Joints, decode

__all__ = ["ExternalVelocityInput", "JointInput", "JointMeasurement", "decode_joint_ranges"]

_VALIDITY_NS = 100_000_000
"""Simulated time [ns] for which an external velocity is valid; an assumption."""


class JointMeasurement(NamedTuple):
    """Joint positions (D,) [rad] and the time [ns] at which they were measured."""

    t_ns: int
    position_rad: NDArray[np.float64]


class JointInput:
    """Joint positions by their time of measurement, the newest of which a tick uses.

    Args:
        n_dofs: D, number of joints.
    """

    def __init__(self, n_dofs: int) -> None:
        self._n_dofs = n_dofs
        self._measurements: deque[JointMeasurement] = deque()

    def accept(self, payload: bytes) -> int:
        """Accept a joint message; return its watermark [ns].

        Raises:
            ProtocolError: the message is malformed, of the wrong length, not finite, or measured after its
                watermark.
        """
        joints = decode(payload, Joints)
        if joints.t_ns > joints.watermark_ns:
            raise ProtocolError(
                f"joint feedback measured at {joints.t_ns} ns, after its watermark {joints.watermark_ns} ns"
            )
        position = np.array(joints.position_rad, dtype=np.float64)
        if len(position) != self._n_dofs:
            raise ProtocolError(f"joint feedback has {len(position)} positions; expected {self._n_dofs}")
        if not np.isfinite(position).all():
            raise ProtocolError("joint positions are not finite")
        if not self._measurements or joints.t_ns > self._measurements[-1].t_ns:
            self._measurements.append(JointMeasurement(joints.t_ns, position))
        return joints.watermark_ns

    def latest(self, t_ns: int) -> JointMeasurement:
        """Return the newest measurement up to `t_ns`, older ones are dropped; one must have arrived.

        A source whose sensor has paused closes its periods with the measurement that it had: the age of the
        measurement, not of the message, tells.
        """
        waiting = self._measurements
        while len(waiting) > 1 and waiting[1].t_ns <= t_ns:
            waiting.popleft()
        return waiting[0]


def decode_joint_ranges(payload: bytes, n_dofs: int) -> NDArray[np.float64]:
    """Decode the position limits (D, 2) of the joints, infinite without a limit.

    Raises:
        ProtocolError: the message is malformed, of the wrong length, or has a limit that is no number.
    """
    ranges = decode(payload, JointRanges)
    if not len(ranges.lowest_rad) == len(ranges.highest_rad) == n_dofs:
        raise ProtocolError(
            f"joint ranges have {len(ranges.lowest_rad)} lowest and {len(ranges.highest_rad)} highest "
            f"positions; expected {n_dofs} of each"
        )
    range_rad = np.array([ranges.lowest_rad, ranges.highest_rad], dtype=np.float64).T
    if not (range_rad[:, 0] <= range_rad[:, 1]).all():
        raise ProtocolError("a joint range is empty: its lowest position must not exceed its highest")
    return range_rad


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
