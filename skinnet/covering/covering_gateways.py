"""Gateways of a covering: the fewest that keep the limits of `[plan]`, on each group that bridges join."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from skinnet.covering.opened_ports import open_ports
from skinnet.deployment import Deployment
from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import InterfaceSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.placement import place_patch, resolve_bridges
from skinnet.skin.whole_skin import WholeSkin, join_patches
from skinnet.tools.plan.gateway_search import Limits, PatchGroup, SearchResult, search_fewest_gateways
from skinnet.tools.plan.plan import limits_of, patch_groups
from skinnet.tools.plan.traffic import traffic_of

__all__ = ["with_gateways"]

_OPENED = (1, 2, 4, 8, 16, 32)
"""Numbers of ports that are opened, one after the other, while gateways at the free ones do not suffice."""


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
    patches, known = tuple(patches), dict[bytes, SearchResult]()
    for n_opened in (*_OPENED, 0):
        placed = tuple(place_patch(patch, deployment.cells) for patch in patches)
        skin = join_patches(placed, resolve_bridges(bridges, placed))
        refused = None
        for group in patch_groups(skin, None):
            key = group.cells.tobytes() + group.wires.tobytes()
            if key not in known:
                known[key] = search_fewest_gateways(
                    group, limits, traffic, deployment.network, deployment.power
                )
            if known[key].breaches:
                refused = group, known[key]
                break
        if refused is None:
            return _with_interfaces(patches, skin, known)
        group, found = refused
        opened, count = _opened(patches, bridges, skin, group, n_opened, deployment.cells)
        if not count:
            first = patches[int(skin.patch_of_cell[group.cells[0]])].name
            raise DeploymentError(_refusal(first, len(group.cells), limits, found))
        patches = opened
    raise AssertionError("the last round opens no port")


def _with_interfaces(
    patches: Sequence[PatchSpec], skin: WholeSkin, found: dict[bytes, SearchResult]
) -> tuple[PatchSpec, ...]:
    """Patches with the gateways that were found for the groups of their cells."""
    interfaces: list[list[InterfaceSpec]] = [[] for _ in patches]
    for group in patch_groups(skin, None):
        result = found[group.cells.tobytes() + group.wires.tobytes()]
        for cell, port in result.gateways.tolist():
            at = int(group.cells[cell])
            patch = int(skin.patch_of_cell[at])
            interfaces[patch].append(InterfaceSpec(cell=at - int(skin.first_cell[patch]), port=port))
    return tuple(
        msgspec.structs.replace(patch, interfaces=tuple(mine))
        for patch, mine in zip(patches, interfaces, strict=True)
    )


def _opened(
    patches: Sequence[PatchSpec],
    bridges: Sequence[BridgeSpec],
    skin: WholeSkin,
    group: PatchGroup,
    n_opened: int,
    cells: CellSpec,
) -> tuple[tuple[PatchSpec, ...], int]:
    """Patches with `n_opened` free ports more in the largest one of a group, and how many it got."""
    largest = int(np.bincount(skin.patch_of_cell[group.cells]).argmax())
    ends = [parse_port(end) for bridge in bridges for end in (bridge.a, bridge.b)]
    fixed = frozenset(cell for name, cell, _ in ends if name == patches[largest].name)
    new, count = open_ports(patches[largest], cells, n_opened, fixed)
    return (*patches[:largest], new, *patches[largest + 1 :]), count


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
