"""Wiring of the logical processes: subscriptions, senders, peers, upstreams and tolerated losses.

All of it follows from the channel table and the deployment. The table says which roles send and receive a
channel; the deployment says which processes have these roles and which patches a process simulates. A process
waits for the senders of channels whose messages carry a watermark, one upstream for each source.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.errors import DeploymentError
from skinnet.protocol.channels import BODY, CHANNELS, CONTROLLER, RECORDER, Channel, Keys, Role
from skinnet.runtime.upstream import Upstream

__all__ = [
    "ProcessWiring",
    "Source",
    "WiredProcess",
    "process_roles",
    "tolerated_processes",
    "wiring_of",
]

_FIELD = re.compile(r"<(\w+)>")
_ALL_CELL_PROCESSES = "cells"
"""Word of `run.tolerated_losses` for every cell process."""


@dataclass(frozen=True)
class Source:
    """Source of period ends, on which a process waits.

    Attributes:
        name: Name of the upstream: a patch, or the process.
        process: Name of the process that publishes for it.
        watermark_ns: Watermark [ns] at the start, before any message.
    """

    name: str
    process: str
    watermark_ns: int


@dataclass(frozen=True)
class ProcessWiring:
    """Connections of one logical process to the others of its run.

    Attributes:
        name: Process name.
        role: Role of the process.
        subscriptions: Key expressions that it subscribes to.
        senders: Names of the processes whose messages it receives.
        sources: Upstreams that it waits for.
        peers: Names of the processes that must be present before the first period, itself included.
        tolerated_losses: Names of the processes whose loss does not end this one.
    """

    name: str
    role: Role
    subscriptions: tuple[str, ...]
    senders: frozenset[str]
    sources: tuple[Source, ...]
    peers: frozenset[str]
    tolerated_losses: frozenset[str]

    @property
    def recorded(self) -> bool:
        """True if a recorder takes part in the run."""
        return RECORDER in self.peers


class WiredProcess:
    """Attributes of a logical process, taken from its wiring; base of all processes of a run.

    Attributes:
        recorded: True if a recorder takes part in the run.
        (others): As in `skinnet.runtime.loop.LogicalProcess`.
    """

    follows_wall_clock = False

    def __init__(self, wiring: ProcessWiring) -> None:
        self.name = wiring.name
        self.role = wiring.role.value
        self.subscriptions = wiring.subscriptions
        self.senders = wiring.senders
        self.peers = wiring.peers
        self.tolerated_losses = wiring.tolerated_losses
        self.recorded = wiring.recorded
        self.counters: Counter[str] = Counter()
        self.upstreams: Mapping[str, Upstream] = {
            source.name: Upstream(source.name, source.process, source.watermark_ns)
            for source in wiring.sources
        }


def process_roles(deployment: Deployment, *, recorded: bool = False) -> dict[str, Role]:
    """Map the names of a run's processes to their roles, the body first, with a recorder if `recorded`."""
    return {
        BODY: Role.BODY,
        **dict.fromkeys(deployment.patches_by_process(), Role.CELLS),
        **({BOARD_PROCESS: Role.BOARDS} if deployment.sheets else {}),
        CONTROLLER: Role.CONTROLLER,
        **({RECORDER: Role.RECORDER} if recorded else {}),
    }


def tolerated_processes(deployment: Deployment, roles: Mapping[str, Role]) -> frozenset[str]:
    """Name the processes among `roles` whose loss the deployment tolerates."""
    tolerated = deployment.run.tolerated_losses
    return frozenset(
        process
        for process, role in roles.items()
        if process in tolerated or (role is Role.CELLS and _ALL_CELL_PROCESSES in tolerated)
    )


