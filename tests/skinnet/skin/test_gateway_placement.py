"""Gateways lie where they should, on free ports, and the whole skin is one graph."""

from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path
from small_robot import lattice, patch, small

from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import InterfaceSpec, LatticeSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.gateway_placement import (
    MAX_GATEWAY_PORTS,
    choose_gateway_ports,
    free_ports,
    place_gateways,
    with_placed_gateways,
)
from skinnet.skin.lattice import N_PORTS
from skinnet.skin.placement import PlacedPatch, place_patch, place_patches, resolve_bridges
from skinnet.skin.whole_skin import join_patches, require_gateway_ports

CELLS = CellSpec()


def spec_of(columns: int, rows: int) -> PatchSpec:
    sheet = LatticeSpec(**lattice(columns, rows))
    return PatchSpec(name="p", body="b", lattice=sheet, interfaces=(InterfaceSpec(cell=0, port=2),))


def placed(columns: int, rows: int) -> PlacedPatch:
    return place_patch(spec_of(columns, rows), CELLS)


def hops(patch: PlacedPatch) -> NDArray[np.int64]:
    ends = patch.wires
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 2])), shape=(patch.n_cells,) * 2).tocsr()
    return np.asarray(shortest_path(graph, directed=False, unweighted=True), dtype=np.int64)


@given(columns=st.integers(2, 6), rows=st.integers(1, 5))
def test_free_ports_are_those_without_a_wire(columns: int, rows: int) -> None:
    patch = placed(columns, rows)
    free = {tuple(port) for port in free_ports(patch.n_cells, patch.wires).tolist()}
    wired = {tuple(end) for end in patch.wires.reshape(-1, 2).tolist()}
    assert not free & wired
    assert len(free) + len(wired) == N_PORTS * patch.n_cells
    taken = sorted(free)[0]
    assert {tuple(p) for p in free_ports(patch.n_cells, patch.wires, [taken]).tolist()} == free - {taken}


@settings(max_examples=30)
@given(columns=st.integers(2, 6), rows=st.integers(1, 5), data=st.data())
def test_places_are_free_different_and_always_the_same(columns: int, rows: int, data: st.DataObject) -> None:
    patch = placed(columns, rows)
    ports = free_ports(patch.n_cells, patch.wires)
    k = data.draw(st.integers(1, len(np.unique(ports[:, 0]))))
    places = place_gateways(patch, k)
    assert len(set(places[:, 0].tolist())) == k
    assert {tuple(p) for p in places.tolist()} <= {tuple(p) for p in ports.tolist()}
    assert place_gateways(patch, k).tolist() == places.tolist()
    changed = with_placed_gateways(spec_of(columns, rows), CELLS, k)
    assert [(i.cell, i.port) for i in changed.interfaces] == [tuple(p) for p in places.tolist()]
    place_patches((changed,), CELLS)  # is a valid patch


@pytest.mark.parametrize("columns", [2, 4, 5, 6, 7])
def test_the_deepest_cell_is_as_near_as_can_be(columns: int) -> None:
    """Against all choices there are."""
    for rows, k in product(range(1, 5), range(1, 4)):
        patch = placed(columns, rows)
        distance = hops(patch)
        edge = np.unique(free_ports(patch.n_cells, patch.wires)[:, 0]).tolist()
        best = min(
            (int(distance[list(cells)].min(axis=0).max()) for cells in combinations(edge, k)), default=None
        )
        if best is not None:
            assert distance[place_gateways(patch, k)[:, 0]].min(axis=0).max() == best, (columns, rows, k)


def test_a_line_is_shared_out_evenly() -> None:
    patch = placed(12, 1)
    assert place_gateways(patch, 1)[0, 0] in (5, 6)
    assert place_gateways(patch, 2)[:, 0].tolist() in ([2, 8], [2, 9], [3, 8], [3, 9])
    assert (
        place_gateways(patch, 3)[:, 0].tolist() == [1, 5, 9]
        or hops(patch)[place_gateways(patch, 3)[:, 0]].min(0).max() == 2
    )


