"""Teacher spec: touches, lessons and strokes of the teacher's finger."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.cell_names import CellName, CellRange
from skinnet.deployment.types import NonNegative, Positive, StageName, Table, Vector3

__all__ = [
    "GoalSpec",
    "LessonSpec",
    "StrokeSpec",
    "TeacherSpec",
    "TouchSpec",
]


class TouchSpec(Table, frozen=True, kw_only=True):
    """Touch of the teacher's finger on a cell, along the cell's normal.

    The finger starts `approach_m` above the face of the foam and approaches at `speed_m_s`. For `hold_s` it
    either holds a depth in the foam, at the position of the cell when the touch began (`depth_m`), or follows
    the cell at a constant force (`force_n`). Then it withdraws along the same path. With a negative `depth_m`
    it stops before contact.
    """

    cell: CellName
    """Cell that is touched."""
    stage: StageName
    """Stage, or one of its states as in "teach_and_grasp.hold"."""
    start_s: NonNegative
    """Start of the approach, since the start of the stage."""
    force_cell: Annotated[int, Meta(ge=0, le=2)] | None = None
    """Force cell to aim at, instead of the centre of the cell."""
    approach_m: Positive = 0.08
    """Height above the foam at which the approach starts."""
    speed_m_s: Positive = 0.03
    """Speed of approach and withdrawal."""
    depth_m: float | None = None
    """Depth in the foam that is held; negative stops above it."""
    force_n: Positive | None = None
    """Force that is held; instead of `depth_m`."""
    hold_s: NonNegative = 0.5
    """Duration for which depth or force is held."""


class GoalSpec(Table, frozen=True, kw_only=True):
    """Goal position of a point of the robot in a lesson."""

    body: str
    """Body of the model that has the point."""
    point_m: Vector3 = (0.0, 0.0, 0.0)
    """Point, in the frame of the body."""
    position_m: Vector3
    """Goal position, world frame."""
    weight: Positive = 1.0
    """Weight of this goal among those of the lesson."""


class LessonSpec(Table, frozen=True, kw_only=True):
    """Tactile guidance of the robot into a pose, by proximity or by force [M14].

    The finger approaches one cell after the other, chosen such that the cell's evasion moves the points
    towards their goals, and follows the cell as it evades. The lesson ends when all points are within
    `tolerance_m`, when no cell improves them, or after `timeout_s`. Each start of `stage` gives the next
    lesson of that stage. Defaults are *(assumed)*.
    """

    stage: StageName
    """Stage, or one of its states as in "teach_and_grasp.guide_proximity"."""
    start_s: NonNegative = 0.5
    """Start of the lesson, since the start of the stage."""
    goals: Annotated[tuple[GoalSpec, ...], Meta(min_length=1)]
    """Goal positions of points of the robot."""
    tolerance_m: Positive = 0.015
    """Goal tolerance of every point."""
    clearance_m: Positive | None = None
    """Clearance between finger and foam, for proximity guidance."""
    depth_m: Positive | None = None
    """Depth of the finger in the foam over a force cell, for force guidance."""
    approach_m: Positive = 0.05
    """Initial height of the finger above the face of the foam, reduced by obstacles."""
    max_speed_m_s: Positive = 0.1
    """Speed limit of the finger."""
    cells: tuple[CellRange, ...] = ()
    """Cells that may be used: "patch", "patch/3" or "patch/3-7"; all unless given."""
    timeout_s: Positive = 120.0
    """Timeout of the lesson."""

    @property
    def tip_height_m(self) -> float:
        """Height of the finger above the face of the foam during guidance, negative with contact [m]."""
        if self.clearance_m is not None:
            return self.clearance_m
        assert self.depth_m is not None
        return -self.depth_m


class StrokeSpec(Table, frozen=True, kw_only=True):
    """Stroke of the finger over a set of cells.

    It starts at a corner, continues to the nearest remaining cell, lifts where that cell is no neighbour, and
    keeps `depth_m` in the foam along the local normal. Each start of `stage` gives the next stroke of that
    stage. Defaults are *(assumed)*.
    """

    stage: StageName
    """Stage, or one of its states as in "teach_and_grasp.attend"."""
    start_s: NonNegative = 0.5
    """Start of the stroke, since the start of the stage."""
    cells: Annotated[tuple[CellRange, ...], Meta(min_length=1)]
    """Cells to stroke, in the order of the list: "patch", "patch/3" or "patch/3-7"."""
    depth_m: Positive = 0.002
    """Depth of the finger in the foam."""
    approach_m: Positive = 0.05
    """Height above the foam at which the approach starts."""
    speed_m_s: Positive = 0.1
    """Speed of the finger."""


class TeacherSpec(Table, frozen=True, kw_only=True):
    """Teacher's finger: a warm sphere with one action at a time."""

    tip_radius_m: Positive = 0.008
    """Radius of the finger tip."""
    temperature_c: float = 33.0
    """Temperature of the finger tip."""
    touches: tuple[TouchSpec, ...] = ()
    """Touches at given times."""
    lessons: tuple[LessonSpec, ...] = ()
    """Lessons, in the order in which they are given."""
    strokes: tuple[StrokeSpec, ...] = ()
    """Strokes, in the order in which they are given."""
