import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy import ndimage

from cells.sheets.pressure_transducers import PressureTransducers
from cells.sheets.regions import RegionTracker
from skinnet.deployment.skin.sheets import BoardSpec, PressureSpec, RegionSpec, SheetSpec, SurfaceSpec
from skinnet.errors import DeploymentError
from skinnet.skin.tactile_sheets import PlacedSheet, place_sheets

PITCH_M = 0.0215
AREA_M2 = PITCH_M**2
SIDE_M = 8 * PITCH_M
Pattern = NDArray[np.float64]
KING = np.ones((3, 3), dtype=np.bool_)


def sheets(*names: str, **settings: object) -> tuple[PlacedSheet, ...]:
    surfaces = [
        SurfaceSpec(name=n, body=n, origin_m=(0, 0, 0), normal=(0.0, 0.0, 1.0), up=(0.0, 1.0, 0.0))
        for n in names
    ]
    return place_sheets(
        surfaces,
        [SheetSpec(name=n, surface=n, **settings) for n in names],  # type: ignore[arg-type]
    )


SHEET = sheets("a")[0]


def tracker(*names: str, **settings: float) -> RegionTracker:
    return RegionTracker(sheets(*(names or ("a",))), RegionSpec(**settings))


def track(regions: RegionTracker, *patterns: Pattern) -> list[NDArray[Any]]:
    """Rows of each board after the patterns (8, 8) of all."""
    regions.update(np.concatenate([pattern.ravel() for pattern in patterns]).astype(np.float64))
    return [rows[:n].copy() for rows, n in zip(regions.rows, regions.n_rows, strict=True)]


def blocks(*where: tuple[int, int, int, int], kpa: float = 10.0) -> Pattern:
    """Pressure on rectangles (first row, first column, rows, columns)."""
    pattern = np.zeros((8, 8))
    for row, column, height, width in where:
        pattern[row : row + height, column : column + width] = kpa
    return pattern


def story(regions: RegionTracker, *patterns: Pattern) -> list[list[tuple[int, int, int]]]:
    """(number, kin, elements) of all rows of each frame of one board."""
    return [
        [(int(r["region_id"]), int(r["lineage_id"]), int(r["n_elements"])) for r in track(regions, p)[0]]
        for p in patterns
    ]


def xi_m(row: Any) -> NDArray[np.float64]:
    return np.array([row["xi1_m"], row["xi2_m"]], dtype=np.float64)


readings = st.one_of(st.just(0.0), st.floats(0.01, 90.0))
patterns = hnp.arrays(np.float64, (8, 8), elements=readings)


@given(patterns)
def test_regions_are_connected_groups_with_their_rims(pattern: Pattern) -> None:
    """Against SciPy: groups of active elements; forces add up to those of all active ones and their rims."""
    (rows,) = track(tracker(activation_kpa=5.0, deactivation_kpa=5.0), pattern)
    active = pattern >= 5.0
    label, n = ndimage.label(active, KING)
    assert len(rows) == n
    assert n <= 16
    grid_xi_m = SHEET.xi_m.reshape(8, 8, 2)
    total_n = 0.0
    for i, row in enumerate(rows, start=1):
        mine = label == i
        assert row["n_elements"] == mine.sum()
        assert row["area_m2"] == pytest.approx(mine.sum() * AREA_M2)
        assert row["peak_kpa"] == pytest.approx(pattern[mine].max())
        near = ndimage.binary_dilation(mine, KING)
        with_rim = mine | (near & ~active)
        assert pattern[mine].sum() * AREA_M2 * 1e3 <= row["force_n"] * (1 + 1e-6)
        assert row["force_n"] <= pattern[with_rim].sum() * AREA_M2 * 1e3 * (1 + 1e-6)
        low, high = grid_xi_m[with_rim].min(axis=0), grid_xi_m[with_rim].max(axis=0)
        assert (xi_m(row) >= low - 1e-6).all()
        assert (xi_m(row) <= high + 1e-6).all()
        total_n += float(row["force_n"])
    felt = pattern[ndimage.binary_dilation(active, KING)].sum() * AREA_M2 * 1e3
    assert total_n == pytest.approx(felt, rel=1e-6)
    assert [r["region_id"] for r in rows] == list(range(1, n + 1))


