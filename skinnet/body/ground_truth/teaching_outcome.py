"""Ground truth of the teacher's touches, lessons and strokes."""

import math
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

__all__ = [
    "LessonGroundTruth",
    "LessonOutcome",
    "LessonTouch",
    "StrokeGroundTruth",
    "TeachingOutcome",
    "TouchGroundTruth",
]


class LessonOutcome(StrEnum):
    """Outcome of a lesson."""

    IN_PROGRESS = ""
    REACHED = "reached"
    """All goals are reached."""
    NOTHING_HELPS = "nothing helps"
    """No cell would bring the robot nearer to the goals."""
    TIMEOUT = "out of patience"
    """The timeout of the lesson passed."""
    STAGE_OVER = "stage over"
    """The program went on to another stage."""


@dataclass
class TouchGroundTruth:
    """Ground truth of a touch of the teacher.

    Attributes:
        touch: Index in the deployment's list of touches.
        cell: Name of the target cell, as in the deployment.
        stage: Stage of the program in which it took place.
        begin_ns: Time at which the finger appeared [ns].
        contact_ns: Time of the first force on the finger [ns]; None without contact.
        hold_ns: Begin of the hold phase [ns]; None if not reached.
        end_ns: End, with the finger parked [ns]; None before.
        peak_force_n: Largest normal force on the finger [N].
        target_peak_force_n: Largest normal force on the target: a force cell, or the finger [N].
        mean_hold_force_n: Mean force on the target in the hold phase [N]; NaN without one.
        mean_felt_force_n: Mean force on all cells along the line of approach in the hold phase,
            beyond that when the finger appeared [N]; NaN without one.
        mean_gauge_force_n: Mean force of the finger along its line of approach, as a force gauge in it would
            measure, in the hold phase [N]; NaN without one.
        evaded_m: Way of the cell along its inward normal at the contact, from the contact to the end of the
            hold phase [m]; None without contact.
        impulse_n_s: Impulse: time integral of the normal force on the finger [N s].
        depth_controlled: True for depth control, False for force control.
        onset_gap_m: Gap between finger and face of the target when a command first set the robot in motion
            [m], negative within the foam; None if it did not move.
    """

    touch: int
    cell: str
    stage: str
    begin_ns: int
    contact_ns: int | None = None
    hold_ns: int | None = None
    end_ns: int | None = None
    peak_force_n: float = 0.0
    target_peak_force_n: float = 0.0
    mean_hold_force_n: float = math.nan
    mean_felt_force_n: float = math.nan
    mean_gauge_force_n: float = math.nan
    evaded_m: float | None = None
    impulse_n_s: float = 0.0
    depth_controlled: bool = False
    onset_gap_m: float | None = None
    _held_steps: int = 0

    def facts(self) -> dict[str, Any]:
        """Public fields as facts."""
        return {key: value for key, value in vars(self).items() if not key.startswith("_")}

    def record(self, t_ns: int, step_s: float, finger_n: float, target_force_n: float) -> None:
        """Record one physics step at `t_ns` [ns]: forces on the finger and on the target [N]."""
        if finger_n > 0.0 and self.contact_ns is None:
            self.contact_ns = t_ns
        self.peak_force_n = max(self.peak_force_n, finger_n)
        self.target_peak_force_n = max(self.target_peak_force_n, target_force_n)
        self.impulse_n_s += finger_n * step_s

    def record_hold(self, target_force_n: float, felt_force_n: float, gauge_force_n: float) -> None:
        """Record a physics step of the hold phase: forces on the target, on all cells, of the finger [N]."""
        if self._held_steps == 0:
            self.mean_hold_force_n = self.mean_felt_force_n = self.mean_gauge_force_n = 0.0
        self._held_steps += 1
        self.mean_hold_force_n += (target_force_n - self.mean_hold_force_n) / self._held_steps
        self.mean_felt_force_n += (felt_force_n - self.mean_felt_force_n) / self._held_steps
        self.mean_gauge_force_n += (gauge_force_n - self.mean_gauge_force_n) / self._held_steps


