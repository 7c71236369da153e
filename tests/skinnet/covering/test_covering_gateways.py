"""Gateways of a covering: as few as the limits of the plan allow, and what its network metrics find."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from link_models import PITCH_M, write_two_links

from skinnet.covering.covering_gateways import with_gateways
from skinnet.covering.covering_metrics import network_metrics
from skinnet.covering.covering_patches import component_patches
from skinnet.deployment import Deployment, load
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.gateway_placement import MAX_GATEWAY_PORTS
from skinnet.skin.placement import place_patches, resolve_bridges
from skinnet.skin.whole_skin import join_patches
from skinnet.tools.plan.plan import patch_groups

N = 40
CELLS = CellSpec()
COLUMN, ROW = (index.ravel() for index in np.meshgrid(np.arange(11), np.arange(11)))
"""Columns and rows of the cells of a field."""
COVER = '[[cover]]\nname = "skin"\nbody = "fore"\n'


def two_rows() -> tuple[list[PatchSpec], list[BridgeSpec]]:
    """Two rows of cells, one pitch and a half apart, with a bridge between them."""
    patches = []
    for number in range(2):
        position_m = PITCH_M * np.column_stack([np.arange(N) + (N + 0.5) * number, np.zeros((N, 2))])
        patches += component_patches(
            f"row{number}", "fore", position_m, np.repeat(np.eye(3)[None], N, axis=0), CELLS, 1
        )
    return patches, [BridgeSpec(a=f"row0/{N - 1}:0", b="row1/0:2")]


def planned(folder: Path, *settings: str) -> Deployment:
    return load(write_two_links(folder, COVER), settings)


def test_a_group_gets_the_fewest_gateways_that_keep_the_limits(tmp_path: Path) -> None:
    patches, bridges = two_rows()
    one = with_gateways(patches, bridges, planned(tmp_path)).patches
    assert sum(len(patch.interfaces) for patch in one) == 1
    load_limit = planned(tmp_path, "plan.max_utilisation=0.05")
    several = with_gateways(patches, bridges, load_limit).patches
    assert sum(len(patch.interfaces) for patch in several) > 1
    in_time = with_gateways(patches, bridges, planned(tmp_path, "plan.max_latency_ms=5")).patches
    assert sum(len(patch.interfaces) for patch in in_time) > 1


def test_a_group_too_large_for_the_ports_of_a_gateway_is_cut(tmp_path: Path) -> None:
    patches, bridges = two_rows()
    made = with_gateways(patches, bridges, planned(tmp_path, "plan.max_latency_ms=1.2"))
    placed = place_patches(made.patches, CELLS, made.bridges)
    groups = patch_groups(join_patches(placed, resolve_bridges(made.bridges, placed)), None)
    ports = [len(group.gateways) for group in groups]
    assert len(groups) > 1
    assert sum(ports) > MAX_GATEWAY_PORTS >= max(ports)
    assert sorted(name for names in made.names.values() for name in names) == sorted(made.wires)
    assert sum(made.wires.values()) + len(made.bridges) == 2 * N - len(groups)  # each cut takes one wire
    before = sorted(cell.position_m for patch in patches for cell in patch.cells)
    assert sorted(cell.position_m for patch in made.patches for cell in patch.cells) == before


def test_the_search_ends_near_the_fewest_where_it_starts_far_below(tmp_path: Path) -> None:
    in_time = planned(tmp_path, "plan.max_latency_ms=2")
    short, long = (
        sum(len(patch.interfaces) for patch in with_gateways([row_of(n)], [], in_time).patches)
        for n in (80, 240)
    )
    assert 3 * short - 3 <= long <= 3 * short + 3
    assert long > 34  # the load alone would allow one


def row_of(n_cells: int) -> PatchSpec:
    position_m = PITCH_M * np.column_stack([np.arange(n_cells), np.zeros((n_cells, 2))])
    return component_patches(
        "row", "fore", position_m, np.repeat(np.eye(3)[None], n_cells, axis=0), CELLS, 1
    )[0]


def field_of(name: str) -> PatchSpec:
    """A lattice of 11 × 11 cells, whose inner ones have no free port."""
    position_m = PITCH_M * np.column_stack([COLUMN + 0.5 * ROW, math.sqrt(0.75) * ROW, 0.0 * ROW])
    R = np.repeat(np.eye(3)[None], len(position_m), axis=0)
    return component_patches(name, "fore", position_m, R, CELLS, 1)[0]


def test_cells_amid_a_large_patch_are_turned_where_gateways_at_its_edge_do_not_suffice(
    tmp_path: Path,
) -> None:
    field = [field_of("field")]
    before = {cell.position_m: cell for cell in field[0].cells}
    wide = with_gateways(field, [], planned(tmp_path, "plan.max_utilisation=0.02"))
    assert {cell.position_m: cell for patch in wide.patches for cell in patch.cells} == before
    made = with_gateways(field, [], planned(tmp_path, "plan.max_utilisation=0.012"))
    after = {cell.position_m: cell for patch in made.patches for cell in patch.cells}
    assert sorted(after) == sorted(before)
    turned = {place for place, cell in after.items() if cell != before[place]}
    assert 0 < len(turned) < 15
    inner = (COLUMN > 0) & (COLUMN < 10) & (ROW > 0) & (ROW < 10)
    assert turned <= {field[0].cells[i].position_m for i in np.flatnonzero(inner)}
    fed = {patch.cells[each.cell].position_m for patch in made.patches for each in patch.interfaces}
    assert turned & fed


def test_each_patch_gets_the_ports_opened_that_it_needs_whatever_others_got(tmp_path: Path) -> None:
    fields = [field_of(f"field{k}") for k in range(3)]
    made = with_gateways(fields, [], planned(tmp_path, "plan.max_utilisation=0.012"))
    before = {cell.position_m: cell for cell in fields[0].cells}
    turned = [
        sorted(
            cell.position_m
            for patch in made.patches
            if patch.name in made.names[field.name]
            for cell in patch.cells
            if cell != before[cell.position_m]
        )
        for field in fields
    ]
    assert turned[0]
    assert turned[0] == turned[1] == turned[2]


def test_a_limit_that_no_number_keeps_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(DeploymentError, match=r"plan.max_latency_ms = 0.001: the 80 cells about row0 reach"):
        with_gateways(*two_rows(), planned(tmp_path, "plan.max_latency_ms=0.001"))


def test_the_network_metrics_name_what_is_not_joined_and_not_reached(tmp_path: Path) -> None:
    patches, bridges = two_rows()
    made = with_gateways(patches, bridges, planned(tmp_path)).patches
    names = [patch.name for patch in made]
    [found] = network_metrics([names], made, bridges, CELLS)
    assert found == {"bridges": 1, "groups": 1, "gateways": 1, "unreached": 0}
    [cut] = network_metrics([names], made, [], CELLS)
    assert (cut["groups"], cut["unreached"]) == (2, N)
    bare = [msgspec.structs.replace(patch, interfaces=()) for patch in made]
    assert network_metrics([names], bare, bridges, CELLS)[0]["unreached"] == 2 * N