@given(hnp.arrays(np.float64, (8, 8), elements=readings, fill=st.just(0.0)), st.integers(0, 7))
def test_features_turn_and_mirror_with_the_pattern(pattern: Pattern, which: int) -> None:
    """Under the eight symmetries of the square."""
    felt_kpa = pattern[pattern > 0.0]
    assume(len(np.unique(felt_kpa)) == len(felt_kpa))  # else a rim between equals may go to either
    turns, flip = which % 4, which >= 4
    turned = np.rot90(pattern, turns)
    R = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turns)
    if flip:
        turned, R = np.fliplr(turned), np.diag([-1.0, 1.0]) @ R
    (rows,), (turned_rows,) = track(tracker(), pattern), track(tracker(), turned)
    assert len(rows) == len(turned_rows)
    centres = np.array([xi_m(r) for r in rows]).reshape(-1, 2) @ R.T
    turned_centres = np.array([xi_m(r) for r in turned_rows]).reshape(-1, 2)
    for i in range(len(rows)):
        same = np.abs(turned_centres - centres[i]).max(axis=1) < 1e-6
        same &= np.isclose(turned_rows["force_n"], rows["force_n"][i], rtol=1e-5)
        same &= turned_rows["n_elements"] == rows["n_elements"][i]
        assert same.any()


@given(hnp.arrays(np.float64, (4, 4), elements=readings), st.integers(0, 4), st.integers(0, 4))
def test_features_move_with_the_pattern(window: Pattern, down: int, right: int) -> None:
    still, moved = np.zeros((8, 8)), np.zeros((8, 8))
    still[:4, :4] = window
    moved[down : down + 4, right : right + 4] = window
    (before,), (after,) = track(tracker(), still), track(tracker(), moved)
    for name in ("force_n", "peak_kpa", "n_elements", "region_id"):
        assert before[name] == pytest.approx(after[name], rel=1e-6)
    shift = PITCH_M * np.array([right, -down])
    for a, b in zip(before, after, strict=True):
        assert xi_m(b) == pytest.approx(xi_m(a) + shift, abs=1e-7)


@given(st.integers(0, 2**32 - 1))
def test_a_board_does_not_depend_on_its_place_among_others(seed: int) -> None:
    dice = np.random.default_rng(seed)
    order = dice.permutation(3).tolist()
    regions, permuted = tracker("a", "b", "c"), tracker(*(["a", "b", "c"][i] for i in order))
    for _ in range(4):
        pressures = [ndimage.gaussian_filter(dice.uniform(0, 20, (8, 8)), 1.0) - 9.0 for _ in range(3)]
        pressures = [np.maximum(p, 0.0) for p in pressures]
        rows = track(regions, *pressures)
        others = track(permuted, *(pressures[i] for i in order))
        for place, board in enumerate(order):
            mine = rows[board]
            mine["board"] = place
            assert mine.tobytes() == others[place].tobytes()


def test_a_rim_between_two_regions_goes_to_the_higher_pressure() -> None:
    for low, high in ((0, 1), (1, 0)):
        pattern = np.zeros((8, 8))
        pattern[3, 2], pattern[3, 4], pattern[3, 3] = (10.0, 20.0, 0.5) if high else (20.0, 10.0, 0.5)
        (rows,) = track(tracker(), pattern)
        kpa = rows["force_n"] / AREA_M2 / 1e3
        assert (kpa[low], kpa[high]) == pytest.approx((10.0, 20.5), rel=1e-6)
        assert rows["n_elements"].tolist() == [1, 1]


def test_an_element_stays_active_until_it_falls_below_the_lower_threshold() -> None:
    regions = tracker(activation_kpa=1.0, deactivation_kpa=0.6)
    levels = [0.9, 1.0, 0.7, 0.6, 0.59, 0.9]
    seen = [
        len([r for r in frame if r[2]])
        for frame in story(regions, *(blocks((3, 3, 1, 1), kpa=p) for p in levels))
    ]
    assert seen == [0, 1, 1, 1, 0, 0]


def test_of_regions_that_merge_the_larger_goes_on_and_the_other_says_into_which() -> None:
    frames = story(
        tracker(),
        blocks((0, 0, 2, 2), (0, 4, 2, 4)),
        blocks((0, 0, 2, 8)),
        blocks((0, 0, 2, 8)),
    )
    assert frames == [[(1, 0, 4), (2, 0, 8)], [(2, 0, 16), (1, 2, 0)], [(2, 0, 16)]]


def test_of_parts_that_split_the_larger_goes_on_and_the_other_says_from_which() -> None:
    frames = story(tracker(), blocks((0, 0, 2, 8)), blocks((0, 0, 2, 2), (0, 4, 2, 4)), blocks((0, 4, 2, 4)))
    assert frames == [[(1, 0, 16)], [(2, 1, 4), (1, 0, 8)], [(1, 0, 8), (2, 0, 0)]]


