"""Stage name checks: stages of the controller's program and states of teach-and-grasp."""

from typing import get_args

from skinnet.deployment.controller.teach_and_grasp import StateName
from skinnet.deployment.deployment import ControllerSpec
from skinnet.errors import DeploymentError
from skinnet.suggestions import known_names

__all__ = ["check_stage_name"]


def check_stage_name(key: str, name: str, controller: ControllerSpec) -> None:
    """Check that `name` under `key` is a stage, or a state of one as in `session.hold`.

    Raises:
        DeploymentError: names the known stages and states.
    """
    known = list(controller.stages)
    for stage, spec in controller.stages.items():
        if spec.kind == "teach_and_grasp":
            known += [f"{stage}.{state}" for state in get_args(StateName)]
    if name not in known:
        raise DeploymentError(f"{key} = {name!r}: unknown stage; {known_names(name, known)}")
