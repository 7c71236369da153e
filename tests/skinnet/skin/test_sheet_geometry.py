import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from skinnet.deployment.skin.sheets import SheetSpec, SurfaceSpec
from skinnet.errors import DeploymentError
from skinnet.skin.tactile_sheets import PlacedSheet, Surface, build_surface, place_sheets

PITCH_M = 0.0215
COMB = (
    "########",
    "########",
    "#.####.#",
    "#.####.#",
    "#.####.#",
    "#.####..",
    "..####..",
    "..####..",
)


def surface(radius_m: float | None = None, flat_m: float = 0.0, name: str = "arm") -> SurfaceSpec:
    return SurfaceSpec(
        name=name,
        body=name,
        origin_m=(0.1, -0.2, 0.3),
        normal=(1.0, 2.0, -0.5),
        up=(0.2, 0.1, 1.0),
        radius_m=radius_m,
        flat_m=flat_m,
    )


SHAPES = {"plane": surface(), "cylinder": surface(0.055), "semi_flat": surface(0.041, 0.086)}


def sheet(**settings: object) -> PlacedSheet:
    spec = SheetSpec(name="inner", surface="arm", **settings)  # type: ignore[arg-type]
    return place_sheets([SHAPES["semi_flat"]], [spec])[0]


def reach_m(placed: Surface) -> float:
    return min(placed.max_xi1_m, 0.3)


coordinates = st.tuples(st.floats(-0.999, 0.999), st.floats(-0.2, 0.2))


