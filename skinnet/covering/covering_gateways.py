"""Gateways of a covering: the fewest that keep the limits of `[plan]`, on each group that bridges join."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from skinnet.deployment import Deployment
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.patches import InterfaceSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.placement import place_patch, resolve_bridges
from skinnet.skin.whole_skin import join_patches
from skinnet.tools.plan.gateway_search import Limits, SearchResult, search_fewest_gateways
from skinnet.tools.plan.plan import limits_of, patch_groups
from skinnet.tools.plan.traffic import traffic_of

__all__ = ["with_gateways"]


def with_gateways(
    patches: Sequence[PatchSpec], bridges: Sequence[BridgeSpec], deployment: Deployment
) -> tuple[PatchSpec, ...]:
    """Patches of covers with the fewest gateways that keep the limits of the deployment's `[plan]`.

    Cells of explicit patches count in the traffic, but get no gateways.

    Raises:
        DeploymentError: no number of gateways keeps a limit.
    """
    whole = msgspec.structs.replace(deployment, patches=(*deployment.patches, *patches))
    traffic, limits = traffic_of(whole), limits_of(deployment)
    placed = tuple(place_patch(patch, deployment.cells) for patch in patches)
    skin = join_patches(placed, resolve_bridges(bridges, placed))
    interfaces: list[list[InterfaceSpec]] = [[] for _ in patches]
    for group in patch_groups(skin, None):
        found = search_fewest_gateways(group, limits, traffic, deployment.network, deployment.power)
        if found.breaches:
            first = patches[int(skin.patch_of_cell[group.cells[0]])].name
            raise DeploymentError(_refusal(first, len(group.cells), limits, found))
        for cell, port in found.gateways.tolist():
            at = int(group.cells[cell])
            patch = int(skin.patch_of_cell[at])
            interfaces[patch].append(InterfaceSpec(cell=at - int(skin.first_cell[patch]), port=port))
    return tuple(
        msgspec.structs.replace(patch, interfaces=tuple(mine))
        for patch, mine in zip(patches, interfaces, strict=True)
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
