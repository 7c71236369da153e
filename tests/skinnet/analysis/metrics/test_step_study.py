"""The study of metrics at two steps: what it tells, and a slice of it (docs/validation.md has all seeds)."""

import numpy as np
import pytest
import step_study


def runs(values: list[float], name: str = "B.slid_mm") -> list[dict[str, float]]:
    return [{name: value} for value in values]


def test_the_change_of_a_mean_is_a_fraction_of_it_with_students_interval() -> None:
    """Differences 1, 2, 3 of means of 100 and 102, and t(2; 0.975) = 4.303 times 1 / sqrt(3)."""
    (change,) = step_study.changes(runs([90.0, 100.0, 110.0]), runs([91.0, 102.0, 113.0]))
    assert (change.mean, change.allowed) == (100.0, 0.02)
    assert change.change == pytest.approx(2.0 / 102.0)
    assert change.margin == pytest.approx(4.3027 / np.sqrt(3.0) / 102.0, rel=1e-4)


def test_what_moves_too_far_is_told_from_chance() -> None:
    before = [100.0, 101.0, 99.0, 100.0]
    (moved,) = step_study.changes(runs(before), runs([value + 4.0 for value in before]))
    assert moved.is_beyond
    (by_chance,) = step_study.changes(runs(before), runs([120.0, 85.0, 114.0, 97.0]))
    assert by_chance.change == pytest.approx(4.0 / 104.0)
    assert not by_chance.is_beyond
    (peak,) = step_study.changes(
        runs(before, "force_n.peak"), runs([value + 4.0 for value in before], "force_n.peak")
    )
    assert not peak.is_beyond, "a peak may move by 5 %"


def test_what_was_zero_once_may_happen_by_chance() -> None:
    (change,) = step_study.changes(runs([0.0, 0.0, 0.0]), runs([0.0, 1.0, 0.0]))
    assert change.change == pytest.approx(1.0)
    assert not change.is_beyond


def test_metrics_that_a_run_lacks_are_left_out() -> None:
    assert step_study.changes([{"a": 1.0}, {"a": 1.0}], [{"a": 1.0}, {}]) == []


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("scene", step_study.SCENES)
def test_half_the_step_moves_no_metric_too_far(scene: str) -> None:
    found = [
        [step_study.metrics_of(scene, seed, step_ms) for seed in (1, 2, 3)] for step_ms in step_study.STEPS_MS
    ]
    beyond = [change for change in step_study.changes(*found) if change.is_beyond]
    assert not beyond
