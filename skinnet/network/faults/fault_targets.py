"""Fault targets by name: links, cells, gateways and cell processes, and their match by fault rules."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import translate
from typing import Any, Protocol

from numpy.typing import NDArray

from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.experiment.faults import CellRule, FaultRule, GatewayLost, LinkRule
from skinnet.errors import DeploymentError
from skinnet.random_streams import StreamName, stream_key
from skinnet.suggestions import known_names

__all__ = ["FaultInventory", "FaultLocation", "FaultTarget", "PatchLayout", "select_targets"]

_TARGET = re.compile(r"(?P<patch>[^/:]+)(/(?P<cell>\d+))?(:(?P<port>\d+))?")


class PatchLayout(Protocol):
    """Placed patch interface, implemented by `skinnet.skin.placement.PlacedPatch`."""

    @property
    def name(self) -> str:
        """Name of the patch."""

    @property
    def n_cells(self) -> int:
        """Number of cells."""

    @property
    def wires(self) -> NDArray[Any]:
        """Wires (m, 4), rows of (cell, port, cell, port)."""

    @property
    def interfaces(self) -> NDArray[Any]:
        """Interfaces (g, 2), rows of (cell, port)."""


@dataclass(frozen=True)
class FaultLocation:
    """Fault location; fields that do not apply are None.

    With `port`, or with `gateway` for a link fault, it is the directed link that leaves by that port of the
    cell or of the interface.
    """

    patch: str | None = None
    cell: int | None = None
    port: int | None = None
    gateway: int | None = None
    process: str | None = None

    @property
    def target_names(self) -> tuple[str, ...]:
        """Target names that match this location, the widest first, its own last."""
        if self.process is not None:
            return (self.process,)
        patch = str(self.patch)
        if self.cell is None:
            return (patch,) if self.gateway is None else (patch, f"{patch}:{self.gateway}")
        cell = f"{patch}/{self.cell}"
        return (patch, cell) if self.port is None else (patch, cell, f"{cell}:{self.port}")


@dataclass(frozen=True)
class FaultTarget:
    """Fault target: one location, or both directions of a wire, which fail together.

    Attributes:
        name: Name of its random stream.
        locations: Locations of the fault.
    """

    name: str
    locations: tuple[FaultLocation, ...]


class FaultInventory:
    """Inventory of all fault targets of a deployment."""

    def __init__(self, deployment: Deployment, placed: Sequence[PatchLayout]) -> None:
        self.cell_processes = tuple(deployment.patches_by_process())
        self.n_cells = {patch.name: patch.n_cells for patch in placed}
        self.n_gateways = {patch.name: len(patch.interfaces) for patch in placed}
        self.wires: list[tuple[FaultLocation, FaultLocation]] = []
        """Full-duplex wires, as both of their ends."""
        for patch in placed:
            for cell, port, other, other_port in patch.wires.tolist():
                self.wires.append(
                    (FaultLocation(patch.name, cell, port), FaultLocation(patch.name, other, other_port))
                )
            for gateway, (cell, port) in enumerate(patch.interfaces.tolist()):
                self.wires.append(
                    (FaultLocation(patch.name, cell, port), FaultLocation(patch.name, gateway=gateway))
                )
        self.wires += [
            (FaultLocation(*parse_port(bridge.a)), FaultLocation(*parse_port(bridge.b)))
            for bridge in deployment.bridges
        ]

    def wired_ports(self, patch: str, cell: int) -> list[int]:
        """Return the wired ports of a cell, ascending."""
        ends = (end for wire in self.wires for end in wire if (end.patch, end.cell) == (patch, cell))
        return sorted(end.port for end in ends if end.port is not None)

    def matching_targets(self, rule: FaultRule) -> list[FaultTarget]:
        """Return the fault targets that match `rule`, in the order of the deployment."""
        matches = re.compile(translate(rule.target)).match

        def meant(place: FaultLocation) -> bool:
            return any(matches(name) for name in place.target_names)

        if isinstance(rule, LinkRule):
            return list(_matching_links(self.wires, rule.direction, meant))
        if isinstance(rule, CellRule):
            places = [FaultLocation(patch, cell) for patch, n in self.n_cells.items() for cell in range(n)]
        elif isinstance(rule, GatewayLost):
            places = [
                FaultLocation(patch, gateway=g) for patch, n in self.n_gateways.items() for g in range(n)
            ]
        else:
            places = [FaultLocation(process=host) for host in self.cell_processes]
        return [FaultTarget(place.target_names[-1], (place,)) for place in places if meant(place)]


def select_targets(inventory: FaultInventory, rule: FaultRule, index: int, seed: int) -> list[FaultTarget]:
    """Select the fault targets of rule number `index`, in the order of the deployment.

    Raises:
        DeploymentError: the target does not exist, or `pick` exceeds the number of matches.
    """
    found = inventory.matching_targets(rule)
    if not found:
        raise DeploymentError(
            f"faults[{index}].target = {rule.target!r}: {_no_match_reason(inventory, rule)}"
        )
    if rule.pick is None:
        return found
    if rule.pick > len(found):
        raise DeploymentError(
            f"faults[{index}].pick = {rule.pick}: "
            f"only {len(found)} {_TARGET_KINDS[_target_kind(rule)][0]} match target = {rule.target!r}"
        )
    # one draw per name, so that an added cell does not reorder the others
    lots = sorted(
        found,
        key=lambda one: (
            int(stream_key(seed, StreamName.FAULT, index, StreamName.FAULT_PICK, one.name)),
            one.name,
        ),
    )
    picked = set(lots[: rule.pick])
    return [one for one in found if one in picked]


_LINK, _CELL, _GATEWAY, _PROCESS = range(4)
_TARGET_KINDS = (
    ("links", "patch/cell:port, patch:gateway, patch/cell or patch"),
    ("cells", "patch/cell or patch"),
    ("gateways", "patch:gateway or patch"),
    ("processes", "the name of a cell process"),
)


def _target_kind(rule: FaultRule) -> int:
    if isinstance(rule, LinkRule):
        return _LINK
    if isinstance(rule, CellRule):
        return _CELL
    return _GATEWAY if isinstance(rule, GatewayLost) else _PROCESS


def _matching_links(
    wires: list[tuple[FaultLocation, FaultLocation]], direction: str, matches: Callable[[FaultLocation], bool]
) -> Iterator[FaultTarget]:
    """Yield wires with a matching port, or their directed links out of or into such ports."""
    for a, b in wires:
        if direction == "both":
            if matches(a) or matches(b):
                yield FaultTarget(a.target_names[-1], (a, b))
            continue
        for end, peer in ((a, b), (b, a)):
            if matches(end):
                leaving = end if direction == "out" else peer
                yield FaultTarget(leaving.target_names[-1], (leaving,))


def _no_match_reason(inventory: FaultInventory, rule: FaultRule) -> str:
    """Explain why the target of `rule` matches nothing, and which targets exist."""
    sort = _target_kind(rule)
    things, form = _TARGET_KINDS[sort]
    if "*" in rule.target:
        return f"matches none of the {things}; write {form}, with * as wildcard"
    if sort == _PROCESS:
        return f"unknown cell process; {known_names(rule.target, inventory.cell_processes)}"
    match = _TARGET.fullmatch(rule.target)
    assert match is not None, rule.target
    patch, cell, port = match["patch"], match["cell"], match["port"]
    if patch not in inventory.n_cells:
        return f"unknown patch; {known_names(patch, inventory.n_cells)}"
    if cell is not None and int(cell) >= inventory.n_cells[patch]:
        return f"{patch} has cells 0 to {inventory.n_cells[patch] - 1}"
    if cell is None and port is not None and sort in (_LINK, _GATEWAY):
        count = inventory.n_gateways[patch]
        return f"{patch} has {f'gateways 0 to {count - 1}' if count else 'no gateways'}"
    if cell is not None and port is not None and sort == _LINK:
        wired = ", ".join(map(str, inventory.wired_ports(patch, int(cell))))
        return f"no wire at port {port} of {patch}/{cell}; wired ports: {wired}"
    return f"{rule.kind} is about {things}; write {form}"
