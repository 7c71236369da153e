"""Passive recording stage, without motion."""

import numpy as np
from numpy.typing import NDArray

from controller.touch.fusion import TactilePicture
from controller.touch.timed import TimedStage

__all__ = ["Listen"]


class Listen(TimedStage):
    """Passive stage: collects skin data while the robot holds still."""

    gains = None
    thresholds = None
    felt = None

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], picture: TactilePicture
    ) -> NDArray[np.float64]:
        """Return zero velocities (D,) [rad/s]."""
        self._t_ns = t_ns
        return np.zeros(len(position_rad))
