"""Velocity sine that the exploration of the sensory-motor map applies to a joint."""

import math
from dataclasses import dataclass

from skinnet import pinned_math

__all__ = ["VelocitySine"]

_SAMPLES_PER_PERIOD = 64


@dataclass(frozen=True)
class VelocitySine:
    """Velocity sine with a symmetric envelope over a whole number of periods.

    Velocity and acceleration begin and end at zero, and the position returns to its start.
    """

    amplitude_rad_s: float
    frequency_hz: float
    periods: int
    """Number of periods at full amplitude."""
    ramp_periods: int
    """Number of periods of each ramp, before and after."""

    @property
    def ramp_ns(self) -> int:
        """Duration [ns] of each ramp."""
        return round(1e9 * self.ramp_periods / self.frequency_hz)

    @property
    def full_ns(self) -> int:
        """Duration [ns] at full amplitude."""
        return self.duration_ns - 2 * self.ramp_ns

    @property
    def duration_ns(self) -> int:
        """Duration [ns] with both ramps."""
        return round(1e9 * self.periods / self.frequency_hz) + 2 * self.ramp_ns

    def velocity_rad_s(self, t_s: float) -> float:
        """Return the velocity [rad/s] at `t_s` after the start."""
        to_end_s = min(t_s, self.duration_ns * 1e-9 - t_s)
        ramp_s = self.ramp_ns * 1e-9
        fade = 0.5 - 0.5 * pinned_math.cos(math.pi * to_end_s / ramp_s) if to_end_s < ramp_s else 1.0
        return self.amplitude_rad_s * fade * pinned_math.sin(2.0 * math.pi * self.frequency_hz * t_s)

    def reach_rad(self) -> tuple[float, float]:
        """Return the lowest and the highest position [rad], from the start."""
        step_s = 1.0 / (_SAMPLES_PER_PERIOD * self.frequency_hz)
        position_rad = lowest_rad = highest_rad = 0.0
        for sample in range((self.ramp_periods + 1) * _SAMPLES_PER_PERIOD):
            position_rad += self.velocity_rad_s(sample * step_s) * step_s
            lowest_rad, highest_rad = min(lowest_rad, position_rad), max(highest_rad, position_rad)
        return lowest_rad, highest_rad
