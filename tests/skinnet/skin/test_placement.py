"""Cells sit on a hexagonal lattice, upright on their body, and ports that face each other are wired."""

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation
from small_robot import SHIPPED, lattice

from skinnet.deployment import load
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import CellPoseSpec, InterfaceSpec, LatticeSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import PORT_ANGLES_RAD, lattice_cells, pitch_m
from skinnet.skin.placement import PlacedPatch, place_patch, place_patches

Floats = NDArray[np.float64]
CELLS = CellSpec()
PITCH_M = math.sqrt(3.0) * CELLS.side_m
"""Two apothems of a regular hexagon."""

sizes = st.tuples(st.integers(1, 6), st.integers(1, 5))
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
radii = st.floats(0.045, 0.5)


def patch(
    table: dict[str, Any] | None = None,
    cells: tuple[CellPoseSpec, ...] = (),
    ends: tuple[tuple[int, int], ...] = ((0, 2),),
    **more: Any,
) -> PatchSpec:
    spec = None if table is None else LatticeSpec(**table)
    interfaces = tuple(InterfaceSpec(cell=cell, port=port) for cell, port in ends)
    return PatchSpec(**({"name": "p", "body": "b"} | more), lattice=spec, cells=cells, interfaces=interfaces)


def bent(columns: int, rows: int, radius_m: float, **more: Any) -> PlacedPatch:
    columns = min(columns, int(2 * math.pi * radius_m / PITCH_M) - 1)
    return place_patch(patch(lattice(columns, rows, radius_m=radius_m, **more)), CELLS)


def assert_upright(placed: PlacedPatch, normal: Floats) -> None:
    R = placed.R_body_cell
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    np.testing.assert_allclose(R[:, :, 2], np.broadcast_to(normal, (placed.n_cells, 3)), atol=1e-12)


def edge_m(placed: PlacedPatch, cell: int, port: int) -> Floats:
    """Middle of the edge that carries a port."""
    angle = PORT_ANGLES_RAD[port]
    towards = placed.R_body_cell[cell] @ [math.cos(angle), math.sin(angle), 0.0]
    edge: Floats = placed.position_m[cell] + PITCH_M / 2 * towards
    return edge


@given(size=sizes, normal=vectors, up=vectors, origin=vectors)
def test_on_a_plane(
    size: tuple[int, int],
    normal: tuple[float, ...],
    up: tuple[float, ...],
    origin: tuple[float, ...],
) -> None:
    n, u = np.array(normal), np.array(up)
    if np.linalg.norm(np.cross(n, u)) < 1e-3:
        return
    placed = place_patch(patch(lattice(*size, normal=normal, up=up, origin_m=origin)), CELLS)
    n /= np.linalg.norm(n)
    assert placed.n_cells == size[0] * size[1]
    assert_upright(placed, n)
    np.testing.assert_allclose((placed.position_m - origin) @ n, 0.0, atol=1e-12)
    if placed.n_cells > 1:
        np.testing.assert_allclose(pdist(placed.position_m).min(), PITCH_M)
    assert (placed.R_body_cell[0, :, 1] @ u) > 0.0
    for a, port_a, b, port_b in placed.wires.tolist():  # two ends of a wire are one point
        np.testing.assert_allclose(edge_m(placed, a, port_a), edge_m(placed, b, port_b), atol=1e-9)


