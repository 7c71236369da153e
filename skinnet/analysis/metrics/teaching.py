"""Teaching metrics: pose errors of lessons, and cells touched by strokes."""

from typing import Any

from skinnet.runtime.process_result import ProcessResult

__all__ = ["teaching_metrics"]


def teaching_metrics(body: ProcessResult) -> dict[str, Any]:
    """Metrics of lessons and strokes, if any; lists have an entry for each, in order."""
    return _lesson_metrics(body.facts["lessons"]) | _stroke_metrics(body.facts["strokes"])


def _lesson_metrics(lessons: list[dict[str, Any]]) -> dict[str, Any]:
    if not lessons:
        return {}
    nearest_m = [lesson["min_height_m"] for lesson in lessons if lesson["min_height_m"] is not None]
    return {
        "lessons.outcomes": [lesson["outcome"] or "not over" for lesson in lessons],
        "lessons.error_mm": [round(1e3 * max(lesson["error_m"]), 1) for lesson in lessons],
        "lessons.touches": [len(lesson["touches"]) for lesson in lessons],
        "lessons.duration_s": [_duration_s(lesson) for lesson in lessons],
        "lessons.contacts": sum(lesson["contact_ns"] is not None for lesson in lessons),
        "lessons.min_distance_mm": round(1e3 * min(nearest_m), 2) if nearest_m else None,
        "lessons.peak_force_n": max(lesson["peak_force_n"] for lesson in lessons),
    }


def _duration_s(lesson: dict[str, Any]) -> float | None:
    """Duration of a lesson [s]; None if it did not end."""
    return None if lesson["end_ns"] is None else round(1e-9 * (lesson["end_ns"] - lesson["begin_ns"]), 2)


def _stroke_metrics(strokes: list[dict[str, Any]]) -> dict[str, Any]:
    if not strokes:
        return {}
    return {
        "strokes.count": len(strokes),
        "strokes.touched_cells": [len(stroke["touched_cells"]) for stroke in strokes],
        "strokes.missed_cells": sum(
            len(set(stroke["requested_cells"]) - set(stroke["touched_cells"])) for stroke in strokes
        ),
        "strokes.unintended_cells": sum(
            len(set(stroke["touched_cells"]) - set(stroke["requested_cells"])) for stroke in strokes
        ),
        "strokes.peak_force_n": max(stroke["peak_force_n"] for stroke in strokes),
    }
