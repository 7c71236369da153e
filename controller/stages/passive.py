"""Passive recording stage, without motion."""

import numpy as np
from numpy.typing import NDArray

from controller.stages.timed import TimedStage
from controller.touch.tactile_state import TactileState

__all__ = ["PassiveStage"]


class PassiveStage(TimedStage):
    """Passive stage: collects skin data while the robot holds still."""

    gains = None
    thresholds = None
    tactile_input = None

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], tactile_state: TactileState
    ) -> NDArray[np.float64]:
        """Return zero velocities (D,) [rad/s]."""
        self._t_ns = t_ns
        return np.zeros(len(position_rad))
