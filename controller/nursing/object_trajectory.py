"""Desired object trajectory x_O^d(t), R_O^d(t): minimum-jerk motion through waypoints."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import matmul
from skinnet.pinned_rotations import rotation_matrices, rotation_vectors

__all__ = ["ObjectTrajectory", "Waypoint", "minimum_jerk"]

Floats = NDArray[np.float64]


class Waypoint(NamedTuple):
    """Desired object pose at a time, relative to the initial pose."""

    t_ns: int
    displacement_m: tuple[float, float, float]
    """Displacement x_O^d - x_O(0), world frame [m]."""
    rotation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector, world frame [rad]; R_O(0) is the identity, equation (1) [R11]."""


def minimum_jerk(fraction: float) -> float:
    """Return the minimum-jerk path fraction at a fraction of the time (Flash and Hogan, 1985)."""
    s = min(max(fraction, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


class ObjectTrajectory:
    """Object trajectory of straight lines and single-axis rotations, at rest at every waypoint."""

    def __init__(self, waypoints: Sequence[Waypoint]) -> None:
        """Start at time zero without displacement.

        Raises:
            ValueError: no waypoint, times not increasing from above zero, or a value that is not finite.
        """
        times = [0, *(point.t_ns for point in waypoints)]
        if not waypoints or any(b <= a for a, b in itertools.pairwise(times)):
            raise ValueError(
                f"waypoints at {times[1:]} ns: give at least one, with times increasing from above zero"
            )
        self._t_ns = times
        self._position_m = np.array([(0.0, 0.0, 0.0), *(point.displacement_m for point in waypoints)])
        rotation_rad = np.array([(0.0, 0.0, 0.0), *(point.rotation_rad for point in waypoints)])
        if not (np.isfinite(self._position_m).all() and np.isfinite(rotation_rad).all()):
            raise ValueError("waypoints: displacements and rotations must be finite")
        self._R = rotation_matrices(rotation_rad)
        self._rotation_step_rad = rotation_vectors(matmul(self._R[:-1].transpose(0, 2, 1), self._R[1:]))

    @property
    def end_ns(self) -> int:
        """Time of the last waypoint [ns]."""
        return self._t_ns[-1]

    def pose_at(self, t_ns: int) -> tuple[Floats, Floats]:
        """Return x_O^d(t) - x_O(0) (3,) [m] and R_O^d(t) (3, 3), world frame; constant after `end_ns`."""
        leg = int(np.searchsorted(self._t_ns[1:-1], t_ns, side="right"))
        start_ns, end_ns = self._t_ns[leg], self._t_ns[leg + 1]
        way = minimum_jerk((t_ns - start_ns) / (end_ns - start_ns))
        position_m = (1.0 - way) * self._position_m[leg] + way * self._position_m[leg + 1]
        turn = rotation_matrices(way * self._rotation_step_rad[leg : leg + 1])[0]
        return position_m, matmul(self._R[leg], turn)