@pytest.mark.parametrize("shape", SHAPES)
@given(at=coordinates, height_m=st.floats(-0.02, 0.1))
def test_tactile_coordinates_and_back(shape: str, at: tuple[float, float], height_m: float) -> None:
    placed = build_surface(SHAPES[shape])
    xi_m = np.array([at[0] * reach_m(placed), at[1]])
    position_m, _ = placed.frame_at(xi_m, height_m)
    back_m, back_height_m = placed.tactile_coordinates(position_m)
    assert back_m == pytest.approx(xi_m, abs=1e-12)
    assert back_height_m == pytest.approx(height_m, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@given(at=coordinates)
def test_tangents_are_derivatives_and_orthonormal(shape: str, at: tuple[float, float]) -> None:
    """Equal to finite differences, so ξ is metric and orthogonal; also where flat and round meet."""
    placed = build_surface(SHAPES[shape])
    xi_m = np.array([at[0] * reach_m(placed), at[1]])
    _, rotation = placed.frame_at(xi_m)
    h = 1e-6
    for axis in (0, 1):
        step = h * np.eye(2)[axis]
        slope = (placed.frame_at(xi_m + step)[0] - placed.frame_at(xi_m - step)[0]) / (2 * h)
        assert slope == pytest.approx(rotation[:, axis], abs=2e-5)
    assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_shapes_are_what_they_are_called() -> None:
    cylinder = build_surface(SHAPES["cylinder"])
    xi_m = np.column_stack([np.linspace(-0.17, 0.17, 50), np.linspace(-0.1, 0.1, 50)])
    position_m, rotation = cylinder.frame_at(xi_m, 0.01)
    local = (position_m - cylinder.origin_m) @ cylinder.R_body_surface
    assert np.hypot(local[:, 0], local[:, 2] + 0.055) == pytest.approx(np.full(50, 0.065))
    outward = local * [1, 0, 1] + [0, 0, 0.055]
    assert rotation[:, :, 2] == pytest.approx((outward / 0.065) @ cylinder.R_body_surface.T)
    flat = build_surface(SHAPES["semi_flat"])
    middle = np.column_stack([np.linspace(-0.043, 0.043, 20), np.zeros(20)])
    plane = build_surface(SHAPES["plane"])
    assert flat.frame_at(middle)[0] == pytest.approx(plane.frame_at(middle)[0], abs=1e-15)
    edge_m = flat.tactile_coordinates(flat.frame_at([flat.max_xi1_m - 1e-9, 0.0])[0])[0][0]
    assert edge_m == pytest.approx(0.043 + math.pi * 0.041)


def test_a_sheet_reads_like_its_mask_from_outside() -> None:
    """First element: top left, as seen by one who looks against the normal with `up` upwards."""
    placed = sheet(mask=COMB)
    assert placed.n_elements == 47
    shown = np.full((8, 8), ".")
    shown[placed.grid[:, 0], placed.grid[:, 1]] = "#"
    assert tuple("".join(row) for row in shown) == COMB
    frame = placed.surface.R_body_surface
    right, up, normal = frame.T
    assert np.cross(right, up) == pytest.approx(normal)
    first, second = placed.position_m[:2] - placed.surface.origin_m
    assert first @ up > 0.0 > first @ right
    assert (second - first) @ right > 0.0
    assert placed.xi_m[0] == pytest.approx([-3.5 * PITCH_M, 3.5 * PITCH_M])
    assert placed.area_m2 == pytest.approx(0.0215**2)
    for i, xi_m in enumerate(placed.xi_m):
        position_m, rotation = placed.surface.frame_at(xi_m)
        assert placed.position_m[i] == pytest.approx(position_m)
        assert placed.R_body_element[i] == pytest.approx(rotation)


def test_two_sheets_share_the_coordinates_of_their_surface() -> None:
    above, below = place_sheets(
        [SHAPES["semi_flat"]],
        [
            SheetSpec(name=name, surface="arm", centre_xi_m=(0.0, sign * 4 * PITCH_M))
            for name, sign in (("above", 1), ("below", -1))
        ],
    )
    assert above.surface is below.surface
    step = above.xi_m[-8:] - below.xi_m[:8]
    assert step == pytest.approx(np.tile([0.0, PITCH_M], (8, 1)))
    assert below.surface.tactile_coordinates(below.position_m)[0] == pytest.approx(below.xi_m)


def test_the_robot_has_468_elements() -> None:
    surfaces, sheets = [], []
    for part, masks in (("upper_arm", ((), ())), ("forearm", (COMB, COMB))):
        for side in "lr":
            surfaces.append(surface(0.041, 0.086, f"{side}_{part}"))
            sheets += [
                SheetSpec(
                    name=f"{side}_{part}{i}",
                    surface=f"{side}_{part}",
                    centre_xi_m=(0.0, (i - 0.5) * 8 * PITCH_M),
                    mask=mask,
                )
                for i, mask in enumerate(masks)
            ]
    for part, columns in (("hand", 2), ("shoulder_pad", 4)):
        for side in "lr":
            surfaces.append(surface(name=f"{side}_{part}"))
            sheets.append(SheetSpec(name=f"{side}_{part}", surface=f"{side}_{part}", rows=2, columns=columns))
    placed = place_sheets(surfaces, sheets)
    by_part = {p: sum(s.n_elements for s in placed if p in s.name) for p in ("upper", "fore", "hand", "pad")}
    assert by_part == {"upper": 2 * 128, "fore": 2 * 94, "hand": 2 * 4, "pad": 2 * 8}
    assert [s.n_elements for s in sheets] == [s.n_elements for s in placed]
    assert sum(s.n_elements for s in placed) == 468


def pairs(placed: PlacedSheet) -> set[tuple[int, int]]:
    return {(a, b) for a, b in placed.neighbours.tolist()}


def beside(grid: NDArray[np.int64]) -> set[tuple[int, int]]:
    """Pairs at most a row and a column apart, found by looking at all."""
    return {(a, b) for a, b in combinations(range(len(grid)), 2) if np.abs(grid[a] - grid[b]).max() == 1}


def test_neighbours_of_a_full_sheet() -> None:
    placed = sheet()
    assert pairs(placed) == beside(placed.grid)
    assert len(placed.neighbours) == 2 * 8 * 7 + 2 * 7 * 7


def test_teeth_of_a_comb_are_neighbours_as_if_they_touched() -> None:
    cut, joined = sheet(mask=COMB, connect_across_gaps=False), sheet(mask=COMB)
    assert pairs(cut) == beside(cut.grid)
    number = {(r, c): i for i, (r, c) in enumerate(joined.grid.tolist())}
    across = {(number[r, 0], number[s, 2]) for r in range(2, 6) for s in range(2, 8)}
    across |= {(number[r, 5], number[s, 7]) for r in range(2, 8) for s in range(2, 5)}
    rows = joined.grid[:, 0]
    across = {(min(pair), max(pair)) for pair in across if abs(rows[pair[0]] - rows[pair[1]]) <= 1}
    assert pairs(joined) - pairs(cut) == across
    assert pairs(cut) < pairs(joined)


def test_a_gap_of_two_stays_open() -> None:
    placed = sheet(rows=1, columns=5, mask=("#..##",))
    assert pairs(placed) == {(1, 2)}
    tall = place_sheets(
        [SHAPES["plane"]], [SheetSpec(name="tall", surface="arm", rows=3, columns=1, mask=("#", ".", "#"))]
    )
    assert pairs(tall[0]) == {(0, 1)}


@pytest.mark.parametrize(
    ("surfaces", "sheets", "text"),
    [
        ([surface(), surface()], [], "duplicate"),
        ([surface(flat_m=0.1)], [], "not allowed on a plane"),
        ([surface()], [SheetSpec(name="a", surface="leg")], "'leg': unknown; there are arm"),
        ([surface()], [SheetSpec(name="a", surface="arm")] * 2, "duplicate"),
        ([surface(0.02)], [SheetSpec(name="a", surface="arm")], "on both sides"),
        ([surface()], [SheetSpec(name="a", surface="arm", mask=("#",) * 8)], "8 texts of 8"),
        ([surface()], [SheetSpec(name="a", surface="arm", mask=("###x####",) * 8)], "8 texts of 8"),
        ([surface()], [SheetSpec(name="a", surface="arm", rows=1, columns=2, mask=("..",))], "no element"),
        ([surface()], [SheetSpec(name=n, surface="arm") for n in "ab"], "element 0 overlaps element 0 of a"),
    ],
)
def test_what_does_not_hold_is_refused(
    surfaces: list[SurfaceSpec], sheets: list[SheetSpec], text: str
) -> None:
    with pytest.raises(DeploymentError, match=text):
        place_sheets(surfaces, sheets)


def test_degenerate_vectors_are_refused() -> None:
    with pytest.raises(DeploymentError, match="parallel"):
        build_surface(
            SurfaceSpec(name="s", body="b", origin_m=(0, 0, 0), normal=(0.0, 0.0, 2.0), up=(0.0, 0.0, 1.0))
        )
    with pytest.raises(DeploymentError, match="finite length"):
        build_surface(
            SurfaceSpec(name="s", body="b", origin_m=(0, 0, 0), normal=(0.0, 0.0, 0.0), up=(0.0, 0.0, 1.0))
        )
