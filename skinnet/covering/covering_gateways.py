"""Gateways of a covering: the fewest that keep the limits of `[plan]`, on each group that bridges join.

A gateway has 16 ports; what would need more is cut into groups with a gateway each.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from skinnet.covering.group_cuts import cut_group
from skinnet.deployment import Deployment
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.patches import InterfaceSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.gateway_placement import MAX_GATEWAY_PORTS
from skinnet.skin.placement import place_patch, resolve_bridges
from skinnet.skin.whole_skin import join_patches
from skinnet.tools.plan.gateway_search import Limits, SearchResult, search_fewest_gateways
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
    known: dict[tuple[str, ...], SearchResult] = {}
    while True:
        placed = tuple(place_patch(patch, deployment.cells) for patch in patches)
        skin = join_patches(placed, resolve_bridges(bridges, placed))
        interfaces: list[list[InterfaceSpec]] = [[] for _ in patches]
        too_large = None
        for group in patch_groups(skin, None):
            own = tuple(placed[k].name for k in np.unique(skin.patch_of_cell[group.cells]).tolist())
            if own not in known:
                known[own] = search_fewest_gateways(
                    group, limits, traffic, deployment.network, deployment.power
                )
            found = known[own]
            if found.breaches and len(found.gateways) == MAX_GATEWAY_PORTS < len(group.cells):
                too_large = group
                break
            if found.breaches:
                raise DeploymentError(_refusal(own[0], len(group.cells), limits, found))
            for cell, port in found.gateways.tolist():
                at = int(group.cells[cell])
                patch = int(skin.patch_of_cell[at])
                interfaces[patch].append(InterfaceSpec(cell=at - int(skin.first_cell[patch]), port=port))
        if too_large is None:
            break
        parts, bridges = cut_group(patches, bridges, skin, too_large)
        became = {
            patch.name: tuple(part.name for part in own) for patch, own in zip(patches, parts, strict=True)
        }
        names = {old: tuple(new for name in now for new in became[name]) for old, now in names.items()}
        patches = [part for own in parts for part in own]
    return GatewayPlan(
        tuple(
            msgspec.structs.replace(patch, interfaces=tuple(mine))
            for patch, mine in zip(patches, interfaces, strict=True)
        ),
        tuple(bridges),
        names,
        {patch.name: len(patch.wires) for patch in placed},
    )


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
