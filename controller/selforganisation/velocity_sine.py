"""Velocity sine that the exploration of the sensory-motor map applies to a joint."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from controller.selforganisation.exploration import CLEARANCE, MIN_SCALE
from skinnet import pinned_math

__all__ = ["SinePlace", "VelocitySine"]

_SAMPLES_PER_PERIOD = 64


class SinePlace(NamedTuple):
    """Place of a sine: where it begins, from home [rad], and its scale, negative if it is mirrored."""

    offset_rad: float
    scale: float


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

    def places(self, lowest_rad: float, highest_rad: float) -> list[SinePlace]:
        """Find the places nearest to home within the limits `lowest_rad` and `highest_rad` from home.

        Returns:
            That of the sine and that of the mirrored one; none without room for half of it.
        """
        below_rad, above_rad = self.extremes_rad()
        clearance_rad = CLEARANCE * (above_rad - below_rad)
        room_rad = highest_rad - lowest_rad - 2.0 * clearance_rad
        size = min(1.0, room_rad / (above_rad - below_rad))
        if size < MIN_SCALE:
            return []
        places = []
        for sign, low_rad, high_rad in ((1.0, below_rad, above_rad), (-1.0, -above_rad, -below_rad)):
            least_rad = lowest_rad + clearance_rad - size * low_rad
            most_rad = highest_rad - clearance_rad - size * high_rad
            places.append(SinePlace(min(max(0.0, least_rad), most_rad), sign * size))
        return places

    def extremes_rad(self) -> tuple[float, float]:
        """Return the lowest and the highest position [rad], from the start."""
        step_s = 1.0 / (_SAMPLES_PER_PERIOD * self.frequency_hz)
        position_rad = lowest_rad = highest_rad = 0.0
        for sample in range((self.ramp_periods + 1) * _SAMPLES_PER_PERIOD):
            position_rad += self.velocity_rad_s(sample * step_s) * step_s
            lowest_rad, highest_rad = min(lowest_rad, position_rad), max(highest_rad, position_rad)
        return lowest_rad, highest_rad
