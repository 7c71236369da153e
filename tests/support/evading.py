"""A stand-in for the robot's own reactions: equation (4) with a perfect map, one control period late."""

import numpy as np

from skinnet.body.ground_truth.cell_kinematics import cell_jacobian
from skinnet.body.teacher.evasion import ideal_sensory_motor_map
from skinnet.deployment.skin.cells import CellSpec
from skinnet.protocol.messages import STIMULUS_NAMES

MS = 1_000_000
_DISTANCE = STIMULUS_NAMES.index("distance_m")
_SPEED_RAD_S = 1.2


class Evader:
    """Drives a body as tactile guidance would, with the gains and thresholds of Table II [M14]."""

    def __init__(self, body, force_gain=0.0, proximity_gain=0.4, fixed_map=False, asleep=()):
        """`fixed_map`: the map of the first pose, as a robot that explored no other; `asleep`: dead cells."""
        self._body, self._force_gain, self._proximity_gain = body, force_gain, proximity_gain
        self._map = ideal_sensory_motor_map(cell_jacobian(body)) if fixed_map else None
        self._asleep = list(asleep)
        self._due = np.zeros(body.n_dofs)

    def run(self, until_ns):
        """Until then, or until the last lesson is over."""
        body = self._body
        while body.t_ns < until_ns and not self._taught():
            activation = self._activation(body.stimulus())
            velocity = np.zeros(body.n_dofs)
            if activation.any():
                velocity = activation @ (
                    ideal_sensory_motor_map(cell_jacobian(body)) if self._map is None else self._map
                )
            velocity *= min(1.0, _SPEED_RAD_S / max(np.abs(velocity).max(), 1e-9))
            body.set_command(self._due)
            self._due = velocity
            body.advance(body.t_ns + 5 * MS)

    def _taught(self):
        lessons = self._body.teacher.outcome.lessons
        return bool(lessons) and lessons[-1].end_ns is not None

    def _activation(self, stimulus):
        cells = CellSpec()
        readings = np.interp(stimulus[:, :3], cells.force.calibration_n, cells.force.calibration_reading)
        force = np.where(readings > 0.05, readings - 0.05, 0.0).sum(axis=1)
        root = np.sqrt(cells.proximity.reading_at_range)
        d0_m = cells.proximity.range_m * root / (1.0 - root)
        near = (d0_m / (d0_m + stimulus[:, _DISTANCE])) ** 2
        activation = self._force_gain * force + self._proximity_gain * np.where(near > 0.01, near - 0.01, 0.0)
        activation[self._asleep] = 0.0
        return activation
