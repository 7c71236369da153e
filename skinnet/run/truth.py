"""Model reference for self-organisation metrics: structure and kinematics from the MJCF model."""

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinnet.body.kinematics import jacobian, moved_by, put_into
from skinnet.body.simulation import Body
from skinnet.deployment import Deployment

__all__ = ["Truth"]


class Truth:
    """Ground-truth structure and kinematics of the robot; never available to the controller."""

    def __init__(self, deployment: Deployment, base: Path) -> None:
        self._deployment, self._base = deployment, base

    @cached_property
    def _body(self) -> Body:
        return Body(self._deployment, self._base)

    @property
    def activity(self) -> NDArray[np.bool_]:
        """Activity matrix, (S, D): True if DoF d moves cell s."""
        return moved_by(self._body)

    def cell_jacobian(self, pose_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cell Jacobian (S, D, 3) [m/rad] at `pose_rad`, in the frames of the cells."""
        put_into(self._body, pose_rad)
        return jacobian(self._body)
