"""Choice of the servos: one frequency for all joints, and higher ones for those with a light link."""

import math

from skinnet.body.model import BodyModel
from skinnet.body.servo_response import MAX_SAG_PUSHED, servo_response

__all__ = ["DAMPING", "FREQUENCY_HZ", "choose_frequencies"]

FREQUENCY_HZ, DAMPING = 12.0, 0.8
"""Servo that follows the sine of 4 Hz of the map with room to spare (assumed)."""
_MAX_PHASE = 0.45
"""Largest phase 2πf Δt in a physics step, a little below what a deployment may ask for (assumed)."""


def choose_frequencies(model: BodyModel) -> dict[str, float]:
    """Choose frequencies [Hz] for joints that 10 N on their link would turn too far at the usual one.

    The stiffness grows with the square of the frequency, which is rounded up, and ends where the physics step
    would no longer follow it.

    Args:
        model: The robot, with servos of the usual frequency and their loads compensated.
    """
    response = servo_response(model, is_compensated=True)
    most_hz = math.floor(_MAX_PHASE / (2.0 * math.pi * float(model.mj.opt.timestep)))
    ratio = response.sag_pushed_rad / MAX_SAG_PUSHED
    return {
        joint: float(min(math.ceil(FREQUENCY_HZ * math.sqrt(row)), most_hz))
        for joint, row in zip(response.joints, ratio.tolist(), strict=True)
        if row > 1.0 and math.isfinite(row)  # beyond its torque, no stiffness helps
    }
