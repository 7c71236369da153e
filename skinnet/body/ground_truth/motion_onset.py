"""Motion onset ground truth: when a command set the resting robot in motion, and when it truly moved."""

import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import dot

__all__ = ["MotionOnsets"]

Floats = NDArray[np.float64]

_MOVING_FRACTION = 0.1
"""Fraction of the commanded speed from which a robot counts as moving: well above what a servo at rest
trembles, well before it has reached its speed (assumed)."""


class MotionOnsets:
    """Onsets of commanded motion from rest.

    The speed is that of all joints along the commanded velocity u: q̇·u / |u|. A command begins a motion if
    the one before was zero and the robot is slower than the threshold; a robot that coasts has no onset.

    Attributes:
        onsets: Time at which the body put each such command into effect, and time of the first motion [ns],
            interpolated between two physics steps; the second is None if the command ended before the robot
            moved.
    """

    def __init__(self) -> None:
        self.onsets: list[tuple[int, int | None]] = []
        self._command_rad_s: Floats = np.zeros(0)
        self._pending = False
        self._last: tuple[int, Floats] = (0, np.zeros(0))

    @property
    def is_pending(self) -> bool:
        """True while a motion is commanded that has not begun."""
        return self._pending

    def begin_command(self, t_ns: int, command_rad_s: Floats, velocity_rad_s: Floats) -> None:
        """Begin a command (D,) [rad/s] at `t_ns` [ns], with the robot's true velocity (D,) [rad/s] there."""
        was_zero = not self._command_rad_s.any()
        self._command_rad_s = command_rad_s.copy()
        self._last = (t_ns, velocity_rad_s)
        if not command_rad_s.any():
            self._pending = False
        elif was_zero and self._speed(velocity_rad_s) < _MOVING_FRACTION:
            self.onsets.append((t_ns, None))
            self._pending = True

    def observe(self, t_ns: int, step_ns: int, velocity_rad_s: Floats) -> bool:
        """Observe the true velocity (D,) [rad/s] of the step to `t_ns` [ns]; return True if motion has begun.

        A step moves by its velocity, which is hence the mean over the step: the velocity of its middle.
        """
        if not self._pending:
            return False
        middle_ns = t_ns - step_ns // 2
        (before_ns, before), self._last = self._last, (middle_ns, velocity_rad_s)
        low, high = self._speed(before), self._speed(velocity_rad_s)
        if high < _MOVING_FRACTION:
            return False
        share = max(0.0, (_MOVING_FRACTION - low) / (high - low)) if high > low else 0.0
        self.onsets[-1] = (self.onsets[-1][0], before_ns + round(share * (middle_ns - before_ns)))
        self._pending = False
        return True

    def facts(self) -> list[tuple[int, int | None]]:
        """Onsets as facts: command in effect, first motion [ns]."""
        return list(self.onsets)

    def _speed(self, velocity_rad_s: Floats) -> float:
        """Speed along the command, as a fraction of the commanded one."""
        command = self._command_rad_s
        return dot(velocity_rad_s, command) / dot(command, command)
