import math
import tracemalloc

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from cells.sensing.transducers import STANDARD_GRAVITY_M_S2, Transducers, noise_keys, phases_ns
from skinnet.deployment.skin.cells import (
    AccelerometerSpec,
    CellSpec,
    ForceSpec,
    ProximitySpec,
    TemperatureSpec,
)
from skinnet.errors import DeploymentError

PERIOD_NS = 4_000_000
SILENT = CellSpec(
    force=ForceSpec(noise=0.0),
    proximity=ProximitySpec(noise=0.0),
    accelerometer=AccelerometerSpec(noise_g=0.0),
    temperature=TemperatureSpec(noise_c=0.0),
)
LSB = SILENT.force.lsb


COLUMNS = {"force": [0, 1, 2], "distance": [3], "acceleration": [4, 5, 6], "temperature": [7]}


def stimulus(n: int, **columns: ArrayLike) -> NDArray[np.float64]:
    """Nothing near, at rest with z upwards, 23 °C; but for the columns given, as a number or one a cell."""
    rows = np.tile([0.0, 0.0, 0.0, math.inf, 0.0, 0.0, STANDARD_GRAVITY_M_S2, 23.0], (n, 1))
    for name, values in columns.items():
        rows[:, COLUMNS[name]] = np.reshape(values, (-1, 1))
    return rows


def cells(n: int, spec: CellSpec | None = None, phase: float | None = None) -> Transducers:
    phases = phases_ns(1, "arm", n, PERIOD_NS)
    if phase is not None:
        phases = np.full(n, round(phase * PERIOD_NS))
    return Transducers(spec or CellSpec(), noise_keys(1, "arm", n), phases)


def read(
    transducers: Transducers,
    before: NDArray[np.floating],
    after: NDArray[np.floating] | None = None,
    frame: int = 0,
) -> NDArray[np.float32]:
    out = np.full(before.shape, np.nan, dtype=np.float32)
    transducers.sample(frame, before, before if after is None else after, out)
    return out


def test_force_readings_lie_on_the_published_points_and_the_line_between_them() -> None:
    force_n = np.linspace(-0.5, 7.0, 1501)
    spec = SILENT.force
    readings = read(cells(1501, SILENT), stimulus(1501, force=force_n))[:, :3]
    expected = np.interp(force_n, spec.calibration_n, spec.calibration_reading)
    assert np.abs(readings - expected[:, None]).max() <= 0.5 * LSB + 1e-7
    assert np.all(np.diff(readings, axis=0) >= 0.0)
    published = read(cells(2, SILENT), stimulus(2, force=[0.6, 1.0]))[:, 0]
    assert published == pytest.approx([0.05, 0.14], abs=0.5 * LSB)


def test_the_last_segment_goes_on_until_the_reading_is_full() -> None:
    spec = replace(
        SILENT, force=ForceSpec(calibration_n=(0.0, 1.0), calibration_reading=(0.0, 0.14), noise=0.0)
    )
    readings = read(cells(3, spec), stimulus(3, force=[3.0, 1 / 0.14, 20.0]))[:, 0]
    assert readings == pytest.approx([0.42, 1.0, 1.0], abs=0.5 * LSB)


def test_proximity_follows_its_law() -> None:
    spec = SILENT.proximity
    distance_m = np.append(np.linspace(-0.005, 0.06, 400), math.inf)
    readings = read(cells(401, SILENT), stimulus(401, distance=distance_m))[:, 3]
    # the law in another form: 1/√reading grows linearly, from 1 at contact to its value at reach
    root = 1.0 + np.maximum(distance_m, 0.0) / spec.range_m * (1.0 / math.sqrt(spec.reading_at_range) - 1.0)
    assert np.abs(readings - root**-2.0).max() <= 0.5 * spec.lsb + 1e-7
    assert np.all(np.diff(readings) <= 0.0)
    assert readings[0] == 1.0
    assert readings[-1] == 0.0


def test_acceleration_in_g_clips_at_its_range_in_whole_steps() -> None:
    given_g = np.linspace(-9.0, 9.0, 999)
    rows = stimulus(999, acceleration=given_g * STANDARD_GRAVITY_M_S2)
    readings = read(cells(999, SILENT), rows)[:, 4:7].astype(np.float64)
    assert np.abs(readings - np.clip(given_g, -8.0, 8.0)[:, None]).max() <= 0.002 + 1e-6
    assert np.abs(readings / 0.004 - np.rint(readings / 0.004)).max() < 1e-3
    assert (readings.min(), readings.max()) == (-8.0, 8.0)


