"""Model reference for self-organisation metrics: structure and kinematics from the MJCF model."""

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinnet.body.ground_truth.cell_kinematics import activity_matrix, cell_jacobian, set_joint_positions
from skinnet.body.simulation import BodySimulation
from skinnet.deployment import Deployment

__all__ = ["ModelReference"]


class ModelReference:
    """Ground-truth structure and kinematics of the robot; never available to the controller."""

    def __init__(self, deployment: Deployment, base: Path) -> None:
        self._deployment, self._base = deployment, base

    @cached_property
    def _body(self) -> BodySimulation:
        return BodySimulation(self._deployment, self._base)

    @property
    def activity(self) -> NDArray[np.bool_]:
        """Activity matrix, (S, D): True if DoF d moves cell s."""
        return activity_matrix(self._body)

    def cell_jacobian(self, pose_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cell Jacobian (S, D, 3) [m/rad] at `pose_rad`, in the frames of the cells."""
        set_joint_positions(self._body, pose_rad)
        return cell_jacobian(self._body)