def wiring_of(deployment: Deployment, name: str, *, recorded: bool = False) -> ProcessWiring:
    """Derive the wiring of process `name` from the channel table.

    Args:
        deployment: Deployment of the run.
        name: Name of the process.
        recorded: A recorder takes part in the run.

    Raises:
        DeploymentError: the deployment has no such process.
    """
    roles = process_roles(deployment, recorded=recorded or name == RECORDER)
    if name not in roles:
        raise DeploymentError(f"process {name!r}: not in this deployment; there are {', '.join(roles)}")
    role = roles[name]
    received = {row: _senders(row, role, roles) for row in _received_channels(deployment, role, roles)}
    keys, own_names = Keys(deployment.robot), _names_in_keys(deployment, name, role)
    return ProcessWiring(
        name=name,
        role=role,
        subscriptions=tuple(key for row in received for key in _expressions(keys, row, own_names)),
        senders=frozenset(sender for senders in received.values() for sender in senders),
        sources=_sources(deployment, role, received),
        peers=frozenset(roles),
        tolerated_losses=_tolerated_losses(deployment, name, roles),
    )


def _received_channels(deployment: Deployment, role: Role, roles: Mapping[str, Role]) -> list[Channel]:
    """List the channels that a process of `role` receives in this deployment; a recorder, all recorded."""
    if role is Role.RECORDER:
        return [row for row in CHANNELS if row.recorded and row.sender is not role]
    present = {None, *roles.values()}
    if role is Role.CONTROLLER:  # it decides on one kind of skin
        present.discard(Role.BOARDS if deployment.nursing is None else Role.CELLS)
    return [row for row in CHANNELS if role in row.receivers and row.sender in present]


def _senders(row: Channel, role: Role, roles: Mapping[str, Role]) -> tuple[str, ...]:
    """List the processes that send `row` to a process of `role`; external clients are none."""
    if role is Role.BOARDS and "patch" in _FIELD.findall(row.pattern):
        return ()  # the controller configures cells of patches; boards are configured by external clients
    return tuple(name for name, sender in roles.items() if sender is row.sender)


def _names_in_keys(deployment: Deployment, name: str, role: Role) -> dict[str, tuple[str, ...]]:
    """Map the fields of keys to the names by which a process is addressed; empty if it hears all."""
    match role:
        case Role.CELLS:
            return {"process": (name,), "patch": deployment.patches_by_process()[name]}
        case Role.BOARDS:
            return {"process": (name,), "patch": (name,), "network": (name,)}
        case _:
            return {}


def _expressions(keys: Keys, row: Channel, own_names: Mapping[str, tuple[str, ...]]) -> Iterable[str]:
    """List the key expressions of `row`, for its first field one for each of a process's own names."""
    fields = _FIELD.findall(row.pattern)
    if not fields:
        return [keys.of(row.name)]
    return [keys.of(row.name, first, *"*" * (len(fields) - 1)) for first in own_names.get(fields[0], ("*",))]


def _sources(
    deployment: Deployment, role: Role, received: Mapping[Channel, tuple[str, ...]]
) -> tuple[Source, ...]:
    """List the sources of a process: of the received channels that carry watermarks."""
    sources: dict[str, Source] = {}
    patches = deployment.patches_by_process()
    for row, senders in received.items():
        if "watermark_ns" not in row.message.__struct_fields__:
            continue
        for process in senders:
            for name in patches.get(process, (process,)):
                sources[name] = Source(name, process, _initial_watermark_ns(deployment, row.sender, role))
    return tuple(sources.values())


def _initial_watermark_ns(deployment: Deployment, sender: Role | None, receiver: Role) -> int:
    """Return the watermark [ns] of a source from which nothing has arrived."""
    if sender is Role.BODY:
        return -1  # its messages about time zero are waited for
    if sender is Role.CONTROLLER and receiver is Role.BODY:
        return deployment.controller.command_delay_ns  # no command takes effect earlier
    return 0


def _tolerated_losses(deployment: Deployment, name: str, roles: Mapping[str, Role]) -> frozenset[str]:
    if name == RECORDER:
        # a process that does not tolerate a loss ends the run, and the recording shows how far it came
        return frozenset(roles) - {name}
    return tolerated_processes(deployment, roles)
