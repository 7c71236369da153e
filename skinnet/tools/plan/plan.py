"""Plan of a deployment: its link budget, and the fewest gateways that keep its limits."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment import Deployment
from skinnet.skin.placement import place_patches, resolve_bridges
from skinnet.skin.whole_skin import WholeSkin, join_patches
from skinnet.tools.plan.gateway_search import (
    Limits,
    PatchGroup,
    SearchResult,
    breaches,
    search_fewest_gateways,
)
from skinnet.tools.plan.link_budget import LinkBudget, compute_budget
from skinnet.tools.plan.traffic import Traffic, traffic_of

__all__ = ["Plan", "limits_of", "make_plan", "patch_groups"]


@dataclass(frozen=True)
class Plan:
    """Plan of a deployment: link budget and gateway search.

    Attributes:
        deployment: Deployment that is planned.
        skin: Cells, wires and gateways of the whole skin.
        feeds: (f,) fed cells; empty without power wires.
        traffic: Traffic of the cells.
        limits: Limits to keep.
        budget: Link budget with the gateways of the deployment.
        groups: Groups of patches joined by bridges.
        searches: Fewest gateways of each group.
    """

    deployment: Deployment
    skin: WholeSkin
    feeds: NDArray[np.int64]
    traffic: Traffic
    limits: Limits
    budget: LinkBudget
    groups: tuple[PatchGroup, ...]
    searches: tuple[SearchResult, ...]

    @property
    def breaches(self) -> dict[str, float]:
        """Limits that the deployment breaches as it is, with the worst value of each."""
        return breaches(self.budget, self.limits)

    def link_name(self, cell: int) -> str:
        """Name of a cell's uplink, as "patch/cell:port → patch/cell" or "… → gateway"."""
        parent = int(self.budget.forest.parent[cell])
        start = f"{self.skin.cell_name(cell)}:{self.budget.forest.port[cell]}"
        return f"{start} → {self.skin.cell_name(parent) if parent >= 0 else 'gateway'}"

    def gateway_places(self, index: int) -> list[str]:
        """Gateway places that the search found for a group, as "patch/cell:port"."""
        cells, found = self.groups[index].cells, self.searches[index].gateways
        return [f"{self.skin.cell_name(int(cells[cell]))}:{port}" for cell, port in found.tolist()]


def make_plan(deployment: Deployment) -> Plan:
    """Plan the gateways and link budget of a checked deployment.

    Raises:
        DeploymentError: cells, bridges or feeds do not fit together.
    """
    placed = place_patches(deployment.patches, deployment.cells, deployment.bridges)
    skin = join_patches(placed, resolve_bridges(deployment.bridges, placed))
    power = deployment.power
    feeds = np.empty(0, dtype=np.int64) if power is None else skin.feed_cells(power.feeds)
    traffic = traffic_of(deployment)
    limits = limits_of(deployment)
    budget = compute_budget(
        skin.n_cells, skin.wires, skin.gateways, feeds, traffic, deployment.network, deployment.power
    )
    own_feeds = power is not None and bool(power.feeds)
    groups = patch_groups(skin, feeds if own_feeds else None)
    searches = tuple(
        search_fewest_gateways(group, limits, traffic, deployment.network, power) for group in groups
    )
    return Plan(deployment, skin, feeds, traffic, limits, budget, groups, searches)


def limits_of(deployment: Deployment) -> Limits:
    """Limits that the gateways of `deployment` must keep, as its `[plan]` says."""
    plan, power = deployment.plan, deployment.power
    lowest_v = 0.0 if power is None else power.brown_out_v
    return Limits(
        math.inf if plan.max_latency_ms is None else plan.max_latency_ms * 1e6,
        plan.max_utilisation,
        lowest_v if plan.min_voltage_v is None else plan.min_voltage_v,
    )


def patch_groups(skin: WholeSkin, feeds: NDArray[np.int64] | None) -> tuple[PatchGroup, ...]:
    """Groups of patches joined by bridges, in the order of their first patches.

    Args:
        skin: Cells, wires and gateways of the whole skin.
        feeds: (f,) fed cells; None if the gateways' cells are fed.
    """
    return tuple(_group(skin, number, feeds) for number in dict.fromkeys(skin.component_of_patch.tolist()))


def _group(skin: WholeSkin, number: int, feeds: NDArray[np.int64] | None) -> PatchGroup:
    inside = skin.component_of_patch[skin.patch_of_cell] == number
    cells = np.flatnonzero(inside)
    new = np.cumsum(inside) - 1
    wires = skin.wires[inside[skin.wires[:, 0]]].copy()
    gateways = skin.gateways[inside[skin.gateways[:, 0]]].copy()
    wires[:, [0, 2]] = new[wires[:, [0, 2]]]
    gateways[:, 0] = new[gateways[:, 0]]
    return PatchGroup(cells, wires, gateways, None if feeds is None else new[feeds[inside[feeds]]])