def test_of_equal_parts_the_one_nearer_to_the_centre_of_before_goes_on() -> None:
    for heavy, numbers in ((0, [1, 2]), (4, [2, 1])):
        whole = blocks((0, 0, 2, 6))
        whole[:2, heavy : heavy + 2] = 40.0
        frames = story(tracker(), whole, blocks((0, 0, 2, 2), (0, 4, 2, 2)))
        assert [number for number, _, _ in frames[1]] == numbers


def test_regions_exchange_elements_and_keep_their_numbers() -> None:
    """Two bars that move by one element: each shares most with itself."""
    frames = story(
        tracker(),
        blocks((0, 0, 2, 3), (6, 3, 2, 4)),
        blocks((0, 1, 2, 3), (6, 4, 2, 4)),
    )
    assert [sorted(f) for f in frames] == [[(1, 0, 6), (2, 0, 8)]] * 2


def test_a_small_region_may_jump_to_the_next_element_but_not_further() -> None:
    near = story(tracker(), blocks((3, 3, 1, 1)), blocks((4, 4, 1, 1)))
    assert near[1] == [(1, 0, 1)]
    far = story(tracker(), blocks((3, 3, 1, 1)), blocks((3, 5, 1, 1)))
    assert far[1] == [(2, 0, 1), (1, 0, 0)]
    nearest = story(
        tracker(association_distance_m=0.05), blocks((3, 3, 1, 1)), blocks((3, 1, 1, 1), (2, 4, 1, 1))
    )
    assert nearest[1] == [(1, 0, 1), (2, 0, 1)]


def test_what_merged_or_split_off_does_not_jump() -> None:
    """A number that was taken over is not handed to a newcomer beside it."""
    frames = story(
        tracker(association_distance_m=0.1),
        blocks((0, 0, 2, 3), (0, 4, 2, 2)),
        blocks((0, 0, 2, 6), (3, 4, 1, 1)),
    )
    assert frames[1] == [(1, 0, 12), (3, 0, 1), (2, 1, 0)]


