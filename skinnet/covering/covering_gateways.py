"""Gateways of a covering: the fewest that keep the limits of `[plan]`, on each group that bridges join.

A gateway has 16 ports; what would need more is cut into groups with a gateway each.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.covering.group_cuts import cut_group
from skinnet.covering.opened_ports import open_ports
from skinnet.deployment import Deployment
from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.patches import InterfaceSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.gateway_placement import free_ports
from skinnet.skin.placement import place_patch, resolve_bridges
from skinnet.skin.whole_skin import WholeSkin, join_patches
from skinnet.tools.plan.gateway_search import Limits, PatchGroup, SearchResult, search_fewest_gateways
from skinnet.tools.plan.plan import limits_of, patch_groups
from skinnet.tools.plan.traffic import traffic_of

__all__ = ["GatewayPlan", "with_gateways"]

Indices = NDArray[np.int64]


class GatewayPlan(NamedTuple):
    """Patches with their gateways.

    Attributes:
        patches: Patches, some of which were cut.
        bridges: Bridges that are left.
        names: Names of what has become of each patch, by its name.
        wires: Number of wires of each.
    """

    patches: tuple[PatchSpec, ...]
    bridges: tuple[BridgeSpec, ...]
    names: dict[str, tuple[str, ...]]
    wires: dict[str, int]


_OPENED = (1, 2, 4, 8, 16, 32)
"""Numbers of ports that are opened in a patch, one after the other, while gateways at the free ones do not
suffice."""


def with_gateways(
    patches: Sequence[PatchSpec], bridges: Sequence[BridgeSpec], deployment: Deployment
) -> GatewayPlan:
    """Give patches of covers the fewest gateways that keep the limits of the deployment's `[plan]`.

    A group that would need more than one gateway has ports is cut in two, and again. Cells of explicit
    patches count in the traffic, but get no gateways.

    Raises:
        DeploymentError: no number of gateways keeps a limit.
    """
    whole = msgspec.structs.replace(deployment, patches=(*deployment.patches, *patches))
    traffic, limits = traffic_of(whole), limits_of(deployment)
    names: dict[str, tuple[str, ...]] = {patch.name: (patch.name,) for patch in patches}
    searched: dict[tuple[int, bytes], SearchResult] = {}
    opened: dict[str, Iterator[int]] = {}

    def search(group: PatchGroup) -> SearchResult:
        wiring = len(group.cells), group.wires.tobytes()
        if wiring not in searched:
            searched[wiring] = search_fewest_gateways(
                group, limits, traffic, deployment.network, deployment.power
            )
        return searched[wiring]

    while True:
        placed = tuple(place_patch(patch, deployment.cells) for patch in patches)
        skin = join_patches(placed, resolve_bridges(bridges, placed))
        groups = patch_groups(skin, None)
        refused = next((group for group in groups if search(group).breaches), None)
        if refused is None:
            return _plan(patches, bridges, skin, [(group, search(group).gateways) for group in groups], names)
        found, n_places = search(refused), len(np.unique(free_ports(len(refused.cells), refused.wires)[:, 0]))
        if len(found.gateways) < n_places:  # more gateways than one has ports would do
            parts, bridges = cut_group(patches, bridges, skin, refused)
            names = _renamed(names, patches, parts)
            patches = [part for own in parts for part in own]
            continue
        largest = int(np.bincount(skin.patch_of_cell[refused.cells]).argmax())
        name = patches[largest].name
        n_opened = next(opened.setdefault(name, iter(_OPENED)), 0)
        new, count = open_ports(patches[largest], deployment.cells, n_opened, _bridged_ports(name, bridges))
        if not count:
            first = patches[int(skin.patch_of_cell[refused.cells[0]])].name
            raise DeploymentError(_refusal(first, len(refused.cells), limits, found))
        patches = [*patches[:largest], new, *patches[largest + 1 :]]


def _bridged_ports(patch: str, bridges: Sequence[BridgeSpec]) -> frozenset[tuple[int, int]]:
    """Ports (cell, port) of a patch that bridges end at."""
    ends = [parse_port(end) for bridge in bridges for end in (bridge.a, bridge.b)]
    return frozenset((cell, port) for name, cell, port in ends if name == patch)


def _renamed(
    names: dict[str, tuple[str, ...]], patches: Sequence[PatchSpec], parts: Sequence[Sequence[PatchSpec]]
) -> dict[str, tuple[str, ...]]:
    """Names of what has become of each patch after `patches` were cut into `parts`."""
    became = {patch.name: tuple(part.name for part in own) for patch, own in zip(patches, parts, strict=True)}
    return {old: tuple(new for name in now for new in became[name]) for old, now in names.items()}


def _plan(
    patches: Sequence[PatchSpec],
    bridges: Sequence[BridgeSpec],
    skin: WholeSkin,
    found: Sequence[tuple[PatchGroup, Indices]],
    names: dict[str, tuple[str, ...]],
) -> GatewayPlan:
    """Plan with the gateways (g, 2) that were found for each group of cells."""
    interfaces: list[list[InterfaceSpec]] = [[] for _ in patches]
    for group, gateways in found:
        for cell, port in gateways.tolist():
            at = int(group.cells[cell])
            patch = int(skin.patch_of_cell[at])
            interfaces[patch].append(InterfaceSpec(cell=at - int(skin.first_cell[patch]), port=port))
    fed = tuple(
        msgspec.structs.replace(patch, interfaces=tuple(mine))
        for patch, mine in zip(patches, interfaces, strict=True)
    )
    return GatewayPlan(fed, tuple(bridges), names, {patch.name: len(patch.wires) for patch in skin.patches})


def _refusal(patch: str, n_cells: int, limits: Limits, found: SearchResult) -> str:
    name, reached = next(iter(found.breaches.items()))
    key, limit = {
        "latency_ms": ("plan.max_latency_ms", limits.latency_ns * 1e-6),
        "utilisation": ("plan.max_utilisation", limits.utilisation),
        "voltage_v": ("plan.min_voltage_v", limits.voltage_v),
    }[name]
    value = f"{reached:.3g}" if math.isfinite(reached) else "no bound"
    return (
        f"{key} = {limit:g}: the {n_cells} cells about {patch} reach {value} even with "
        f"{len(found.gateways)} gateways; relax it, or give fewer events in [plan]"
    )
