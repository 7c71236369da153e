"""Foam with a curve of compression: the table is what a plate feels, and no cycle makes energy."""

from pathlib import Path

import body_scenes
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from skinnet.body.contact.compliant_layer import compliant_layer
from skinnet.body.contact.foam import Foam
from skinnet.body.contact.foam_curve import closing_response, compressed_state, stored_energy_j_per_m2
from skinnet.body.simulation import BodySimulation
from skinnet.deployment.robot import FoamCurveSpec, FoamSpec
from skinnet.deployment.servo import ServoSpec

Floats = NDArray[np.float64]

THICK_M, FACE_M, MS = 0.012, 1.012, 1_000_000
STRAIN = (0.0, 0.05, 0.1, 0.2, 0.4, 0.5, 0.6, 0.7, 0.75)
LOADING_KPA = (0.0, 1.2, 2.0, 2.5, 3.2, 3.9, 5.6, 10.0, 15.0)
UNLOADING_KPA = (0.0, 0.3, 0.7, 1.2, 1.8, 2.3, 3.6, 7.5, 15.0)
SOFT = FoamCurveSpec(strain=STRAIN, loading_kpa=LOADING_KPA, unloading_kpa=UNLOADING_KPA)
NARROW = FoamCurveSpec(
    strain=STRAIN, loading_kpa=LOADING_KPA, unloading_kpa=UNLOADING_KPA, reversal_strain=0.005
)
ELASTIC = FoamCurveSpec(strain=STRAIN, loading_kpa=LOADING_KPA)
STRAIGHT = FoamCurveSpec(strain=(0.0, 0.3, 1.0), loading_kpa=(0.0, 5.4, 18.0))
CURVES = st.sampled_from([SOFT, NARROW, ELASTIC, STRAIGHT])
PLATE = """
<mujoco>
  <option gravity="0 0 {gravity}"/>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.01"/></body>
    <body name="plate" pos="0 0 {height}">
      <freejoint/><geom type="box" size="0.05 0.05 0.01" pos="0 0 0.01" mass="{mass}"/>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""


def plate(
    folder: Path, foam: FoamSpec, mass_kg: float = 1.0, gravity: float = -9.81, **body: float
) -> BodySimulation:
    """A plate of 10 x 10 cm, its underside on the face of foam under 12 x 12 cells."""
    mjcf = PLATE.format(height=FACE_M, mass=mass_kg, gravity=gravity)
    patches = (body_scenes.lattice_patch("skin", "base", 12, 12),)
    servo = ServoSpec(kp_nm_per_rad=1e-9, kv_nm_s_per_rad=0.0)
    return body_scenes.body_of(folder, mjcf, patches, ("turn",), foam=foam, servo=servo, **body)


def pressed_m2(body: BodySimulation) -> float:
    """Area of the points under the plate [m²], now."""
    points = body.cell_foundation.problem.points
    return float(points.area_m2[: int(points.total[0])].sum())


def table_pa(strain: Floats | float, column: tuple[float, ...]) -> Floats:
    return 1e3 * np.interp(strain, STRAIN, column)


def forces_n(body: BodySimulation, depths_m: Floats) -> Floats:
    """Force on the plate [N] at rest at each depth in turn."""
    found = []
    for depth_m in depths_m:
        body.data.qpos[2] = FACE_M - depth_m
        body.dynamics.compute_contact()
        found.append(body.cell_foundation.contact.force_n.sum())
    return np.array(found)


@pytest.mark.parametrize("curve", [SOFT, ELASTIC], ids=["hysteresis", "elastic"])
@pytest.mark.parametrize("mass_kg", [0.5, 2.0, 3.0, 8.0])
def test_a_weight_sinks_to_where_the_table_carries_it(
    tmp_path: Path, curve: FoamCurveSpec, mass_kg: float
) -> None:
    body = plate(tmp_path, FoamSpec(curve=curve, damping_pa_s_per_m=2e5), mass_kg)
    body.advance(4000 * MS)
    assert abs(body.data.qvel[2]) < 1e-4, "at rest"
    total_n = body.stimulus()[:, :3].sum()
    pressure_kpa = 1e-3 * 9.81 * mass_kg / pressed_m2(body)
    expected_m = THICK_M * np.interp(pressure_kpa, LOADING_KPA, STRAIN)
    assert FACE_M - body.data.qpos[2] == pytest.approx(expected_m, rel=0.005)
    assert total_n == pytest.approx(9.81 * mass_kg, rel=0.005)


def test_a_plate_that_is_driven_slowly_draws_the_table(tmp_path: Path) -> None:
    body = plate(tmp_path, FoamSpec(curve=NARROW), gravity=0.0)
    down_m = THICK_M * np.linspace(0.0005, 0.75, 500)
    up_m = down_m[::-1]
    loading_n, unloading_n = forces_n(body, down_m), forces_n(body, up_m)
    area_m2 = pressed_m2(body)
    assert loading_n == pytest.approx(area_m2 * table_pa(down_m / THICK_M, LOADING_KPA), rel=1e-9)
    gone_back = up_m <= THICK_M * (0.75 - 0.005)
    expected_n = area_m2 * table_pa(up_m / THICK_M, UNLOADING_KPA)
    assert unloading_n[gone_back] == pytest.approx(expected_n[gone_back], rel=1e-9)
    lost_j = np.trapezoid(loading_n, down_m) + np.trapezoid(unloading_n, up_m)
    grid = np.linspace(0.0, 0.75, 7501)
    between_pa = table_pa(grid, LOADING_KPA) - table_pa(grid, UNLOADING_KPA)
    assert lost_j == pytest.approx(area_m2 * THICK_M * np.trapezoid(between_pa, grid), rel=0.01)


def test_every_contact_begins_on_the_loading_curve(tmp_path: Path) -> None:
    body = plate(tmp_path, FoamSpec(curve=SOFT), gravity=0.0)
    path_m = THICK_M * np.array([0.3, 0.6, 0.3, 0.2])
    first_n = forces_n(body, path_m)
    assert first_n[2] < first_n[0]
    forces_n(body, np.array([-0.001]))
    assert forces_n(body, path_m) == pytest.approx(first_n, rel=1e-12)


def test_a_load_that_comes_and_goes_slowly_loses_the_area_between_the_columns(tmp_path: Path) -> None:
    """The work of the load in whole steps of the simulation, foam without damping."""
    body = plate(tmp_path, FoamSpec(curve=NARROW, damping_pa_s_per_m=0.0), mass_kg=2.0, gravity=0.0)
    peak_n, n, work_j, before_m = 100.0, 4000, 0.0, body.data.qpos[2]
    deepest_m = 0.0
    for step in range(n + 500):
        load_n = peak_n * max(0.0, 1.0 - abs(2.0 * step / n - 1.0))
        body.data.qfrc_applied[2] = -load_n
        body.advance(body.t_ns + MS)
        work_j += load_n * (before_m - body.data.qpos[2])
        before_m = body.data.qpos[2]
        deepest_m = max(deepest_m, FACE_M - before_m)
        if step == n // 2:
            area_m2 = pressed_m2(body)
    grid = np.linspace(0.0, deepest_m / THICK_M, 5001)
    between_pa = table_pa(grid, LOADING_KPA) - table_pa(grid, UNLOADING_KPA)
    # on the way back from the deepest point λ falls from 1 to 0 within the reversal
    between_pa *= np.minimum(1.0, (grid[-1] - grid) / 0.005)
    expected_j = area_m2 * THICK_M * np.trapezoid(between_pa, grid)
    kept_j = 0.5 * 2.0 * body.data.qvel[2] ** 2
    assert work_j - kept_j == pytest.approx(expected_j, rel=0.01)


def law(curve: FoamCurveSpec, softness: float = 0.0) -> tuple[Foam, float]:
    """Foam without damping, and its fraction beside a solid of `softness` [m/Pa]."""
    foam = Foam.of(FoamSpec(curve=curve, damping_pa_s_per_m=0.0))
    return foam, 1.0 / (1.0 + foam.stiffness_pa_per_m * softness)


@settings(max_examples=60, deadline=None)
@given(CURVES, st.sampled_from([0.0, 2.5e-7, 2e-6]), st.lists(st.floats(0.0, 1.0), min_size=2, max_size=12))
def test_no_path_makes_energy(curve: FoamCurveSpec, softness: float, turns: list[float]) -> None:
    """Pressure stays between the columns and rises with strain; what is lost on any piece is not negative."""
    foam, fraction = law(curve, softness)
    play_m = np.full((1, 1), -foam.reversal_m)
    steps = [np.linspace(a, b, 41)[1:] for a, b in zip([0.0, *turns], [*turns, 0.0], strict=True)]
    overlap_m = THICK_M * np.concatenate(steps)
    before_pa = before_m = before_j = lost_j = 0.0
    for overlap in overlap_m:
        if overlap <= 0.0:
            indented_m, pressure_pa, stored_j = 0.0, 0.0, 0.0
        else:
            indented_m, scaled_pa, _ = compressed_state(foam, overlap, fraction, play_m, 0, 0)
            pressure_pa = fraction * scaled_pa
            stored_j = fraction * stored_energy_j_per_m2(foam, overlap, fraction, play_m, 0, 0)
        strain = (overlap - indented_m) / THICK_M
        upper_pa = curve.loading_pa(strain)
        lower_pa = FoamCurveSpec(
            strain=curve.strain, loading_kpa=curve.unloading_kpa or curve.loading_kpa
        ).loading_pa(min(strain, curve.strain[-1]))
        assert min(lower_pa, upper_pa) - 1e-6 <= pressure_pa <= upper_pa + 1e-6
        assert indented_m == pytest.approx(softness * pressure_pa, rel=1e-9, abs=1e-15)
        assert (pressure_pa - before_pa) * (overlap - before_m) >= -1e-12
        # the implicit step's work, with the pressure at the end of the piece
        assert pressure_pa * (overlap - before_m) >= stored_j - before_j - 1e-9
        lost_j += 0.5 * (pressure_pa + before_pa) * (overlap - before_m)
        before_pa, before_m, before_j = pressure_pa, overlap, stored_j
    assert before_j == 0.0
    assert lost_j >= -2e-3 * np.abs(overlap_m).max() * curve.loading_pa(1.0)


@settings(max_examples=100, deadline=None)
@given(
    CURVES,
    st.sampled_from([0.0, 2.5e-7, 2e-6]),
    st.sampled_from([0.0, 1e4, 4e5]),
    st.floats(-0.001, 0.011),
    st.floats(-2.0, 2.0),
    st.floats(0.0, 1.0),
)
def test_the_slope_is_the_derivative(
    curve: FoamCurveSpec, softness: float, damping: float, overlap_m: float, closing: float, memory: float
) -> None:
    """Central differences; across a kink the slope is one of both sides."""
    foam, fraction = law(curve, softness)
    foam = foam._replace(damping_pa_s_per_m=damping)
    start_m = max(overlap_m, 0.0)
    play_m = np.full((1, 1), start_m - foam.reversal_m * memory if overlap_m > 0.0 else -foam.reversal_m)
    if overlap_m > 0.0 and softness:
        compressed_state(foam, overlap_m, fraction, play_m, 0, 0)

    def at(velocity: float) -> tuple[float, float]:
        return closing_response(foam, overlap_m, velocity, 1e-3, fraction, play_m, 0, 0)

    reach = 1e-6
    (low_pa, below), (_, slope), (high_pa, above) = at(closing - reach), at(closing), at(closing + reach)
    measured = (high_pa - low_pa) / (2.0 * reach)
    smallest, largest = min(below, slope, above), max(below, slope, above)
    slack = 1e-4 * largest + 1e-2
    assert smallest - slack <= measured <= largest + slack


def test_a_straight_table_is_the_linear_law(tmp_path: Path) -> None:
    """Force at any depth within rounding; fall, bounce and rest of a plate within the tolerance of a step."""
    runs, at_rest_n, depths_m = [], [], THICK_M * np.linspace(0.01, 1.0, 50)
    for foam in (FoamSpec(), FoamSpec(curve=STRAIGHT)):
        body = plate(tmp_path, foam, mass_kg=0.8)
        body.data.qpos[2] += 0.002
        found = []
        for _ in range(300):
            body.advance(body.t_ns + MS)
            found.append([body.data.qpos[2], body.stimulus()[:, :3].sum(), body.dynamics.elastic_energy_j])
        runs.append(np.array(found))
        body.data.qvel[:] = 0.0
        at_rest_n.append(forces_n(body, depths_m))
    assert at_rest_n[1] == pytest.approx(at_rest_n[0], rel=1e-9)
    assert runs[0][:, 1].max() > 5.0
    for linear, table in zip(runs[0].T, runs[1].T, strict=True):
        assert table == pytest.approx(linear, rel=1e-6, abs=1e-6 * np.abs(linear).max())


@pytest.mark.parametrize("stiffness", [0.5e6, 4e6, 1e12])
def test_a_straight_table_in_series_is_the_linear_law(stiffness: float) -> None:
    """Against an elastic solid, with damping, at any depth and speed."""
    linear, table = FoamSpec(), FoamSpec(curve=STRAIGHT)
    assert compliant_layer(stiffness, table) == pytest.approx(compliant_layer(stiffness, linear), rel=1e-12)
    foam, fraction = Foam.of(table), compliant_layer(stiffness, table).foam_fraction
    play_m = np.zeros((0, 0))
    for depth_m in (0.001, 0.006, 0.013):
        indented_m, elastic_pa, damping = compressed_state(foam, depth_m, fraction, play_m, 0, 0)
        assert indented_m == pytest.approx((1.0 - fraction) * depth_m, rel=1e-9)
        assert elastic_pa == pytest.approx(1.5e6 * depth_m, rel=1e-9)
        assert damping == pytest.approx(1e4, rel=1e-9)
        energy = stored_energy_j_per_m2(foam, depth_m, fraction, play_m, 0, 0)
        assert energy == pytest.approx(0.5 * 1.5e6 * depth_m**2, rel=1e-9)
        for closing in (-0.05, 0.3):
            found = closing_response(foam, depth_m, closing, 1e-3, fraction, play_m, 0, 0)
            assert found == pytest.approx((1.5e6 * depth_m + 1e4 * closing, 1e4), rel=1e-9)
    entering = closing_response(foam, -0.001, 2.0, 1e-3, fraction, play_m, 0, 0)
    assert entering == pytest.approx((1e4 / 1e-3 * 0.001, 1e4), rel=1e-9)


def test_a_solid_gives_way_until_the_foam_is_flat() -> None:
    layer = compliant_layer(2.0e6, FoamSpec(curve=SOFT))
    flat_pa = 15e3 + (1.0 - 0.75) / 0.05 * 5e3  # the last slope, to full compression
    assert layer.max_indentation_m == pytest.approx(flat_pa / 2.0e6, rel=1e-9)
    assert FoamSpec(curve=SOFT).secant_stiffness_pa_per_m == pytest.approx(3.2e3 / (0.4 * THICK_M))


def test_beyond_its_rows_the_curve_goes_on(tmp_path: Path) -> None:
    """The last slope of loading for both branches: no unloading above loading."""
    body = plate(tmp_path, FoamSpec(curve=SOFT), gravity=0.0)
    (at_85_n, at_95_n, back_n) = forces_n(body, THICK_M * np.array([0.85, 0.95, 0.85]))
    area_m2 = pressed_m2(body)
    assert at_85_n == pytest.approx(area_m2 * 25e3, rel=1e-9)
    assert at_95_n == pytest.approx(area_m2 * 35e3, rel=1e-9)
    assert back_n == pytest.approx(at_85_n, rel=1e-9), "the columns meet in the last row"


def test_what_cells_do_not_read_passes_the_shell(tmp_path: Path) -> None:
    """60 kg press the foam flat: cells and rigid shell carry the weight."""
    body = plate(tmp_path, FoamSpec(curve=SOFT, damping_pa_s_per_m=1e5), mass_kg=60.0)
    body.advance(2000 * MS)
    read_n = body.stimulus()[:, :3].sum()
    body.ground_truth()
    assert read_n == pytest.approx(pressed_m2(body) * 40e3, rel=0.01), "the last slope to full compression"
    assert read_n + body.unsensed_force.now_n == pytest.approx(60.0 * 9.81, rel=0.01)
