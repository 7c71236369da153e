"""Evasive joint motion of each cell: predicted from the Jacobian, replaced by the observed motion.

The prediction is the ideal sensory-motor map by equation (2) of [M14, III.B]: the weight of a DoF is the
fraction of the cell's velocity, in the cell frame, that is along its normal when that DoF moves; positive
weights move the cell inwards, and a cell's weights have norm one.
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.ground_truth.cell_kinematics import SkinState, cell_jacobian
from skinnet.pinned_linalg import norm

__all__ = ["Evasion", "ideal_sensory_motor_map"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MIN_WEIGHT_NORM = 0.1
"""Minimum norm of a cell's weights; below it the cell cannot move along its normal (assumed)."""
_MIN_LEVER_M = 1e-3
"""Minimum cell motion per joint motion [m/rad]; a DoF below it does not move the cell (assumed)."""
_MIN_OBSERVED_MOTION_RAD = 0.02
"""Minimum joint motion [rad] that counts as an observation of a cell's evasion (assumed)."""
_LIMIT_MARGIN_RAD = 0.005
"""Distance to a joint limit [rad] below which the joint does not move towards it."""


def ideal_sensory_motor_map(jacobian_m: Floats) -> Floats:
    """Ideal sensory-motor map (n, D) from the cell Jacobian `jacobian_m` (n, D, 3) [m/rad], cell frames.

    Rows have norm one, or zero where a cell cannot move along its normal [M14, (2)].
    """
    total = np.abs(jacobian_m).sum(axis=2)
    shares = np.divide(-jacobian_m[:, :, 2], total, out=np.zeros(total.shape), where=total > _MIN_LEVER_M)
    norm = np.linalg.norm(shares, axis=1, keepdims=True)
    weights: Floats = np.divide(shares, norm, out=np.zeros_like(shares), where=norm > _MIN_WEIGHT_NORM)
    return weights


class Evasion:
    """Evasive joint motion of each cell: the model's prediction until one has been observed."""

    def __init__(self, skin: SkinState) -> None:
        """Initialise the evasion of the cells of `skin` with the ideal map."""
        self._skin = skin
        self._observed: dict[int, Floats] = {}

    def position_rad(self) -> Floats:
        """Joint positions (D,) of the controlled joints [rad], a copy."""
        position_rad: Floats = self._skin.data.qpos[self._skin.model.qpos_address]
        return position_rad

    def directions(self, rows: Indices) -> Floats:
        """Evasive joint directions (r, D) of the cells `rows` now: norm one, smaller at joint limits."""
        result = ideal_sensory_motor_map(cell_jacobian(self._skin, rows))
        for index, row in enumerate(rows.tolist()):
            result[index] = self._observed.get(row, result[index])
        position_rad, (lowest, highest) = self.position_rad(), self._skin.model.range_rad.T
        up = np.where(position_rad > highest - _LIMIT_MARGIN_RAD, 0.0, np.inf)
        down = np.where(position_rad < lowest + _LIMIT_MARGIN_RAD, 0.0, -np.inf)
        return np.clip(result, down, up)

    def observe(self, row: int, joint_motion_rad: Floats) -> bool:
        """Observe the joint motion (D,) [rad] since the finger approached a cell; False if too small."""
        jacobian_m = cell_jacobian(self._skin, np.array([row]))[0]
        its_own_rad = np.where(jacobian_m.any(axis=1), joint_motion_rad, 0.0)
        length_rad = norm(its_own_rad)
        if length_rad < _MIN_OBSERVED_MOTION_RAD:
            return False
        self._observed[row] = its_own_rad / length_rad
        return True

    def mark_unresponsive(self, row: int) -> None:
        """Record zero evasion for a cell: it does not evade."""
        self._observed[row] = np.zeros(len(self._skin.model.dof_address))