def test_more_gateways_never_deepen_a_tree() -> None:
    patch = placed(6, 5)
    distance = hops(patch)
    most = len(np.unique(free_ports(patch.n_cells, patch.wires)[:, 0]))
    depth = [int(distance[place_gateways(patch, k)[:, 0]].min(axis=0).max()) for k in range(1, most + 1)]
    assert depth == sorted(depth, reverse=True)


def test_what_cannot_be() -> None:
    patch = placed(4, 3)
    edge = len(np.unique(free_ports(patch.n_cells, patch.wires)[:, 0]))
    with pytest.raises(DeploymentError, match=f"patches.p: {edge + 1} gateways: give 1 to {edge}"):
        place_gateways(patch, edge + 1)
    with pytest.raises(DeploymentError, match="more connected components"):
        choose_gateway_ports(3, [[0, 0, 1, 2]], np.array([[0, 1], [1, 1], [2, 1]]), 1)
    assert choose_gateway_ports(3, [[0, 0, 1, 2]], np.array([[0, 1], [1, 1], [2, 1]]), 2)[:, 0].tolist() in (
        [0, 2],
        [1, 2],
    )


def whole(**tables: Any) -> Any:
    deployment = small(patch("arm", 3, 2), patch("hand", 2, 2), patch("leg", 2, 1), **tables)
    pieces = place_patches(deployment.patches, deployment.cells, deployment.bridges)
    return join_patches(pieces, resolve_bridges(deployment.bridges, pieces))


def test_the_whole_skin_keeps_every_wire() -> None:
    skin = whole(bridges=({"a": "arm/2:0", "b": "hand/0:3"},))
    assert (skin.n_cells, skin.first_cell.tolist()) == (12, [0, 6, 10, 12])
    assert skin.bridges.tolist() == [[2, 0, 6, 3]]
    assert (
        skin.component_of_patch.tolist()[0]
        == skin.component_of_patch.tolist()[1]
        != skin.component_of_patch.tolist()[2]
    )
    assert skin.gateways.tolist() == [[0, 2], [6, 2], [10, 2]]
    assert [skin.cell_name(cell) for cell in (0, 5, 6, 11)] == ["arm/0", "arm/5", "hand/0", "leg/1"]
    start = 0
    for piece, first in zip(skin.patches, skin.first_cell, strict=False):
        mine = skin.wires[start : start + len(piece.wires)]
        assert (mine - [first, 0, first, 0]).tolist() == piece.wires.tolist()
        start += len(piece.wires)
    assert start == len(skin.wires) - 1


def test_feeds_are_gateways_unless_named() -> None:
    skin = whole()
    assert skin.feed_cells(()).tolist() == [0, 6, 10]
    assert skin.feed_cells(("hand/3:1", "arm/5:0")).tolist() == [9, 5]
    with pytest.raises(DeploymentError, match=r"power.feeds\[0\] = 'hand/4:0': hand has cells 0 to 3"):
        skin.feed_cells(("hand/4:0",))
    with pytest.raises(
        DeploymentError, match=r"power.feeds\[1\] = 'foot/0:0': unknown patch; there are arm, hand"
    ):
        skin.feed_cells(("hand/0:0", "foot/0:0"))


def test_a_group_has_no_more_interfaces_than_a_gateway_has_ports() -> None:
    """Bridges make two patches one group, with one gateway."""
    n = MAX_GATEWAY_PORTS // 2 + 1
    ends = tuple(InterfaceSpec(cell=cell, port=1) for cell in range(n))
    lattices = [
        LatticeSpec(columns=n, rows=1, origin_m=(0.0, y, 0.0), normal=(0.0, 0.0, 1.0), up=(0.0, 1.0, 0.0))
        for y in (0.0, 0.5)
    ]
    rows = [
        PatchSpec(name=name, body="b", lattice=lattice, interfaces=ends)
        for name, lattice in zip(("one", "other"), lattices, strict=True)
    ]
    placed = place_patches(rows, CELLS)
    require_gateway_ports(join_patches(placed))
    bridges = resolve_bridges((BridgeSpec(a="one/0:3", b="other/0:3"),), placed)
    with pytest.raises(
        DeploymentError, match=r"patches\.one, other: 18 interfaces, but a gateway has at most 16 ports"
    ):
        require_gateway_ports(join_patches(placed, bridges))
