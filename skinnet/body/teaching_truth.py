"""What lessons and strokes of the teacher really were."""

from dataclasses import dataclass, field

__all__ = ["LessonTouch", "LessonTruth", "StrokeTruth"]


@dataclass
class LessonTouch:
    """A cell that the finger came near to in a lesson.

    Attributes:
        cell: Row of the cell.
        begin_ns: The finger appeared above it.
        end_ns: It began to withdraw; None while it stays.
        moved_rad: How far the joints moved meanwhile, all together (norm) [rad].
    """

    cell: int
    begin_ns: int
    end_ns: int | None = None
    moved_rad: float = 0.0


@dataclass
class LessonTruth:
    """What a lesson really was.

    Attributes:
        lesson: Index in the deployment's list of lessons.
        stage: Stage of the program in which it was given.
        begin_ns: It began.
        end_ns: The finger was away for good; None while it lasts.
        outcome: "reached", "nothing helps", "out of patience" or "stage over"; empty while it lasts.
        begin_error_m: Distance of each goal's point from its place in the beginning [m].
        error_m: The same at the end, or as seen last [m].
        touches: Cells that the finger came near to, in this order.
        nearest_m: Least height of the finger above the face of such a cell [m], negative within the foam;
            None if it never came near.
        contact_ns: First force on the finger; None when it never touched anything.
        peak_n: Largest normal force on the finger [N].
    """

    lesson: int
    stage: str
    begin_ns: int
    end_ns: int | None = None
    outcome: str = ""
    begin_error_m: list[float] = field(default_factory=list)
    error_m: list[float] = field(default_factory=list)
    touches: list[LessonTouch] = field(default_factory=list)
    nearest_m: float | None = None
    contact_ns: int | None = None
    peak_n: float = 0.0

    def observe(self, t_ns: int, height_m: float, finger_n: float) -> None:
        """Takes in one physics step: height of the finger above the cell [m], force on the finger [N]."""
        self.nearest_m = height_m if self.nearest_m is None else min(self.nearest_m, height_m)
        if finger_n > 0.0 and self.contact_ns is None:
            self.contact_ns = t_ns
        self.peak_n = max(self.peak_n, finger_n)


@dataclass
class StrokeTruth:
    """What a stroke really was.

    Attributes:
        stroke: Index in the deployment's list of strokes.
        stage: Stage of the program in which it happened.
        begin_ns: The finger appeared.
        end_ns: It was gone again; None while it lasts.
        asked: Rows of the cells in the order in which the script wants them brushed.
        touched: Rows of the cells that felt something meanwhile, ascending.
        peak_n: Largest normal force on the finger [N].
    """

    stroke: int
    stage: str
    begin_ns: int
    end_ns: int | None = None
    asked: list[int] = field(default_factory=list)
    touched: list[int] = field(default_factory=list)
    peak_n: float = 0.0
