import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from cells.sheets.pressure_transducers import PressureTransducers
from skinnet.deployment.skin.sheets import BoardSpec, PressureSpec, SheetSpec, SurfaceSpec
from skinnet.errors import DeploymentError
from skinnet.skin.tactile_sheets import PlacedSheet, place_sheets

PERIOD_NS = 4_000_000


def sheets(*names: str, columns: int = 8) -> tuple[PlacedSheet, ...]:
    surfaces = [
        SurfaceSpec(name=n, body=n, origin_m=(0, 0, 0), normal=(0.0, 0.0, 1.0), up=(0.0, 1.0, 0.0))
        for n in names
    ]
    return place_sheets(surfaces, [SheetSpec(name=n, surface=n, columns=columns) for n in names])


def elements(*names: str, seed: int = 1, columns: int = 8, **settings: float) -> PressureTransducers:
    spec = BoardSpec(pressure=PressureSpec(**settings))  # type: ignore[arg-type]
    return PressureTransducers(sheets(*names, columns=columns), spec, seed)


def read(
    transducers: PressureTransducers, before: object, after: object = None, frame: int = 0
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    n = len(transducers.sample_offset_ns)
    out = np.full(n, np.nan)
    start = np.broadcast_to(np.asarray(before, dtype=np.float32), n)
    end = start if after is None else np.broadcast_to(np.asarray(after, dtype=np.float32), n)
    transducers.scan(frame, start, end, out)
    return out


@given(st.integers(0, 1000))
def test_a_board_reads_one_element_after_the_other_within_the_period(seed: int) -> None:
    boards = elements("a", "b", seed=seed)
    scan = boards.sample_offset_ns.reshape(2, 64)
    assert (np.diff(scan, axis=1) == 50_000).all()
    assert (scan[:, 0] >= 50_000).all()
    assert (scan[:, -1] <= PERIOD_NS).all()
    assert boards.scan_end_ns.tolist() == scan[:, -1].tolist()
    assert scan[0, 0] != scan[1, 0]  # clocks of their own


def test_each_element_reads_the_pressure_of_its_own_moment() -> None:
    boards = elements("a", "b", bits=24, noise_kpa=0.0)
    before, after = np.linspace(5.0, 40.0, 128), np.linspace(80.0, 3.0, 128)
    expected = before + (after - before) * boards.sample_offset_ns / PERIOD_NS
    assert read(boards, before, after) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("bits", [1, 5, 8, 12])
def test_readings_are_the_nearest_step_within_the_range(bits: int) -> None:
    boards = elements("a", bits=bits, noise_kpa=0.0)
    step = 90.0 / (2**bits - 1)
    pressures = np.linspace(-20.0, 130.0, 40 * 64).reshape(40, 64)
    readings = np.array([read(boards, p) for p in pressures])
    expected = np.clip(pressures.astype(np.float32), 0.0, 90.0)
    assert np.abs(readings - expected).max() <= 0.5 * step + 1e-6
    assert readings / step == pytest.approx(np.rint(readings / step), abs=1e-9)
    assert readings.min() == 0.0
    assert readings.max() == pytest.approx(90.0)


def test_what_is_no_number_reads_nothing() -> None:
    boards = elements("a")
    assert (read(boards, math.nan) == 0.0).all()


def test_noise_is_gaussian_and_new_in_each_frame() -> None:
    boards = elements("a", bits=24, noise_kpa=0.5)
    noise = np.array([read(boards, 30.0, frame=f) for f in range(100)]) - 30.0
    assert noise.std() == pytest.approx(0.5, rel=0.03)
    assert stats.kstest(noise.ravel() / 0.5, "norm").pvalue > 0.001
    assert abs(np.corrcoef(noise[:-1].ravel(), noise[1:].ravel())[0, 1]) < 0.05


def test_what_a_board_reads_does_not_depend_on_the_others() -> None:
    together, alone, turned = elements("a", "b"), elements("b"), elements("b", "a")
    pressures = np.linspace(0.0, 60.0, 64)
    both = np.concatenate([pressures, pressures])
    for frame in (0, 7):
        expected = read(alone, pressures, pressures[::-1], frame)
        assert (read(together, both, np.concatenate([both[63::-1]] * 2), frame)[64:] == expected).all()
        assert (read(turned, both, np.concatenate([both[63::-1]] * 2), frame)[:64] == expected).all()
    assert (together.sample_offset_ns[64:] == alone.sample_offset_ns).all()


def test_a_scan_fits_into_the_period() -> None:
    assert elements("a", element_read_us=62.5).scan_end_ns.tolist() == [PERIOD_NS]
    with pytest.raises(DeploymentError, match=r"sheets\.a: 64 elements of 63\.0 µs"):
        elements("a", element_read_us=63.0)
