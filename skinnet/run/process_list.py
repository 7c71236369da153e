"""Process list of a run; packages are named by string, so that the core imports none of them."""

from dataclasses import dataclass

from skinnet.deployment import Deployment
from skinnet.protocol.channels import RECORDER, Role

__all__ = ["ProcessSpec", "process_list"]


@dataclass(frozen=True)
class ProcessSpec:
    """Process specification: `python -m <module>` with a process name."""

    name: str
    role: Role
    module: str
    loss_tolerated: bool


def process_list(deployment: Deployment, record: bool = False) -> tuple[ProcessSpec, ...]:
    """List the processes of a deployment, with a recorder if `record`; the body, the hub, comes first."""
    spared = set(deployment.run.tolerated_losses)
    hosts = [
        ProcessSpec(host, Role.CELLS, "cells", bool({host, "cells"} & spared))
        for host in deployment.skin_processes()
    ]
    controller = ProcessSpec("controller", Role.CONTROLLER, "controller", "controller" in spared)
    recorder = ProcessSpec(RECORDER, Role.RECORDER, "skinnet.recording", RECORDER in spared)
    body = ProcessSpec("body", Role.BODY, "skinnet.body", False)
    return (body, *hosts, controller, *([recorder] if record else []))
