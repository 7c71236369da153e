"""Safety clamp between controller and joints: bounds every commanded velocity."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.controller.controller import SafetySpec

__all__ = ["SafetyClamp", "SafetyCounters", "SafetyLimits"]


@dataclass(frozen=True, eq=False)
class SafetyLimits:
    """Safety limits of the joints; all numbers are assumptions, to be set for a robot."""

    speed_rad_s: float = 1.0
    """Speed limit of every joint."""
    acceleration_rad_s2: float | None = None
    """Acceleration limit of every joint, between two ticks; None: unlimited."""
    position_rad: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    """Position limits, lowest and highest (D,), if known; ±inf for a joint without."""
    slow_zone_rad: float = 0.1
    """Distance to a position limit within which the speed towards it falls linearly to zero."""
    joints_max_age_ns: int = 50_000_000
    """Age [ns] beyond which position feedback is stale: ten control periods."""
    skin_max_age_ns: int = 50_000_000
    """Age [ns] of the skin's watermark beyond which the skin data is stale."""
    ramp_ns: int = 100_000_000
    """Ramp duration [ns] from full speed to rest when an input is stale, and back when it is fresh again."""

    @classmethod
    def from_spec(cls, safety: SafetySpec) -> Self:
        """Return the limits of a deployment, one timeout for positions and skin."""
        timeout_ns = round(safety.input_timeout_ms * 1e6)
        return cls(
            speed_rad_s=safety.max_joint_speed_rad_s,
            joints_max_age_ns=timeout_ns,
            skin_max_age_ns=timeout_ns,
            ramp_ns=round(safety.ramp_ms * 1e6),
        )


@dataclass(frozen=True)
class SafetyCounters:
    """Tick counters of the safety clamp."""

    ticks: int = 0
    clamped: int = 0
    """Ticks in which the speed, acceleration or position limit changed the command."""
    stale_ticks: int = 0
    non_finite: int = 0
    """Ticks with a command or a position that is not finite."""


class SafetyClamp:
    """Safety clamp of the summed velocity command, applied at every tick.

    In this order: a command that is not finite becomes zero; the speed limit scales all joints alike, so that
    the direction is kept; stale input ramps to rest and holds; the acceleration limit scales the change;
    position limits slow each joint individually, and override the acceleration limit.
    """

    def __init__(self, limits: SafetyLimits, n_dofs: int, period_ns: int) -> None:
        """Start at rest; `period_ns` is the time between two ticks.

        Raises:
            ValueError: a limit is not positive, or the position limits are not (D,), lowest below highest.
        """
        numbers = [limits.speed_rad_s, limits.slow_zone_rad, limits.ramp_ns, period_ns]
        if limits.acceleration_rad_s2 is not None:
            numbers.append(limits.acceleration_rad_s2)
        if not all(0.0 < number < np.inf for number in numbers):
            raise ValueError(f"safety limits must be positive and finite: {limits}, period {period_ns} ns")
        if limits.position_rad is not None:
            lowest, highest = limits.position_rad
            if not (lowest.shape == highest.shape == (n_dofs,) and (lowest < highest).all()):
                raise ValueError(
                    f"position limits must be two arrays of shape ({n_dofs},), the lower below the upper"
                )
        self._limits, self._n_dofs, self._period_ns = limits, n_dofs, period_ns
        self._last_velocity_rad_s = np.zeros(n_dofs)
        self._ramp_scale = 1.0
        self.stale = False
        """True if the last tick's input was too old."""
        self.counters = SafetyCounters()

    @property
    def n_dofs(self) -> int:
        """Number of joints D."""
        return self._n_dofs

    def clamp(
        self,
        t_ns: int,
        velocity_rad_s: NDArray[np.float64],
        position_rad: NDArray[np.float64],
        t_joints_ns: int | None,
        t_skin_ns: int | None,
    ) -> NDArray[np.float64]:
        """Return the clamped joint velocities (D,) [rad/s].

        Args:
            t_ns: Time of the tick.
            velocity_rad_s: (D,) sum of all commanded velocities.
            position_rad: (D,) newest measured positions.
            t_joints_ns: Time at which they were measured; None if never.
            t_skin_ns: Lowest watermark of all patches; None if there is none.

        Raises:
            ValueError: the shapes are not (D,).
        """
        if not (velocity_rad_s.shape == position_rad.shape == (self._n_dofs,)):
            raise ValueError(
                f"velocity has shape {velocity_rad_s.shape} and position {position_rad.shape}; expected "
                f"({self._n_dofs},)"
            )
        limits, counters = self._limits, self.counters
        finite = bool(np.isfinite(velocity_rad_s).all() and np.isfinite(position_rad).all())
        self.stale = _is_stale(t_ns, t_joints_ns, limits.joints_max_age_ns) or _is_stale(
            t_ns, t_skin_ns, limits.skin_max_age_ns
        )
        self._ramp(finite)

        wanted = velocity_rad_s if finite else np.zeros(self._n_dofs)
        velocity = self._limit_acceleration(_scale_to_limit(wanted, limits.speed_rad_s) * self._ramp_scale)
        if finite:
            velocity = self._limit_near_bounds(velocity, position_rad)
        # rounding may exceed the limit by one ulp
        velocity = np.clip(velocity, -limits.speed_rad_s, limits.speed_rad_s)
        self._last_velocity_rad_s = velocity
        self.counters = replace(
            counters,
            ticks=counters.ticks + 1,
            clamped=counters.clamped
            + bool(finite and not np.array_equal(velocity, wanted * self._ramp_scale)),
            stale_ticks=counters.stale_ticks + self.stale,
            non_finite=counters.non_finite + (not finite),
        )
        return velocity.copy()

    def _ramp(self, finite: bool) -> None:
        """Update the ramp's scale factor: zero without a finite command, falling while stale, else rising."""
        step = self._period_ns / self._limits.ramp_ns
        if not finite:
            self._ramp_scale = 0.0
        elif self.stale:
            self._ramp_scale = max(0.0, self._ramp_scale - step)
        else:
            self._ramp_scale = min(1.0, self._ramp_scale + step)

    def _limit_acceleration(self, target_rad_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Step the last velocity towards the target, within the acceleration limit."""
        if self._limits.acceleration_rad_s2 is None:
            return target_rad_s
        change = target_rad_s - self._last_velocity_rad_s
        return self._last_velocity_rad_s + _scale_to_limit(
            change, self._limits.acceleration_rad_s2 * self._period_ns * 1e-9
        )

    def _limit_near_bounds(
        self, velocity_rad_s: NDArray[np.float64], position_rad: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Slow velocities towards the position limits, to zero beyond them; motion away is unrestricted."""
        if self._limits.position_rad is None:
            return velocity_rad_s
        lowest, highest = self._limits.position_rad
        per_rad = self._limits.speed_rad_s / self._limits.slow_zone_rad
        with np.errstate(over="ignore"):
            down = -per_rad * np.maximum(position_rad - lowest, 0.0)
            up = per_rad * np.maximum(highest - position_rad, 0.0)
        return np.clip(velocity_rad_s, down, up)


def _scale_to_limit(vector: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    """Scale a vector so that no component exceeds `limit`; the direction is kept."""
    size = float(np.abs(vector).max(initial=0.0))
    return vector if size <= limit else vector * (limit / size)


def _is_stale(t_ns: int, t_input_ns: int | None, max_age_ns: int) -> bool:
    return t_input_ns is None or t_ns - t_input_ns > max_age_ns
