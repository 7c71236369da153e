"""Joint position, velocity and acceleration limits as bounds on the step of one period."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["JointLimits"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Joint limits of N joints; infinite where there is none."""

    position_range: Floats
    """Position range (N, 2) of measured positions [rad, m for a slide]."""
    max_speed: Floats
    """Speed limits (N,) [rad/s]."""
    max_acceleration: Floats
    """Acceleration limits (N,) [rad/s²]."""

    def __post_init__(self) -> None:
        n = len(self.max_speed)
        if not (
            self.position_range.shape == (n, 2)
            and self.max_speed.shape == self.max_acceleration.shape == (n,)
        ):
            raise ValueError(
                f"limits of {n} joints: ranges {self.position_range.shape}, "
                f"accelerations {self.max_acceleration.shape}"
            )
        if not (
            (self.position_range[:, 0] < self.position_range[:, 1]).all() and (self.max_speed > 0.0).all()
        ):
            raise ValueError(
                "joint limits: the lower position limit must be below the upper, speed limits above zero"
            )
        if not (self.max_acceleration > 0.0).all():
            raise ValueError("joint limits: acceleration limits must be above zero")

    def step_bounds(self, q: Floats, last_step: Floats, period_s: float) -> tuple[Floats, Floats]:
        """Return smallest and largest steps (N,) [rad] from `q` (N,) in one period, after `last_step` (N,).

        A joint brakes early enough to stop at its position limit within its acceleration limit. Beyond a
        limit only steps back are allowed. The bounds are never empty: position and velocity limits take
        precedence over the acceleration limit.
        """
        fastest = self.max_speed * period_s
        lowest = np.clip(-self._max_step_towards(q - self.position_range[:, 0], period_s), -fastest, fastest)
        highest = np.clip(self._max_step_towards(self.position_range[:, 1] - q, period_s), -fastest, fastest)
        change = self.max_acceleration * (period_s * period_s)
        return np.clip(last_step - change, lowest, highest), np.clip(last_step + change, lowest, highest)

    def _max_step_towards(self, distance: Floats, period_s: float) -> Floats:
        """Return the largest step towards a limit at this distance; negative beyond the limit.

        A joint whose step x decreases by aΔt² each period stops after k steps, having moved by
        k x - aΔt² k (k - 1) / 2; x is the largest step for which that equals the distance.
        """
        braking = np.isfinite(self.max_acceleration) & np.isfinite(distance) & (distance > 0.0)
        change = np.where(braking, self.max_acceleration * (period_s * period_s), 1.0)
        way = np.where(braking, distance, 0.0)
        count = np.maximum(np.ceil(0.5 * (np.sqrt(1.0 + 8.0 * way / change) - 1.0)), 1.0)
        return np.where(braking, way / count + 0.5 * change * (count - 1.0), distance)