def test_a_cell_samples_between_two_frames_at_its_own_phase() -> None:
    before = stimulus(3, force=1.0, distance=math.inf, acceleration=0.0, temperature=20.0)
    after = stimulus(3, force=2.0, distance=0.01, acceleration=2 * STANDARD_GRAVITY_M_S2, temperature=24.0)
    transducers = Transducers(SILENT, noise_keys(1, "arm", 3), np.array([0, PERIOD_NS // 4, PERIOD_NS - 1]))
    assert transducers.sample_times_ns(7).tolist() == [28_000_000, 29_000_000, 31_999_999]
    readings = read(transducers, before, after)
    ends = read(cells(2, SILENT), np.vstack([before[:1], after[:1]]))
    share = np.array([0.0, 0.25, 1.0])
    spec = SILENT.force
    force = np.interp(1.0 + share, spec.calibration_n, spec.calibration_reading)
    assert readings[:, 0] == pytest.approx(force, abs=0.5 * LSB + 1e-6)
    # proximity: the reading is linear in time, for a distance may come from infinity
    assert ends[0, 3] == 0.0
    assert readings[:, 3] == pytest.approx(share * ends[1, 3], abs=LSB)
    assert readings[:, 4] == pytest.approx(2.0 * share, abs=0.002 + 1e-6)
    assert readings[:, 7] == pytest.approx(20.0 + 4.0 * share, abs=0.03 + 1e-5)


def test_temperature_lags_as_a_first_order_system_also_when_frames_are_missed() -> None:
    spec = replace(SILENT, temperature=TemperatureSpec(noise_c=0.0, lsb_c=1e-4))
    cold, warm = stimulus(1, temperature=20.0), stimulus(1, temperature=30.0)
    every, some = cells(1, spec, phase=0.5), cells(1, spec, phase=0.5)
    assert read(every, cold)[0, 7] == pytest.approx(20.0, abs=1e-4)
    read(some, cold)
    for frame in range(1, 1951):
        reading = read(every, warm, frame=frame)[0, 7]
        assert reading == pytest.approx(30.0 - 10.0 * math.exp(-frame * 0.004 / 2.6), abs=2e-4)
        if frame % 650 == 0:  # 650 frames are one time constant
            assert read(some, warm, frame=frame)[0, 7] == pytest.approx(reading, abs=2e-4)


def test_a_range_ends_at_whole_steps_inside_of_it() -> None:
    rows = np.vstack([stimulus(1, temperature=-50.0), stimulus(1, temperature=90.0)])
    readings = read(cells(2, SILENT), rows)[:, 7]
    assert readings == pytest.approx([-83 * 0.06, 916 * 0.06], abs=1e-5)


def test_noise_is_normal_and_has_no_memory() -> None:
    n, frames = 400, 100
    fine = CellSpec(
        force=ForceSpec(lsb=1e-6),
        proximity=ProximitySpec(lsb=1e-7),
        accelerometer=AccelerometerSpec(lsb_g=1e-6),
        temperature=TemperatureSpec(lsb_c=1e-5),
    )
    rows = stimulus(n, force=1.0, distance=0.02, acceleration=0.0)
    transducers = cells(n, fine)
    series = np.array([read(transducers, rows, frame=k) for k in range(frames)], dtype=np.float64)
    root = 1.0 + 0.4 * (1.0 / math.sqrt(fine.proximity.reading_at_range) - 1.0)
    centre = np.array([0.14] * 3 + [root**-2.0] + [0.0] * 3 + [23.0])
    sigma = np.array([0.004] * 3 + [0.0008] + [0.004] * 3 + [0.03])
    unit = (series - centre) / sigma
    for channel in range(8):
        assert stats.kstest(unit[:, :, channel].ravel(), "norm").pvalue > 1e-3
    bound = 5.0 / math.sqrt(n * frames)
    for later in (unit, unit[1:], unit[:, 1:]):  # from channel to channel, frame to frame, cell to cell
        earlier = unit[: len(later), : later.shape[1]]
        correlation = np.einsum("fnc,fnd->cd", earlier, later) / (n * frames)
        assert np.abs(correlation - (np.eye(8) if later is unit else 0.0)).max() < 1.5 * bound


def test_rounding_adds_its_own_noise_and_no_bias() -> None:
    rows = stimulus(400, force=1.0)
    transducers, spec = cells(400), CellSpec().force
    series = np.array([read(transducers, rows, frame=k)[:, :3] for k in range(100)], dtype=np.float64)
    expected = math.hypot(spec.noise, spec.lsb / math.sqrt(12.0))
    assert series.std() == pytest.approx(expected, rel=0.02)
    assert series.mean() == pytest.approx(0.14, abs=5 * expected / math.sqrt(series.size))


def test_readings_do_not_depend_on_how_cells_are_grouped_or_frames_begun() -> None:
    n = 37
    rows = stimulus(n, force=np.linspace(0, 4, n), distance=np.linspace(0, 0.05, n))
    after = rows.astype(np.float32) * 1.01
    keys, phases = noise_keys(5, "arm", n), phases_ns(5, "arm", n, PERIOD_NS)
    whole = Transducers(CellSpec(), keys, phases)
    groups = [np.arange(0, n, 3), np.arange(1, n, 3)[::-1], np.arange(2, n, 3)]
    parts = [Transducers(CellSpec(), keys[group], phases[group]) for group in groups]
    for frame in (3, 4, 9):
        expected = read(whole, rows, after, frame)
        for group, part in zip(groups, parts, strict=True):
            assert np.array_equal(read(part, rows[group], after[group], frame), expected[group])
    late = read(Transducers(CellSpec(), keys, phases), rows, after, 9)
    assert np.array_equal(late[:, :7], expected[:, :7])


def test_keys_and_phases_belong_to_the_name_of_a_cell() -> None:
    assert np.array_equal(noise_keys(1, "arm", 50)[:20], noise_keys(1, "arm", 20))
    assert np.array_equal(phases_ns(1, "arm", 50, PERIOD_NS)[:20], phases_ns(1, "arm", 20, PERIOD_NS))
    keys = np.concatenate([noise_keys(seed, patch, 50) for seed in (1, 2) for patch in ("arm", "hand")])
    assert np.unique(keys).size == 200
    phases = phases_ns(1, "arm", 3000, PERIOD_NS)
    assert phases.dtype == np.int64
    assert phases.min() >= 0
    assert phases.max() < PERIOD_NS
    assert stats.kstest(phases / PERIOD_NS, "uniform").pvalue > 1e-3


def test_a_stimulus_that_is_no_number_reads_as_nothing_and_is_soon_forgotten() -> None:
    transducers = cells(2, SILENT, phase=0.0)
    broken = stimulus(2)
    broken[0] = math.nan
    assert read(transducers, broken)[0].tolist() == pytest.approx([0, 0, 0, 0, -8, -8, -8, -4.98])
    assert np.array_equal(
        read(transducers, stimulus(2), frame=1), read(cells(2, SILENT, phase=0.0), stimulus(2))
    )


def test_a_frame_is_sampled_without_new_arrays() -> None:
    transducers, rows = cells(2000), stimulus(2000)
    out = np.empty((2000, 8), dtype=np.float32)
    transducers.sample(0, rows, rows, out)
    tracemalloc.start()
    try:
        for frame in range(1, 6):
            transducers.sample(frame, rows, rows, out)
        assert tracemalloc.get_traced_memory()[1] < 2000 * 8
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "spec",
    [
        replace(SILENT, force=ForceSpec(calibration_n=(0.0,), calibration_reading=(0.0,))),
        replace(SILENT, force=ForceSpec(calibration_n=(0.0, 1.0), calibration_reading=(0.0, 0.5, 1.0))),
        replace(SILENT, force=ForceSpec(calibration_n=(0.0, 0.0), calibration_reading=(0.0, 1.0))),
        replace(SILENT, force=ForceSpec(calibration_n=(0.0, 1.0), calibration_reading=(0.2, 0.1))),
        replace(SILENT, force=ForceSpec(calibration_n=(0.0, math.inf), calibration_reading=(0.0, 1.0))),
        replace(SILENT, proximity=ProximitySpec(reading_at_range=1.0)),
        replace(SILENT, temperature=TemperatureSpec(min_c=60.0)),
    ],
)
def test_what_no_sensor_can_be_is_refused(spec: CellSpec) -> None:
    with pytest.raises(DeploymentError, match="cells"):
        cells(1, spec)


def test_a_cell_that_is_switched_on_again_begins_at_the_temperature_around_it() -> None:
    cold, warm = stimulus(3, temperature=20.0), stimulus(3, temperature=30.0)
    transducers = cells(3, SILENT)
    read(transducers, cold)
    transducers.reset(np.array([1]))
    readings = read(transducers, warm, frame=1)[:, 7]
    assert readings == pytest.approx([20.04, 30.0, 20.04], abs=0.031)  # one frame of 2.6 s, in steps of 0.06
    other = read(cells(1, SILENT), warm[:1], frame=1)[0, 7]
    assert readings[1] == other
