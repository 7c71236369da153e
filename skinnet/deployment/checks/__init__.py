"""Consistency checks across the keys of a deployment that no schema can express."""

from skinnet.deployment.checks.controller import check_controller
from skinnet.deployment.checks.environment import check_environment
from skinnet.deployment.checks.faults import check_faults
from skinnet.deployment.checks.foam import check_foam
from skinnet.deployment.checks.periods import check_periods
from skinnet.deployment.checks.servos import check_servos
from skinnet.deployment.checks.skin import check_skin
from skinnet.deployment.deployment import Deployment

__all__ = ["check"]


def check(deployment: Deployment) -> None:
    """Check the consistency of a deployment, as far as no model is needed.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    check_periods(deployment)
    check_skin(deployment)
    check_controller(deployment)
    check_environment(deployment)
    check_faults(deployment)
    check_foam(deployment)
    check_servos(deployment)
