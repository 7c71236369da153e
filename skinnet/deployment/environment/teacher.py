"""Teacher spec: touches, lessons and strokes of the teacher's finger."""

from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import CellName, NonNegative, Positive, StageName, Table, Vector3
from skinnet.errors import DeploymentError
from skinnet.suggestions import known_names

__all__ = [
    "CellRange",
    "GoalSpec",
    "LessonSpec",
    "StrokeSpec",
    "TeacherSpec",
    "TouchSpec",
    "parse_cell_range",
]

CellRange = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+(/[0-9]+(-[0-9]+)?)?$")]
"""Range of cells: all of "patch", one as in "patch/3", or several as in "patch/3-7", ends included."""


class TouchSpec(Table, frozen=True, kw_only=True):
    """Touch of the teacher's finger on a cell, along the cell's normal.

    The finger starts `approach_m` above the face of the foam and approaches at `speed_m_s`. For `hold_s` it
    either holds a depth in the foam, at the position of the cell when the touch began (`depth_m`), or follows
    the cell at a constant force (`force_n`). Then it withdraws along the same path. With a negative `depth_m`
    it stops before contact.
    """

    cell: CellName
    stage: StageName
    """Stage, or one of its states as in "teach_and_grasp.hold"."""
    start_s: NonNegative
    force_cell: Annotated[int, Meta(ge=0, le=2)] | None = None
    """Force cell to aim at, instead of the centre of the cell."""
    approach_m: Positive = 0.08
    speed_m_s: Positive = 0.03
    depth_m: float | None = None
    force_n: Positive | None = None
    hold_s: NonNegative = 0.5


class GoalSpec(Table, frozen=True, kw_only=True):
    """Goal position of a point of the robot in a lesson."""

    body: str
    point_m: Vector3 = (0.0, 0.0, 0.0)
    """Point, in the frame of the body."""
    position_m: Vector3
    """Goal position, world frame."""
    weight: Positive = 1.0


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
    goals: Annotated[tuple[GoalSpec, ...], Meta(min_length=1)]
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
    cells: Annotated[tuple[CellRange, ...], Meta(min_length=1)]
    """Cells to stroke, in the order of the list: "patch", "patch/3" or "patch/3-7"."""
    depth_m: Positive = 0.002
    approach_m: Positive = 0.05
    speed_m_s: Positive = 0.1


class TeacherSpec(Table, frozen=True, kw_only=True):
    """Teacher's finger: a warm sphere with one action at a time."""

    tip_radius_m: Positive = 0.008
    temperature_c: float = 33.0
    touches: tuple[TouchSpec, ...] = ()
    lessons: tuple[LessonSpec, ...] = ()
    strokes: tuple[StrokeSpec, ...] = ()


def parse_cell_range(key: str, name: str, cells_per_patch: Mapping[str, int]) -> tuple[str, range]:
    """Parse the cell range `name` into its patch and cells.

    Args:
        key: Deployment key of the name, for errors.
        name: A `CellRange` or `CellName`.
        cells_per_patch: Number of cells of every patch.

    Raises:
        DeploymentError: the patch or a cell does not exist.
    """
    patch, _, numbers = name.partition("/")
    if patch not in cells_per_patch:
        raise DeploymentError(f"{key} = {name!r}: unknown patch; {known_names(patch, cells_per_patch)}")
    if not numbers:
        return patch, range(cells_per_patch[patch])
    first, _, last = numbers.partition("-")
    cells = range(int(first), int(last or first) + 1)
    if not cells:
        raise DeploymentError(f"{key} = {name!r}: the smaller number comes first")
    if cells[-1] >= cells_per_patch[patch]:
        raise DeploymentError(f"{key} = {name!r}: {patch} has cells 0 to {cells_per_patch[patch] - 1}")
    return patch, cells
