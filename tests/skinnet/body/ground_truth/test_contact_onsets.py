"""Threshold crossings to the nanosecond, thresholds as inverse sensor laws, and the trace of peak forces."""

import numpy as np
import pytest

from skinnet.body.ground_truth.contact_onsets import (
    CrossingDetector,
    PeakForceTrace,
    distance_thresholds_m,
    force_thresholds_n,
)
from skinnet.deployment.skin.cells import CellSpec
from skinnet.protocol.messages import STIMULUS_NAMES, Modality

MS = 1_000_000
DISTANCE = STIMULUS_NAMES.index("distance_m")


def detector() -> CrossingDetector:
    readings = {Modality.FORCE: (0.05, 0.14), Modality.PROXIMITY: (0.1, 0.3)}
    return CrossingDetector(np.array([0.6, 1.0]), np.array([0.04, 0.02]), readings)


def forces(value_n: float, cell: int = 1, channel: int = 2) -> np.ndarray:
    force_n = np.zeros((3, 3))
    force_n[cell, channel] = value_n
    return force_n


def test_a_rise_of_force_is_timed_between_two_steps() -> None:
    found = detector()
    found.observe_forces(10 * MS, MS, forces(0.4), True)
    found.observe_forces(11 * MS, MS, forces(0.8), True)
    found.observe_forces(12 * MS, MS, forces(0.7), True)  # falls: nothing
    found.observe_forces(13 * MS, MS, forces(1.1), True)
    assert [c[:5] for c in found.crossings] == [
        (10_500_000, 1, Modality.FORCE, 2, 1),
        (12_750_000, 1, Modality.FORCE, 2, 2),
    ]
    assert found.facts() == [(10_500_000, 1, 2, 0.05), (12_750_000, 1, 2, 0.14)]


def test_a_contact_that_ends_and_begins_again_crosses_again() -> None:
    found = detector()
    for t_ms, force_n, touching in ((1, 0.8, True), (2, 0.0, False), (3, 0.0, False), (4, 1.2, True)):
        found.observe_forces(t_ms * MS, MS, forces(force_n), touching)
    assert [c.t_ns for c in found.crossings] == [750_000, 3_500_000, 3_833_333]


def test_a_level_is_crossed_when_it_is_reached() -> None:
    found = detector()
    found.observe_forces(MS, MS, forces(0.6), True)
    found.observe_forces(2 * MS, MS, forces(0.7), True)
    assert [c.t_ns for c in found.crossings] == [MS], "reached, and then no longer crossed"


def stimulus(distance_m: float) -> np.ndarray:
    rows = np.zeros((2, len(STIMULUS_NAMES)))
    rows[:, DISTANCE] = np.inf
    rows[1, DISTANCE] = distance_m
    return rows


def test_an_approach_crosses_distances_between_samples_of_the_stimulus() -> None:
    found = detector()
    for t_ms, distance_m in ((0, 0.05), (4, 0.03), (8, 0.035), (12, 0.01)):
        found.observe_stimulus(t_ms * MS, stimulus(distance_m))
    assert [c[:5] for c in found.crossings] == [
        (2 * MS, 1, Modality.PROXIMITY, 0, 1),
        (8 * MS + 2_400_000, 1, Modality.PROXIMITY, 0, 2),
    ]
    assert found.facts() == [(2 * MS, 1, 3, 0.1), (10_400_000, 1, 3, 0.3)]


def test_what_appears_in_range_crosses_at_its_sample() -> None:
    found = detector()
    for t_ms, distance_m in ((0, np.inf), (4, np.inf), (8, 0.03)):
        found.observe_stimulus(t_ms * MS, stimulus(distance_m))
    assert [c.t_ns for c in found.crossings] == [8 * MS]


def test_thresholds_invert_the_laws_of_the_sensors() -> None:
    cells = CellSpec()
    readings = (0.05, 0.1, 0.14)
    force_n = force_thresholds_n(cells.force, readings)
    back = np.interp(force_n, cells.force.calibration_n, cells.force.calibration_reading)
    assert back == pytest.approx(readings)
    assert force_n[[0, 2]] == pytest.approx([0.6, 1.0]), "0.05 is 0.6 N and 0.14 is 1.0 N [M14]"
    assert force_thresholds_n(cells.force) == pytest.approx(
        force_thresholds_n(cells.force, cells.force.levels)
    )
    near_m = distance_thresholds_m(cells.proximity, (cells.proximity.reading_at_range, 1.0))
    assert near_m == pytest.approx([cells.proximity.range_m, 0.0])
    root = cells.proximity.reading_at_range**0.5
    d0_m = cells.proximity.range_m * root / (1.0 - root)
    (middle_m,) = distance_thresholds_m(cells.proximity, (0.2,))
    assert (d0_m / (d0_m + middle_m)) ** 2 == pytest.approx(0.2)


def test_the_trace_holds_the_largest_force_of_each_period_and_stage() -> None:
    trace = PeakForceTrace(2 * MS)
    for t_ms, stage, peak_n in (
        (0, "", 0.0),
        (1, "one", 0.7),
        (2, "one", 0.4),
        (3, "one", 0.0),
        (4, "two", 0.2),
    ):
        if stage:
            trace.begin_stage(stage)
        trace.observe(t_ms * MS, peak_n)
    arrays = trace.arrays()
    assert arrays["peak_force_t_ns"].tolist() == [0, 2 * MS, 4 * MS]
    assert arrays["peak_force_n"] == pytest.approx([0.0, 0.7, 0.2])
    assert trace.by_stage_n == {"one": 0.7, "two": 0.2}
