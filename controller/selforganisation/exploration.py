"""What the motion programs have in common, by which the skin finds out about its robot.

They need rotatory DoFs, velocity commands, position feedback and accelerations, and no model [M14, II.B].
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Exploration", "Hold"]


class Exploration(Protocol):
    """A motion program: a state machine without I/O that a control loop ticks until it is done."""

    @property
    def done(self) -> bool:
        """The program is at its end; its result is there."""

    @property
    def wants_stream(self) -> bool:
        """The accelerations of all cells are needed now."""

    @property
    def progress(self) -> float:
        """Share of the program that is done, 0 to 1."""

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""

    def add_samples(
        self, cells: NDArray[np.int64], t_sampled_ns: NDArray[np.int64], acceleration_g: NDArray[np.float64]
    ) -> None:
        """Takes in accelerations (n, 3) of cells (n,) [g, cell frames], with their sample times (n,)."""


@dataclass(frozen=True)
class Hold:
    """Position control of all DoFs with velocity commands; assumptions, all three.

    With a loop delay T (command, servo, feedback) the way to a target has no overshoot while gain × T < 1/e.
    """

    speed_rad_s: float = 0.4
    gain_1_s: float = 15.0
    tolerance_rad: float = 1e-3

    def velocity(
        self, target_rad: NDArray[np.float64], position_rad: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Velocity (D,) towards the target; zero within the tolerance, so that the skin is at rest."""
        error = target_rad - position_rad
        velocity = np.clip(self.gain_1_s * error, -self.speed_rad_s, self.speed_rad_s)
        return np.where(np.abs(error) > self.tolerance_rad, velocity, 0.0)
