"""Teaching metrics: the worst goal of a lesson counts."""

from skinnet.analysis.metrics.teaching import teaching_metrics
from skinnet.runtime.process_result import ProcessResult


def test_the_error_of_a_lesson_is_that_of_its_worst_goal() -> None:
    lesson = {
        "outcome": "reached",
        "error_m": [0.002, 0.009, 0.004],
        "touches": [1, 2],
        "begin_ns": 0,
        "end_ns": 3_000_000_000,
        "contact_ns": None,
        "min_height_m": 0.02,
        "peak_force_n": 0.5,
    }
    metrics = teaching_metrics(ProcessResult("body", "body", {"lessons": [lesson], "strokes": []}))
    assert metrics["lessons.error_mm"] == [9.0]
    assert metrics["lessons.touches"] == [2]
    assert metrics["lessons.duration_s"] == [3.0]
    assert metrics["lessons.min_distance_mm"] == 20.0
    assert metrics["lessons.peak_force_n"] == 0.5
