"""Interface of the exploration programs, and the position controller that they share.

They need revolute DoFs, velocity commands, position feedback and accelerations, and no model [M14, II.B].
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Exploration", "PositionControl"]


class Exploration(Protocol):
    """Exploration program: a state machine without I/O, ticked by a control loop until it is done."""

    @property
    def done(self) -> bool:
        """True once the program is complete and its result available."""

    @property
    def needs_stream(self) -> bool:
        """True while the accelerations of all cells are needed."""

    @property
    def progress(self) -> float:
        """Completed fraction of the program, 0 to 1."""

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""

    def add_samples(
        self, cells: NDArray[np.int64], t_sampled_ns: NDArray[np.int64], acceleration_g: NDArray[np.float64]
    ) -> None:
        """Add accelerations (n, 3) of cells (n,) [g, cell frames], with their sampling times (n,)."""


@dataclass(frozen=True)
class PositionControl:
    """Proportional position control of all DoFs by velocity commands; all three numbers are assumptions.

    With a loop delay T (command, servo, feedback) there is no overshoot while gain × T < 1/e.
    """

    speed_rad_s: float = 0.4
    gain_1_s: float = 15.0
    tolerance_rad: float = 1e-3

    def velocity(
        self, target_rad: NDArray[np.float64], position_rad: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Compute the velocity (D,) [rad/s] towards the target; zero within the tolerance, to keep still."""
        error = target_rad - position_rad
        velocity = np.clip(self.gain_1_s * error, -self.speed_rad_s, self.speed_rad_s)
        return np.where(np.abs(error) > self.tolerance_rad, velocity, 0.0)
