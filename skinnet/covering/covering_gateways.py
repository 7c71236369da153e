"""Gateways of a covering: the fewest that keep the limits of `[plan]`, on each group that bridges join.

A gateway has 16 ports; what would need more is cut into groups with a gateway each.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from skinnet.covering.group_cuts import cut_group
from skinnet.covering.opened_ports import open_ports
from skinnet.deployment import Deployment
from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import InterfaceSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.gateway_placement import MAX_GATEWAY_PORTS, free_ports
from skinnet.skin.placement import place_patch, resolve_bridges
from skinnet.skin.whole_skin import WholeSkin, join_patches
from skinnet.tools.plan.gateway_search import Limits, PatchGroup, SearchResult, search_fewest_gateways
from skinnet.tools.plan.plan import limits_of, patch_groups
from skinnet.tools.plan.traffic import traffic_of

__all__ = ["GatewayPlan", "with_gateways"]


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
"""Numbers of ports that are opened, one after the other, while gateways at the free ones do not suffice."""


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
    known: dict[bytes, SearchResult] = {}
    numbers = iter(_OPENED)
    while True:
        placed = tuple(place_patch(patch, deployment.cells) for patch in patches)
        skin = join_patches(placed, resolve_bridges(bridges, placed))
        refused = None
        for group in patch_groups(skin, None):
            key = _key(group)
            if key not in known:
                known[key] = search_fewest_gateways(
                    group, limits, traffic, deployment.network, deployment.power
                )
            if known[key].breaches:
                refused = group
                break
        if refused is None:
            return _plan(patches, bridges, skin, known, names)
        found, count = known[_key(refused)], 0
        if len(found.gateways) == len(np.unique(free_ports(len(refused.cells), refused.wires)[:, 0])):
            # gateways at all free ports do not suffice
            patches, count = _opened(patches, bridges, skin, refused, next(numbers, 0), deployment.cells)
        elif len(found.gateways) == MAX_GATEWAY_PORTS:
            parts, bridges = cut_group(patches, bridges, skin, refused)
            names = _renamed(names, patches, parts)
            patches, count = [part for own in parts for part in own], 1
        if not count:
            first = patches[int(skin.patch_of_cell[refused.cells[0]])].name
            raise DeploymentError(_refusal(first, len(refused.cells), limits, found))


def _key(group: PatchGroup) -> bytes:
    """Key of a group: its cells and wires."""
    return group.cells.tobytes() + group.wires.tobytes()


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
    found: dict[bytes, SearchResult],
    names: dict[str, tuple[str, ...]],
) -> GatewayPlan:
    """Plan with the gateways that were found for the groups of cells."""
    interfaces: list[list[InterfaceSpec]] = [[] for _ in patches]
    for group in patch_groups(skin, None):
        for cell, port in found[_key(group)].gateways.tolist():
            at = int(group.cells[cell])
            patch = int(skin.patch_of_cell[at])
            interfaces[patch].append(InterfaceSpec(cell=at - int(skin.first_cell[patch]), port=port))
    fed = tuple(
        msgspec.structs.replace(patch, interfaces=tuple(mine))
        for patch, mine in zip(patches, interfaces, strict=True)
    )
    return GatewayPlan(fed, tuple(bridges), names, {patch.name: len(patch.wires) for patch in skin.patches})


def _opened(
    patches: Sequence[PatchSpec],
    bridges: Sequence[BridgeSpec],
    skin: WholeSkin,
    group: PatchGroup,
    n_opened: int,
    cells: CellSpec,
) -> tuple[list[PatchSpec], int]:
    """Patches with `n_opened` free ports more in the largest one of a group, and how many it got."""
    largest = int(np.bincount(skin.patch_of_cell[group.cells]).argmax())
    ends = [parse_port(end) for bridge in bridges for end in (bridge.a, bridge.b)]
    fixed = frozenset(cell for name, cell, _ in ends if name == patches[largest].name)
    new, count = open_ports(patches[largest], cells, n_opened, fixed)
    return [*patches[:largest], new, *patches[largest + 1 :]], count


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
        f"{len(np.unique(found.gateways[:, 0]))} gateways; relax it, or give fewer events in [plan]"
    )
