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
from skinnet.skin.placement import place_patch

N = 40
CELLS = CellSpec()
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
    one = with_gateways(patches, bridges, planned(tmp_path))
    assert sum(len(patch.interfaces) for patch in one) == 1
    load_limit = planned(tmp_path, "plan.max_utilisation=0.05")
    several = with_gateways(patches, bridges, load_limit)
    assert sum(len(patch.interfaces) for patch in several) > 1
    in_time = with_gateways(patches, bridges, planned(tmp_path, "plan.max_latency_ms=5"))
    assert sum(len(patch.interfaces) for patch in in_time) > 1


def test_the_search_ends_near_the_fewest_where_it_starts_far_below(tmp_path: Path) -> None:
    in_time = planned(tmp_path, "plan.max_latency_ms=2")
    short = len(with_gateways([row_of(80)], [], in_time)[0].interfaces)
    long = len(with_gateways([row_of(240)], [], in_time)[0].interfaces)
    assert 3 * short - 3 <= long <= 3 * short + 3
    assert long > 34  # the load alone would allow one


def row_of(n_cells: int) -> PatchSpec:
    position_m = PITCH_M * np.column_stack([np.arange(n_cells), np.zeros((n_cells, 2))])
    return component_patches(
        "row", "fore", position_m, np.repeat(np.eye(3)[None], n_cells, axis=0), CELLS, 1
    )[0]


def test_cells_amid_a_large_patch_are_turned_where_gateways_at_its_edge_do_not_suffice(
    tmp_path: Path,
) -> None:
    column, row = (index.ravel() for index in np.meshgrid(np.arange(11), np.arange(11)))
    position_m = PITCH_M * np.column_stack([column + 0.5 * row, math.sqrt(0.75) * row, 0.0 * row])
    field = component_patches("field", "fore", position_m, np.repeat(np.eye(3)[None], 121, axis=0), CELLS, 1)
    (wide,) = with_gateways(field, [], planned(tmp_path, "plan.max_utilisation=0.02"))
    assert wide.cells == field[0].cells
    (made,) = with_gateways(field, [], planned(tmp_path, "plan.max_utilisation=0.012"))
    turned = {cell for cell in range(121) if made.cells[cell] != field[0].cells[cell]}
    assert 0 < len(turned) < 15
    amid = (column > 0) & (column < 10) & (row > 0) & (row < 10)
    assert amid[list(turned)].all()
    assert turned & {interface.cell for interface in made.interfaces}
    assert len(component_patches("field", "fore", *_poses(made), CELLS, 1)) == 1


def _poses(patch: PatchSpec) -> tuple[np.ndarray, np.ndarray]:
    placed = place_patch(patch, CELLS)
    return placed.position_m, placed.R_body_cell


def test_a_limit_that_no_number_keeps_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(DeploymentError, match=r"plan.max_latency_ms = 0.001: the 80 cells about row0 reach"):
        with_gateways(*two_rows(), planned(tmp_path, "plan.max_latency_ms=0.001"))


def test_the_network_metrics_name_what_is_not_joined_and_not_reached(tmp_path: Path) -> None:
    patches, bridges = two_rows()
    made = with_gateways(patches, bridges, planned(tmp_path))
    names = [patch.name for patch in made]
    found = network_metrics(names, made, bridges, CELLS)
    assert found == {"bridges": 1, "groups": 1, "gateways": 1, "unreached": 0}
    cut = network_metrics(names, made, [], CELLS)
    assert (cut["groups"], cut["unreached"]) == (2, N)
    bare = [msgspec.structs.replace(patch, interfaces=()) for patch in made]
    assert network_metrics(names, bare, bridges, CELLS)["unreached"] == 2 * N
