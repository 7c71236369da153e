"""Patches of a covering: components, their names, bridges and gateways, on cells placed by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from link_models import PITCH_M, SIDE_M

from skinnet.covering.covering_patches import (
    bridges_between,
    component_patches,
    patch_name,
    with_one_gateway_each,
)
from skinnet.covering.port_turns import best_turns, turned
from skinnet.deployment.skin.cells import CellSpec
from skinnet.skin.placement import place_patch, place_patches

CELLS = CellSpec(side_m=SIDE_M)
HERE = (np.eye(3), np.zeros(3))


def row(*x: float, turn: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Cells at multiples of the pitch along their x axis, all turned by `turn` × 60°."""
    position_m = np.array([[PITCH_M * value, 0.0, 0.0] for value in x])
    R = np.repeat(np.eye(3)[None], len(x), axis=0)
    return position_m, turned(R, np.full(len(x), turn))


def test_components_of_the_wiring_are_patches_the_largest_first() -> None:
    patches = component_patches("skin", "arm", *row(0, 1, 3, 4, 5, 8), CELLS, 1)
    assert [patch.name for patch in patches] == ["skin_0", "skin_1", "skin_2"]
    assert [patch.n_cells for patch in patches] == [3, 2, 1]
    assert patches[0].cells[0].position_m[0] == pytest.approx(3 * PITCH_M, abs=1e-6)
    assert [patch.n_cells for patch in component_patches("s", "arm", *row(0, 1, 3, 4, 5, 8), CELLS, 2)] == [
        3,
        2,
    ]
    assert [patch.name for patch in component_patches("skin", "arm", *row(0, 1), CELLS, 1)] == ["skin"]


def test_names_have_only_what_names_may_have() -> None:
    assert patch_name("skin", "left arm:0", "12") == "skin_left_arm_0_12"
    long = patch_name("skin", "x" * 100, "12")
    assert len(long) == 64
    assert long.endswith("_12")


def test_bridges_join_near_components_by_free_ports_and_leave_far_ones() -> None:
    specs = component_patches("skin", "arm", *row(0, 1, 2.4, 3.4, 9), CELLS, 1)
    placed = [place_patch(spec, CELLS) for spec in specs]
    bridges = bridges_between(placed, [HERE] * len(placed), SIDE_M)
    assert [(bridge.a, bridge.b) for bridge in bridges] == [("skin_0/1:0", "skin_1/0:2")]
    joined = with_one_gateway_each(specs, bridges, CELLS)
    assert [len(spec.interfaces) for spec in joined].count(1) == 2
    assert len(joined[2].interfaces) == 1  # the far cell has one of its own
    place_patches(joined, CELLS, bridges)


def test_bridges_form_a_tree() -> None:
    specs = component_patches("skin", "arm", *row(0, 1.3, 2.6, 3.9), CELLS, 1)
    placed = [place_patch(spec, CELLS) for spec in specs]
    bridges = bridges_between(placed, [HERE] * 4, SIDE_M)
    assert sorted((b.a.split("/")[0], b.b.split("/")[0]) for b in bridges) == list(
        pairwise(f"skin_{i}" for i in range(4))
    )
    assert sum(len(spec.interfaces) for spec in with_one_gateway_each(specs, bridges, CELLS)) == 1


def test_turns_join_cells_whose_ports_do_not_face() -> None:
    """Cells turned by 60° have no ports along the row; turns by 60° give them some."""
    position_m, R = row(0, 1, 2, 3, turn=1)
    assert not len(place_patch(component_patches("s", "arm", position_m, R, CELLS, 1)[0], CELLS).wires)
    turns, components, wires = best_turns(position_m, R, PITCH_M)
    assert (components, wires) == (1, 3)
    [spec] = component_patches("s", "arm", position_m, turned(R, turns), CELLS, 1)
    assert len(place_patch(spec, CELLS).wires) == 3


def test_a_turn_keeps_the_hexagon_and_the_normal() -> None:
    R = turned(np.eye(3)[None], np.array([1]))[0]
    assert R[:, 2] == pytest.approx([0.0, 0.0, 1.0])
    assert R[:, 0] == pytest.approx([math.cos(math.pi / 3), math.sin(math.pi / 3), 0.0])
    assert np.linalg.det(R) == pytest.approx(1.0)