@given(size=sizes, radius=radii)
def test_around_a_cylinder(size: tuple[int, int], radius: float) -> None:
    placed = bent(*size, radius)
    axis_m = placed.position_m * [1, 0, 1] + [0, 0, radius]  # lattice(): normal is z, up is y
    np.testing.assert_allclose(np.linalg.norm(axis_m, axis=1), radius)
    assert_upright(placed, axis_m / radius)
    np.testing.assert_allclose(placed.R_body_cell[:, :, 1], np.tile([0.0, 1, 0], (placed.n_cells, 1)))
    unrolled = np.column_stack(
        [radius * np.arctan2(axis_m[:, 0], axis_m[:, 2]), placed.position_m[:, 1], np.zeros(placed.n_cells)]
    )
    flat = place_patch(patch(lattice(placed.n_cells // size[1], size[1])), CELLS)
    np.testing.assert_allclose(unrolled, flat.position_m, atol=1e-12)
    assert placed.wires.tolist() == flat.wires.tolist()


@given(size=sizes)
def test_wires_are_those_of_the_lattice(size: tuple[int, int]) -> None:
    """In axial coordinates, ports 0, 1, 2, 3 lead to (q+1, r), (q, r+1), (q−1, r), (q, r−1)."""
    cells = lattice_cells(*size)
    number = {cell: i for i, cell in enumerate(cells)}
    right = {(number[q, r], 0, number[q + 1, r], 2) for q, r in cells if (q + 1, r) in number}
    above = {(number[q, r], 1, number[q, r + 1], 3) for q, r in cells if (q, r + 1) in number}
    placed = place_patch(patch(lattice(*size)), CELLS)
    assert {tuple(wire) for wire in placed.wires.tolist()} == right | above
    ends = Counter(map(tuple, np.vstack([placed.wires[:, :2], placed.wires[:, 2:]]).tolist()))
    assert all(count == 1 for count in ends.values())
    graph = coo_array(
        (np.ones(len(placed.wires)), (placed.wires[:, 0], placed.wires[:, 2])),
        shape=(placed.n_cells, placed.n_cells),
    )
    if size[0] > 1 or size[1] < 3:  # a single column zigzags over edges without ports
        assert connected_components(graph, directed=False)[0] == 1


@given(rotation=vectors, shift=vectors, radius=st.none() | radii)
def test_turning_the_lattice_turns_its_cells(
    rotation: tuple[float, ...], shift: tuple[float, ...], radius: float | None
) -> None:
    R = Rotation.from_rotvec(3.0 * np.array(rotation)).as_matrix()
    still = place_patch(patch(lattice(3, 3, radius_m=radius)), CELLS)
    turned = place_patch(
        patch(lattice(3, 3, radius_m=radius, origin_m=shift, normal=tuple(R[:, 2]), up=tuple(R[:, 1]))), CELLS
    )
    np.testing.assert_allclose(turned.position_m, still.position_m @ R.T + shift, atol=1e-12)
    np.testing.assert_allclose(turned.R_body_cell, R @ still.R_body_cell, atol=1e-12)
    assert turned.wires.tolist() == still.wires.tolist()


@given(size=sizes, radius=st.none() | radii, lengths=st.tuples(st.floats(0.1, 9.0), st.floats(0.1, 9.0)))
def test_cells_placed_by_hand_are_as_those_of_a_lattice(
    size: tuple[int, int], radius: float | None, lengths: tuple[float, float]
) -> None:
    model = place_patch(patch(lattice(*size)), CELLS) if radius is None else bent(*size, radius)
    cells = tuple(
        CellPoseSpec(
            position_m=tuple(position),
            normal=tuple(lengths[0] * R[:, 2]),
            x_axis=tuple(lengths[1] * R[:, 0] + 0.3 * R[:, 2]),  # only its part across the normal counts
        )
        for position, R in zip(model.position_m, model.R_body_cell, strict=True)
    )
    placed = place_patch(patch(cells=cells), CELLS)
    np.testing.assert_allclose(placed.position_m, model.position_m)
    np.testing.assert_allclose(placed.R_body_cell, model.R_body_cell, atol=1e-12)
    assert placed.wires.tolist() == model.wires.tolist()


def test_cells_that_turn_away_are_not_wired() -> None:
    """Ports lie at 0°, 60°, 180°, 240°: turned by 60° a cell has none at 0°."""
    for degrees, wired in ((0, True), (180, True), (60, False)):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        pair = tuple(
            CellPoseSpec(position_m=(x, 0.0, 0.0), normal=(0, 0, 1), x_axis=axis)
            for x, axis in ((0.0, (c, s, 0.0)), (PITCH_M, (1.0, 0.0, 0.0)))
        )
        assert bool(len(place_patch(patch(cells=pair, ends=((0, 3),)), CELLS).wires)) == wired


def by_hand(*positions_m: float, **more: Any) -> PatchSpec:
    cells = tuple(CellPoseSpec(position_m=(x, 0, 0), normal=(0, 0, 1), x_axis=(1, 0, 0)) for x in positions_m)
    return patch(cells=cells, **more)


def test_overlapping_cells_are_refused() -> None:
    place_patch(by_hand(0.0, PITCH_M, 2 * PITCH_M), CELLS)
    with pytest.raises(
        DeploymentError, match=r"patches\.p: cells 1 and 2 overlap.* 10\.0 mm apart; 24\.2 mm"
    ):
        place_patch(by_hand(0.0, PITCH_M, PITCH_M + 0.01), CELLS)
    with pytest.raises(DeploymentError, match="radius"):
        place_patch(patch(lattice(12, 1, radius_m=0.045)), CELLS)
    with pytest.raises(DeploymentError, match=r"patches\.p: cells"):  # chords far shorter than their arcs
        place_patch(patch(lattice(2, 1, radius_m=0.0085)), CELLS)


def test_cells_back_to_back_in_one_patch_do_not_overlap_and_share_no_wire() -> None:
    """Both sides of a plate of 4 mm, the back one shifted as far as a neighbour would be."""
    for shift_m in (0.0, 0.5 * PITCH_M, PITCH_M):
        sides = tuple(
            CellPoseSpec(position_m=(x, 0.0, z), normal=(0, 0, math.copysign(1.0, z)), x_axis=(1, 0, 0))
            for x, z in ((0.0, 0.002), (shift_m, -0.002))
        )
        assert not len(place_patch(patch(cells=sides), CELLS).wires)


def test_of_two_neighbours_at_30_degrees_one_gets_the_port() -> None:
    def at(angle_deg: float) -> CellPoseSpec:
        c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
        axis = (-c, -s, 0.0)  # its port 0 faces the first cell
        return CellPoseSpec(position_m=(PITCH_M * c, PITCH_M * s, 0), normal=(0, 0, 1), x_axis=axis)

    first = CellPoseSpec(position_m=(0, 0, 0), normal=(0, 0, 1), x_axis=(1, 0, 0))
    for angles, winner in (((30.0, -30.0), 1), ((30.0, -29.0), 2), ((28.0, -31.0), 1)):
        wires = place_patch(patch(cells=(first, *map(at, angles)), ends=((0, 2),)), CELLS).wires
        assert [row for row in wires.tolist() if row[:2] == [0, 0]] == [[0, 0, winner, 0]]


def test_patches_of_one_body_may_not_overlap_but_lie_back_to_back() -> None:
    one, other = patch(lattice(2, 2)), patch(lattice(2, 2, origin_m=(0.01, 0, 0)), name="q")
    with pytest.raises(DeploymentError, match=r"patches\.q: cell \d overlaps cell \d of p on b"):
        place_patches((one, other), CELLS)
    elsewhere = patch(lattice(2, 2, origin_m=(0.01, 0, 0)), name="q", body="c")
    back = patch(lattice(2, 2, origin_m=(0.0, 0.0, -0.015), normal=(0, 0, -1)), name="q")
    for second in (elsewhere, back):
        assert [placed.name for placed in place_patches((one, second), CELLS)] == ["p", "q"]


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        (patch(), "either lattice or cells"),
        (
            patch(
                lattice(1, 1),
                cells=(CellPoseSpec(position_m=(0, 0, 0), normal=(0, 0, 1), x_axis=(1, 0, 0)),),
            ),
            "either lattice or cells",
        ),
        (patch(lattice(2, 1, normal=(0, 0, 0))), r"p\.lattice\.normal .*length above zero"),
        (patch(lattice(2, 1, up=(0, 0, 5))), r"p\.lattice\.up .*parallel"),
        (
            patch(cells=(CellPoseSpec(position_m=(0, 0, 0), normal=(0, 0, 1), x_axis=(0, 0, 2)),)),
            r"p\.cells\[0\]\.x_axis",
        ),
        (patch(lattice(2, 1), ends=((2, 0),)), r"interfaces\[0\]\.cell = 2: .*0 to 1"),
        (patch(lattice(2, 1), ends=((0, 0),)), r"cell 0 port 0: .*in use.*\[1, 2, 3\]"),
        (patch(lattice(2, 1), ends=((0, 2), (0, 2))), r"interfaces\[1\] = cell 0 port 2: .*\[1, 3\]"),
    ],
)
def test_what_cannot_be_placed(spec: PatchSpec, said: str) -> None:
    with pytest.raises(DeploymentError, match=said):
        place_patch(spec, CELLS)


def test_shipped_patches_are_each_in_one_piece() -> None:
    deployment = load(SHIPPED)
    assert pitch_m(deployment.cells.side_m) == PITCH_M
    for placed in place_patches(deployment.patches, deployment.cells):
        n = placed.n_cells
        graph = coo_array(
            (np.ones(len(placed.wires)), (placed.wires[:, 0], placed.wires[:, 2])), shape=(n, n)
        )
        assert connected_components(graph, directed=False)[0] == 1
        assert (pdist(placed.position_m) > 0.95 * PITCH_M).all()


def test_islands_are_refused() -> None:
    """One column of cells cannot be wired through: no port looks to where the third row is."""
    with pytest.raises(DeploymentError, match=r"patches\.p: no path leads from cell 2 \(2 in all\)"):
        place_patches([patch(lattice(1, 4))], CELLS)