@dataclass
class LessonTouch:
    """Touch of one cell in a lesson, by approach or contact.

    Attributes:
        cell: Row of the cell.
        begin_ns: Time at which the finger appeared above the cell [ns].
        end_ns: Time at which it began to withdraw [ns]; None before.
        joint_motion_rad: Joint motion meanwhile, Euclidean norm [rad].
    """

    cell: int
    begin_ns: int
    end_ns: int | None = None
    joint_motion_rad: float = 0.0


@dataclass
class LessonGroundTruth:
    """Ground truth of a lesson.

    Attributes:
        lesson: Index in the deployment's list of lessons.
        stage: Stage of the program in which it took place.
        begin_ns: Begin [ns].
        end_ns: End, with the finger parked [ns]; None before.
        outcome: Outcome.
        begin_error_m: Initial distance of each goal's point from its target [m].
        error_m: Final, or last observed, distance of each point from its target [m].
        touches: Touched cells, in order.
        min_height_m: Smallest height of the finger above the face of a touched cell [m], negative within the
            foam; None if there was no touch.
        contact_ns: Time of the first force on the finger [ns]; None without contact.
        peak_force_n: Largest normal force on the finger [N].
    """

    lesson: int
    stage: str
    begin_ns: int
    end_ns: int | None = None
    outcome: LessonOutcome = LessonOutcome.IN_PROGRESS
    begin_error_m: list[float] = field(default_factory=list)
    error_m: list[float] = field(default_factory=list)
    touches: list[LessonTouch] = field(default_factory=list)
    min_height_m: float | None = None
    contact_ns: int | None = None
    peak_force_n: float = 0.0

    def facts(self) -> dict[str, Any]:
        """Fields as facts."""
        return asdict(self) | {"outcome": self.outcome.value}

    def record(self, t_ns: int, height_m: float, finger_n: float) -> None:
        """Record one physics step at `t_ns` [ns]: height above the cell [m], force on the finger [N]."""
        self.min_height_m = height_m if self.min_height_m is None else min(self.min_height_m, height_m)
        if finger_n > 0.0 and self.contact_ns is None:
            self.contact_ns = t_ns
        self.peak_force_n = max(self.peak_force_n, finger_n)


@dataclass
class StrokeGroundTruth:
    """Ground truth of a stroke.

    Attributes:
        stroke: Index in the deployment's list of strokes.
        stage: Stage of the program in which it took place.
        begin_ns: Time at which the finger appeared [ns].
        end_ns: End, with the finger parked [ns]; None before.
        requested_cells: Rows of the cells of the script, in stroke order.
        touched_cells: Rows of the cells with a normal force above the threshold, ascending.
        peak_force_n: Largest normal force on the finger [N].
    """

    stroke: int
    stage: str
    begin_ns: int
    end_ns: int | None = None
    requested_cells: list[int] = field(default_factory=list)
    touched_cells: list[int] = field(default_factory=list)
    peak_force_n: float = 0.0

    def facts(self) -> dict[str, Any]:
        """Fields as facts."""
        return asdict(self)


@dataclass
class TeachingOutcome:
    """Ground truth of all tasks of the teacher, in the order in which they began.

    Attributes:
        touches: Touches; the last one may be in progress, as the last lesson and stroke.
        lessons: Lessons.
        strokes: Strokes.
    """

    touches: list[TouchGroundTruth] = field(default_factory=list)
    lessons: list[LessonGroundTruth] = field(default_factory=list)
    strokes: list[StrokeGroundTruth] = field(default_factory=list)

    def facts(self) -> dict[str, Any]:
        """Facts of all tasks."""
        return {
            "touches": [touch.facts() for touch in self.touches],
            "lessons": [lesson.facts() for lesson in self.lessons],
            "strokes": [stroke.facts() for stroke in self.strokes],
        }
