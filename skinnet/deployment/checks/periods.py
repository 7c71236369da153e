"""Checks of periods: multiples of the physics timestep, alike at both ends, and free of deadlock."""

import math

from skinnet.deployment.deployment import Deployment
from skinnet.errors import DeploymentError

__all__ = ["check_periods"]


def check_periods(deployment: Deployment) -> None:
    """Check the periods of body, cells, boards and controller, and the command delay.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    _check_multiples(deployment)
    _check_alike(deployment)
    _check_command_delay(deployment)


def _check_multiples(deployment: Deployment) -> None:
    body, control = deployment.body, deployment.controller
    for key, value_ns in (
        ("body.stimulus_period_ms", body.stimulus_period_ns),
        ("body.joint_state_period_ms", body.joint_state_period_ns),
        ("controller.period_ms", control.period_ns),
        ("controller.command_delay_ms", control.command_delay_ns),
    ):
        if body.timestep_ns == 0 or value_ns % body.timestep_ns or value_ns == 0:
            raise DeploymentError(
                f"{key} = {value_ns / 1e6:g}: must be a whole multiple of "
                f"body.timestep_ms = {body.timestep_ms:g}"
            )


def _check_alike(deployment: Deployment) -> None:
    body, control = deployment.body, deployment.controller
    if deployment.cells.period_ns != body.stimulus_period_ns:
        raise DeploymentError(
            f"cells.period_ms = {deployment.cells.period_ms:g}: cells sample once per stimulus; "
            f"set it and body.stimulus_period_ms = {body.stimulus_period_ms:g} alike"
        )
    if deployment.sheets and deployment.boards.period_ns != body.stimulus_period_ns:
        raise DeploymentError(
            f"boards.period_ms = {deployment.boards.period_ms:g}: boards scan once per stimulus; "
            f"set it and body.stimulus_period_ms = {body.stimulus_period_ms:g} alike"
        )
    if body.joint_state_period_ns != control.period_ns:
        raise DeploymentError(
            f"controller.period_ms = {control.period_ms:g}: the controller runs once per joint state; "
            f"set it and body.joint_state_period_ms = {body.joint_state_period_ms:g} alike"
        )


def _check_command_delay(deployment: Deployment) -> None:
    """Check that body and controller, under conservative synchronisation, cannot deadlock."""
    control, stimulus_ns = deployment.controller, deployment.body.stimulus_period_ns
    min_delay_ns = stimulus_ns - math.gcd(stimulus_ns, control.period_ns)
    if control.command_delay_ns < min_delay_ns:
        raise DeploymentError(
            f"controller.command_delay_ms = {control.command_delay_ns / 1e6:g}: body and controller would "
            f"wait for each other; at least {min_delay_ns / 1e6:g} with these periods"
        )