def test_numbers_come_back_only_after_all_others_and_never_while_in_use() -> None:
    regions = tracker(association_distance_m=0.0)
    kings = np.zeros((8, 8))
    kings[::2, ::2] = 10.0
    one = blocks((0, 0, 1, 1))
    given_numbers: list[int] = []
    for _ in range(65535 // 15 + 2):
        regions.update(kings.ravel())
        fresh = regions.rows[0, : regions.n_rows[0]]["region_id"].tolist()
        assert fresh[0] == 1
        given_numbers += fresh[1:]
        regions.update(one.ravel())
    assert len(set(given_numbers[:65534])) == 65534
    assert 1 not in given_numbers
    assert 0 not in given_numbers
    assert given_numbers[65534:] == given_numbers[: len(given_numbers) - 65534]


def test_elements_say_to_which_region_they_belong() -> None:
    regions = tracker()
    pattern = blocks((0, 0, 2, 2), (5, 5, 2, 2))
    pattern[2, 0] = 0.5  # rim
    track(regions, pattern)
    expected = np.where(blocks((0, 0, 2, 2)) > 0, 1, 0) + np.where(blocks((5, 5, 2, 2)) > 0, 2, 0)
    assert (regions.region_id.reshape(8, 8) == expected).all()


def test_across_the_gap_of_a_comb_a_contact_is_one_region() -> None:
    comb = ("####", "#.##", "#.##")
    for joins, n in ((True, 1), (False, 2)):
        placed = sheets("a", rows=3, columns=4, mask=comb, connect_across_gaps=joins)
        regions = RegionTracker(placed, RegionSpec())
        pattern = np.array([[0, 0, 0, 0], [9, 0, 9, 9], [9, 0, 9, 9]], dtype=np.float64)
        regions.update(pattern[placed[0].grid[:, 0], placed[0].grid[:, 1]])
        assert regions.n_rows.tolist() == [n]


@given(st.integers(0, 2**32 - 1))
def test_numbers_stay_under_small_motion(seed: int) -> None:
    """A soft contact that wanders by up to 3 mm a frame, read with noise by eight bits."""
    dice = np.random.default_rng(seed)
    spec = BoardSpec()
    transducers = PressureTransducers([SHEET], spec, seed % 1000)
    regions = RegionTracker([SHEET], spec.regions)
    position_m = dice.uniform(-0.05, 0.05, 2)
    out = np.empty(64)
    for frame in range(100):
        pressure = 25.0 * np.exp(-((SHEET.xi_m - position_m) ** 2).sum(axis=1) / (2 * 0.02**2))
        transducers.scan(frame, pressure, pressure, out)
        regions.update(out)
        assert regions.n_rows.tolist() == [1]
        row = regions.rows[0, 0]
        assert row["region_id"] == 1
        assert xi_m(row) == pytest.approx(position_m, abs=0.012)
        position_m = np.clip(position_m + dice.uniform(-0.002, 0.002, 2), -0.06, 0.06)


def test_thresholds_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(DeploymentError, match="may not be above activation_kpa"):
        tracker(activation_kpa=1.0, deactivation_kpa=1.1)


# Statics: pads as an elastic foundation that each element samples at 3 × 3 points, as the body does.

SAMPLES_M = PITCH_M / 3 * np.array([(x, y) for y in (1, 0, -1) for x in (-1, 0, 1)])
STIFFNESS_KPA_M = 1.5e3
Field = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def felt(field: Field, bits: int, noise_kpa: float = 0.0, seed: int = 1) -> tuple[float, NDArray[np.float64]]:
    """Force [N] and centre [m] that a board finds, as one region."""
    spec = BoardSpec(pressure=PressureSpec(bits=bits, noise_kpa=noise_kpa))
    pressure = field(SHEET.xi_m[:, None] + SAMPLES_M).mean(axis=1)
    out = np.empty(64)
    PressureTransducers([SHEET], spec, seed).scan(0, pressure, pressure, out)
    regions = RegionTracker([SHEET], spec.regions)
    regions.update(out)
    assert regions.n_rows.tolist() == [1]
    return float(regions.rows[0, 0]["force_n"]), xi_m(regions.rows[0, 0])


def truth(field: Field) -> tuple[float, NDArray[np.float64]]:
    """Force [N] and centre [m] of the forces at the 576 points, which are those that act on the bodies."""
    points_m = SHEET.xi_m[:, None] + SAMPLES_M
    pressure = field(points_m)
    force_n = float(pressure.mean()) * 1e3 * SIDE_M**2
    return force_n, (pressure[..., None] * points_m).sum(axis=(0, 1)) / pressure.sum()


@given(force_n=st.floats(150.0, 600.0), share=st.floats(0.0, 0.08), angle=st.floats(0.0, 2 * math.pi))
def test_a_plane_pressed_at_a_point(force_n: float, share: float, angle: float) -> None:
    """A rigid plate on the foundation: p = F/A (1 + 12 (x·ξ) / a²) in closed form."""
    position_m = share * SIDE_M * np.array([math.cos(angle), math.sin(angle)])

    def field(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(force_n / SIDE_M**2 * 1e-3 * (1.0 + 12.0 * (points_m @ position_m) / SIDE_M**2))

    found_n, found_m = felt(field, bits=24)
    assert found_n == pytest.approx(force_n, rel=0.001)
    assert np.hypot(*(found_m - position_m)) < 0.0005


def cylinder(dice: np.random.Generator) -> Field:
    """A cylinder of 140 mm pressed into the pads anywhere, in any direction, also with one end first."""
    depth_m, angle, tilt = dice.uniform(0.004, 0.008), dice.uniform(0.0, math.pi), dice.uniform(-0.02, 0.02)
    position_m = dice.uniform(-0.03, 0.03, 2)
    across, along = (
        np.array([math.cos(angle), math.sin(angle)]),
        np.array([-math.sin(angle), math.cos(angle)]),
    )

    def field(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = (points_m - position_m) @ across, (points_m - position_m) @ along
        return np.asarray(STIFFNESS_KPA_M * np.maximum(0.0, depth_m + tilt * y - x * x / 0.14))

    return field


def errors(bits: int, noise_kpa: float, n: int = 60) -> NDArray[np.float64]:
    """Errors of force, relative, and of centre [m], in many poses: (n, 2)."""
    result = []
    for seed in range(n):
        field = cylinder(np.random.default_rng(seed))
        (found_n, found_m), (force_n, centre_m) = felt(field, bits, noise_kpa, seed), truth(field)
        result.append((abs(found_n / force_n - 1.0), np.hypot(*(found_m - centre_m))))
    return np.array(result)


def test_a_cylinder_in_any_pose_within_one_per_cent_and_one_millimetre() -> None:
    force, centre_m = errors(24, 0.0).T
    assert force.max() < 0.001  # the rims make it so; without them it is 8 %
    assert centre_m.max() < 0.0006


def test_errors_grow_as_bits_go() -> None:
    """Eight bits with noise still find force and centre well; five, "more than" which RIBA has, do not."""
    tables = {bits: errors(bits, 0.1) for bits in (8, 6, 5, 4)}
    middle = np.array([np.median(table, axis=0) for table in tables.values()])
    assert (np.diff(middle, axis=0) > 0.0).all()
    assert (np.quantile(tables[8], 0.9, axis=0) < [0.015, 0.001]).all()
    assert (np.quantile(tables[5], 0.9, axis=0) > [0.03, 0.002]).all()
