"""Fault targets by name: links, cells, gateways and cell processes, and their match by fault rules."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import translate
from typing import Any, Protocol

from numpy.typing import NDArray

from skinnet.deployment.faults import CellRule, FaultRule, GatewayLost, LinkRule
from skinnet.deployment.schema import Deployment
from skinnet.deployment.table import parse_port
from skinnet.errors import DeploymentError
from skinnet.seeding import StreamName, key_of

__all__ = ["Breakable", "Inventory", "Place", "Placed", "chosen"]

_EXACT = re.compile(r"(?P<patch>[^/:]+)(/(?P<cell>\d+))?(:(?P<port>\d+))?")


class Placed(Protocol):
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
class Place:
    """Fault location; fields that do not apply are None.

    With `port`, or with `gateway` for a link fault, it is the directed link that leaves by that port of the
    cell or of the interface.
    """

    patch: str | None = None
    cell: int | None = None
    port: int | None = None
    gateway: int | None = None
    host: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Target names that match this location, the widest first, its own last."""
        if self.host is not None:
            return (self.host,)
        patch = str(self.patch)
        if self.cell is None:
            return (patch,) if self.gateway is None else (patch, f"{patch}:{self.gateway}")
        cell = f"{patch}/{self.cell}"
        return (patch, cell) if self.port is None else (patch, cell, f"{cell}:{self.port}")


@dataclass(frozen=True)
class Breakable:
    """Fault target: one location, or both directions of a wire, which fail together.

    Attributes:
        name: Name of its random stream.
        places: Locations of the fault.
    """

    name: str
    places: tuple[Place, ...]


class Inventory:
    """Inventory of all fault targets of a deployment."""

    def __init__(self, deployment: Deployment, placed: Sequence[Placed]) -> None:
        self.hosts = tuple(deployment.host_patches())
        self.n_cells = {patch.name: patch.n_cells for patch in placed}
        self.n_gateways = {patch.name: len(patch.interfaces) for patch in placed}
        self.wires: list[tuple[Place, Place]] = []
        """Full-duplex wires, as both of their ends."""
        for patch in placed:
            for cell, port, other, other_port in patch.wires.tolist():
                self.wires.append((Place(patch.name, cell, port), Place(patch.name, other, other_port)))
            for gateway, (cell, port) in enumerate(patch.interfaces.tolist()):
                self.wires.append((Place(patch.name, cell, port), Place(patch.name, gateway=gateway)))
        self.wires += [
            (Place(*parse_port(bridge.a)), Place(*parse_port(bridge.b))) for bridge in deployment.bridges
        ]

    def wired_ports(self, patch: str, cell: int) -> list[int]:
        """Return the wired ports of a cell, ascending."""
        ends = (end for wire in self.wires for end in wire if (end.patch, end.cell) == (patch, cell))
        return sorted(end.port for end in ends if end.port is not None)

    def matching(self, rule: FaultRule) -> list[Breakable]:
        """Return the fault targets that match `rule`, in the order of the deployment."""
        matches = re.compile(translate(rule.target)).match

        def meant(place: Place) -> bool:
            return any(matches(name) for name in place.names)

        if isinstance(rule, LinkRule):
            return list(_links(self.wires, rule.direction, meant))
        if isinstance(rule, CellRule):
            places = [Place(patch, cell) for patch, n in self.n_cells.items() for cell in range(n)]
        elif isinstance(rule, GatewayLost):
            places = [Place(patch, gateway=g) for patch, n in self.n_gateways.items() for g in range(n)]
        else:
            places = [Place(host=host) for host in self.hosts]
        return [Breakable(place.names[-1], (place,)) for place in places if meant(place)]


def chosen(inventory: Inventory, rule: FaultRule, index: int, seed: int) -> list[Breakable]:
    """Select the fault targets of rule number `index`, in the order of the deployment.

    Raises:
        DeploymentError: the target does not exist, or `pick` exceeds the number of matches.
    """
    found = inventory.matching(rule)
    if not found:
        raise DeploymentError(f"faults[{index}].target = {rule.target!r}: {_missing(inventory, rule)}")
    if rule.pick is None:
        return found
    if rule.pick > len(found):
        raise DeploymentError(
            f"faults[{index}].pick = {rule.pick}: only {len(found)} {_WORDS[_sort(rule)][0]} match "
            f"target = {rule.target!r}"
        )
    # one draw per name, so that an added cell does not reorder the others
    lots = sorted(
        found,
        key=lambda one: (
            int(key_of(seed, StreamName.FAULT, index, StreamName.FAULT_PICK, one.name)),
            one.name,
        ),
    )
    picked = set(lots[: rule.pick])
    return [one for one in found if one in picked]


_LINK, _CELL, _GATEWAY, _HOST = range(4)
_WORDS = (
    ("links", "patch/cell:port, patch:gateway, patch/cell or patch"),
    ("cells", "patch/cell or patch"),
    ("gateways", "patch:gateway or patch"),
    ("hosts", "the name of a host"),
)


def _sort(rule: FaultRule) -> int:
    if isinstance(rule, LinkRule):
        return _LINK
    if isinstance(rule, CellRule):
        return _CELL
    return _GATEWAY if isinstance(rule, GatewayLost) else _HOST


def _links(
    wires: list[tuple[Place, Place]], direction: str, meant: Callable[[Place], bool]
) -> Iterator[Breakable]:
    """Yield wires with a matching port, or their directed links out of or into such ports."""
    for a, b in wires:
        if direction == "both":
            if meant(a) or meant(b):
                yield Breakable(a.names[-1], (a, b))
            continue
        for end, peer in ((a, b), (b, a)):
            if meant(end):
                leaving = end if direction == "out" else peer
                yield Breakable(leaving.names[-1], (leaving,))


def _missing(inventory: Inventory, rule: FaultRule) -> str:
    """Explain why the target of `rule` matches nothing, and which targets exist."""
    sort = _sort(rule)
    things, form = _WORDS[sort]
    if "*" in rule.target:
        return f"matches none of the {things}; write {form}, with * for anything"
    if sort == _HOST:
        return f"unknown host; there are {', '.join(inventory.hosts)}"
    match = _EXACT.fullmatch(rule.target)
    assert match is not None, rule.target
    patch, cell, port = match["patch"], match["cell"], match["port"]
    if patch not in inventory.n_cells:
        return f"unknown patch; there are {', '.join(inventory.n_cells)}"
    if cell is not None and int(cell) >= inventory.n_cells[patch]:
        return f"{patch} has cells 0 to {inventory.n_cells[patch] - 1}"
    if cell is None and port is not None and sort in (_LINK, _GATEWAY):
        count = inventory.n_gateways[patch]
        return f"{patch} has {f'gateways 0 to {count - 1}' if count else 'no gateways'}"
    if cell is not None and port is not None and sort == _LINK:
        wired = ", ".join(map(str, inventory.wired_ports(patch, int(cell))))
        return f"no wire at port {port} of {patch}/{cell}; wired ports: {wired}"
    return f"{rule.kind} is about {things}; write {form}"
