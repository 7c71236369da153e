"""Postural sway of the reference body, residual of a balancing lower body: one sine per joint (assumed)."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.clock import NS_PER_S
from skinnet.deployment.robot import SwaySpec
from skinnet.random_streams import StreamName, stream_key, uniform

__all__ = ["Sway"]

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
        offsets: Floats = self.spec.amplitude_rad * np.sin(angle_rad + self._phase_rad)
        return offsets
