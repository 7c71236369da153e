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
        onsets: Time at which the body put each such command into effect, and time of the first motion [ns];
            the second is None if the command ended before the robot moved.
    """

    def __init__(self) -> None:
        self.onsets: list[tuple[int, int | None]] = []
        self._command_rad_s: Floats = np.zeros(0)
        self._pending = False

    @property
    def is_pending(self) -> bool:
        """True while a motion is commanded that has not begun."""
        return self._pending

    def begin_command(self, t_ns: int, command_rad_s: Floats, velocity_rad_s: Floats) -> None:
        """Begin a command (D,) [rad/s] at `t_ns` [ns], with the robot's true velocity (D,) [rad/s] there."""
        was_zero = not self._command_rad_s.any()
        self._command_rad_s = command_rad_s.copy()
        if not command_rad_s.any():
            self._pending = False
        elif was_zero and not self._moves(velocity_rad_s):
            self.onsets.append((t_ns, None))
            self._pending = True

    def observe(self, t_ns: int, velocity_rad_s: Floats) -> bool:
        """Observe the true velocity (D,) [rad/s] at `t_ns` [ns]; return True if the motion begins here."""
        if not self._pending or not self._moves(velocity_rad_s):
            return False
        self.onsets[-1] = (self.onsets[-1][0], t_ns)
        self._pending = False
        return True

    def facts(self) -> list[tuple[int, int | None]]:
        """Onsets as facts: command in effect, first motion [ns]."""
        return list(self.onsets)

    def _moves(self, velocity_rad_s: Floats) -> bool:
        command = self._command_rad_s
        return bool(dot(velocity_rad_s, command) >= _MOVING_FRACTION * dot(command, command))
