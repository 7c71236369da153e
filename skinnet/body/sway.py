"""Postural sway of the reference body, residual of a balancing lower body: one sine per joint (assumed)."""

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.model import BodyModel
from skinnet.body.servos import equilibrium_targets_rad
from skinnet.clock import NS_PER_S
from skinnet.deployment.robot import SwaySpec
from skinnet.random_streams import StreamName, stream_key, uniform

__all__ = ["Sway", "SwayActuation"]

Floats = NDArray[np.float64]


class Sway:
    """Sway trajectory of the sway joints; the seed gives each joint its phase.

    The sine is added to the gravity-compensating servo targets.
    """

    def __init__(self, spec: SwaySpec, seed: int) -> None:
        self.spec = spec
        self._phase_rad = np.array(
            [
                2.0 * math.pi * uniform(stream_key(seed, StreamName.SWAY, joint), np.uint64(0))
                for joint in spec.joints
            ]
        )

    def offsets_rad(self, t_ns: int) -> Floats:
        """Sway offsets (W,) of the sway joints at `t_ns` [rad]."""
        angle_rad = 2.0 * math.pi * self.spec.frequency_hz * t_ns / NS_PER_S
        offsets: Floats = self.spec.amplitude_rad * pinned_math.sin_of(angle_rad + self._phase_rad)
        return offsets


class SwayActuation:
    """Servo targets of the sway joints: sway about the pose that carries the robot's weight."""

    def __init__(self, sway: Sway, model: BodyModel, data: mujoco.MjData) -> None:
        """Set the targets to hold the present pose, that of time zero, in static equilibrium."""
        self._sway, self._ctrl, self._actuator_id = sway, data.ctrl, model.sway_actuator_id
        resting_rad = equilibrium_targets_rad(data, self._actuator_id, model.sway_motion)
        self._neutral_rad = resting_rad - sway.offsets_rad(0)
        self._ctrl[self._actuator_id] = resting_rad

    def advance(self, t_ns: int) -> None:
        """Set the targets of `t_ns` [ns]."""
        self._ctrl[self._actuator_id] = self._neutral_rad + self._sway.offsets_rad(t_ns)
