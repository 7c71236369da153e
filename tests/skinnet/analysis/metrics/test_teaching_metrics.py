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


def test_missed_and_unintended_cells_are_counted_over_all_strokes() -> None:
    strokes = [
        {"requested_cells": [1, 2, 3], "touched_cells": [2, 3, 4], "peak_force_n": 0.4},
        {"requested_cells": [7, 8], "touched_cells": [], "peak_force_n": 0.0},
    ]
    metrics = teaching_metrics(ProcessResult("body", "body", {"lessons": [], "strokes": strokes}))
    assert metrics == {
        "strokes.count": 2,
        "strokes.touched_cells": [3, 0],
        "strokes.missed_cells": 3,
        "strokes.unintended_cells": 1,
        "strokes.peak_force_n": 0.4,
    }


def test_a_run_without_lessons_and_strokes_has_no_teaching_metrics() -> None:
    assert teaching_metrics(ProcessResult("body", "body", {"lessons": [], "strokes": []})) == {}
