"""Process list of a run; packages are named by string, so that the core imports none of them."""

from dataclasses import dataclass

from skinnet.deployment import Deployment
from skinnet.protocol.channels import Role
from skinnet.runtime.wiring import process_roles, tolerated_processes

__all__ = ["ProcessSpec", "process_list"]

_MODULES = {
    Role.BODY: "skinnet.body",
    Role.CELLS: "cells",
    Role.BOARDS: "cells",
    Role.CONTROLLER: "controller",
    Role.RECORDER: "skinnet.recording",
}
"""Package of each role, run as `python -m`."""


@dataclass(frozen=True)
class ProcessSpec:
    """Process specification: `python -m <module>` with a process name."""

    name: str
    role: Role
    module: str
    loss_tolerated: bool


def process_list(deployment: Deployment, record: bool = False) -> tuple[ProcessSpec, ...]:
    """List the processes of a deployment, with a recorder if `record`; the body, the hub, comes first."""
    roles = process_roles(deployment, recorded=record)
    tolerated = tolerated_processes(deployment, roles)
    return tuple(ProcessSpec(name, role, _MODULES[role], name in tolerated) for name, role in roles.items())
