"""Names by which the world knows what the controller does: stages of its program, states of sessions."""

from typing import get_args

from skinnet.deployment.schema import ControllerSpec
from skinnet.deployment.session import StateName
from skinnet.errors import DeploymentError

__all__ = ["require_stage"]


def require_stage(key: str, name: str, control: ControllerSpec) -> None:
    """Refuses a `name` under `key` that is neither a stage nor, as in `session.hold`, a state of a session.

    Raises:
        DeploymentError: names what there is.
    """
    known = list(control.stages)
    for stage, spec in control.stages.items():
        if spec.kind == "session":
            known += [f"{stage}.{state}" for state in get_args(StateName)]
    if name not in known:
        raise DeploymentError(f"{key} = {name!r}: unknown stage; there are {', '.join(known) or 'none'}")
