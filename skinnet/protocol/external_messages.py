"""Messages of external clients at the observer endpoint: deployment info, added joint velocities."""

from skinnet.protocol.messages import Message

__all__ = ["DeploymentInfo", "ExternalVelocity"]


class ExternalVelocity(Message, frozen=True, kw_only=True, tag="velocity"):
    """External joint velocities [rad/s], added to the controller's command, (n_dof,) in joint order.

    They hold for 100 ms of simulated time unless newer ones arrive. The safety clamp limits the sum. A run
    accepts them only if `controller.external_velocity` is set.
    """

    velocity_rad_s: list[float]


class DeploymentInfo(Message, frozen=True, kw_only=True, tag="deployment_info"):
    """Deployment of a run as JSON, as in its run folder; its relative paths start from `base_folder`."""

    deployment: str
    base_folder: str
