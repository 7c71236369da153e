"""Ground truth of the teacher's lessons and strokes."""

from dataclasses import dataclass, field

__all__ = ["LessonGroundTruth", "LessonTouch", "StrokeGroundTruth"]


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
        outcome: "reached", "nothing helps", "out of patience" or "stage over"; empty while in progress.
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
    outcome: str = ""
    begin_error_m: list[float] = field(default_factory=list)
    error_m: list[float] = field(default_factory=list)
    touches: list[LessonTouch] = field(default_factory=list)
    min_height_m: float | None = None
    contact_ns: int | None = None
    peak_force_n: float = 0.0

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
