"""Checks of servos: joints with values of their own, and frequencies that the physics can follow."""

import math

from skinnet.deployment.deployment import Deployment
from skinnet.errors import DeploymentError
from skinnet.suggestions import known_names

__all__ = ["check_servos"]

_LARGEST_PHASE = 0.5
"""Largest phase 2πf Δt of a servo in one physics step: its frequency is then met within 2 % (assumed)."""


def check_servos(deployment: Deployment) -> None:
    """Check the servos of all controlled joints.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    body = deployment.body
    for joint in body.joint_servos:
        if joint not in body.joints:
            raise DeploymentError(
                f'body.joint_servos."{joint}": must be one of body.joints; {known_names(joint, body.joints)}'
            )
    highest_hz = _LARGEST_PHASE / (2.0 * math.pi * 1e-3 * body.timestep_ms)
    for joint in body.joints:
        frequency_hz = body.servo_of(joint).frequency_hz
        if frequency_hz is not None and frequency_hz > highest_hz:
            own = body.joint_servos.get(joint)
            table = "servo" if own is None or own.frequency_hz is None else f'joint_servos."{joint}"'
            raise DeploymentError(
                f"body.{table}.frequency_hz = {frequency_hz:g}: must be at most {highest_hz:.3g} with "
                f"body.timestep_ms = {body.timestep_ms:g}"
            )
