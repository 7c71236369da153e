"""What the model says of the robot: the yardstick for what the skin found out by itself."""

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinnet.body.kinematics import jacobian, moved_by, put_into
from skinnet.body.simulation import Body
from skinnet.deployment import Deployment

__all__ = ["Truth"]


class Truth:
    """The robot's true structure and kinematics; nothing of it ever reaches the controller."""

    def __init__(self, deployment: Deployment, base: Path) -> None:
        self._deployment, self._base = deployment, base

    @cached_property
    def _body(self) -> Body:
        return Body(self._deployment, self._base)

    @property
    def activity(self) -> NDArray[np.bool_]:
        """(S, D): does DoF d move cell s."""
        return moved_by(self._body)

    def cell_jacobian(self, pose_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """(S, D, 3) [m/rad]: velocity of every cell per velocity of every DoF, frames of the cells."""
        put_into(self._body, pose_rad)
        return jacobian(self._body)
