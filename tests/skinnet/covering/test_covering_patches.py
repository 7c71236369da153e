"""Patches of a covering: components, their names, and bridges, on cells placed by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from link_models import PITCH_M, SIDE_M

from skinnet.covering.covering_patches import (
    bridges_between,
    component_patches,
    patch_name,
)
from skinnet.covering.port_turns import best_turns, turned
from skinnet.deployment.skin.cells import CellSpec
from skinnet.skin.placement import place_patch, resolve_bridges

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


def test_bridges_join_all_components_of_a_link_the_nearest_first() -> None:
    specs = component_patches("skin", "arm", *row(0, 1, 2.4, 3.4, 9), CELLS, 1)
    placed = [place_patch(spec, CELLS) for spec in specs]
    bridges = bridges_between(placed, [HERE] * len(placed), SIDE_M)
    assert [(bridge.a, bridge.b) for bridge in bridges] == [
        ("skin_0/1:0", "skin_1/0:2"),
        ("skin_1/1:0", "skin_2/0:2"),
    ]
    resolve_bridges(bridges, placed)


def test_bridges_form_a_tree() -> None:
    specs = component_patches("skin", "arm", *row(0, 1.3, 2.6, 3.9), CELLS, 1)
    placed = [place_patch(spec, CELLS) for spec in specs]
    bridges = bridges_between(placed, [HERE] * 4, SIDE_M)
    assert sorted((b.a.split("/")[0], b.b.split("/")[0]) for b in bridges) == list(
        pairwise(f"skin_{i}" for i in range(4))
    )


def test_a_bridge_rather_stays_on_its_side() -> None:
    """Of two cells at one distance, the one that faces the other way is joined last."""
    turned_over = np.diag([1.0, -1.0, -1.0])
    specs = [
        spec
        for x, R in ((0.0, np.eye(3)), (-1.4, turned_over), (1.5, np.eye(3)))
        for spec in component_patches(f"at{x:g}", "arm", np.array([[PITCH_M * x, 0, 0]]), R[None], CELLS, 1)
    ]
    bridges = bridges_between([place_patch(spec, CELLS) for spec in specs], [HERE] * 3, SIDE_M)
    assert [bridge.b.split("/")[0] for bridge in bridges] == ["at1_5", "at-1_4"]


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
