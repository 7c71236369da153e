"""What a teacher does with one finger, as a deployment describes it: touches, lessons and strokes."""

from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta

from skinnet.deployment.table import CellName, NonNegative, Positive, StageName, Table, Vector
from skinnet.errors import DeploymentError

__all__ = ["CellsName", "GoalSpec", "LessonSpec", "StrokeSpec", "TeacherSpec", "TouchSpec", "cells_of"]

CellsName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+(/[0-9]+(-[0-9]+)?)?$")]
"""Cells of a patch: all of "patch", one as in "patch/3", or several as in "patch/3-7", ends included."""


class TouchSpec(Table, frozen=True, kw_only=True):
    """One touch of the teacher's finger on a cell, along the cell's normal.

    The finger appears `approach_m` above the face of the foam, approaches at `speed_m_s`, then holds a
    depth into the foam where the cell was when the touch began (`depth_m`), or holds a force while it
    follows the cell (`force_n`), for `hold_s`, and withdraws the way it came. `depth_m` may be
    negative: the finger stops short of contact.
    """

    cell: CellName
    stage: StageName
    """A stage, or one of its states as in "session.hold"."""
    start_s: NonNegative
    force_cell: Annotated[int, Meta(ge=0, le=2)] | None = None
    """Aim at this force cell instead of the middle of the cell."""
    approach_m: Positive = 0.08
    speed_m_s: Positive = 0.03
    depth_m: float | None = None
    force_n: Positive | None = None
    hold_s: NonNegative = 0.5


class GoalSpec(Table, frozen=True, kw_only=True):
    """Where the teacher wants a point of the robot to come."""

    body: str
    point_m: Vector = (0.0, 0.0, 0.0)
    """In the frame of the body."""
    at_m: Vector
    """In the world."""
    weight: Positive = 1.0


class LessonSpec(Table, frozen=True, kw_only=True):
    """A pose into which the teacher leads the robot, which evades his finger.

    The finger comes near to one cell after the other, wherever that cell's evasion takes the goals' points to
    their places, follows the cell as it evades, and stays away when all are within `tolerance_m`, when
    nothing helps any more, or when the teacher's patience is over. Each time that `stage` begins, the next
    lesson of that stage is given. Defaults are *(assumed)*.
    """

    stage: StageName
    """A stage, or one of its states as in "session.guide_proximity"."""
    start_s: NonNegative = 0.5
    goals: Annotated[tuple[GoalSpec, ...], Meta(min_length=1)]
    tolerance_m: Positive = 0.015
    gap_m: Positive | None = None
    """Without contact: the finger comes as near as this to the face of the foam, at proximity guidance."""
    depth_m: Positive | None = None
    """With contact: it presses a force cell as deep as this, at force guidance."""
    approach_m: Positive = 0.05
    """Height above the face of the foam at which the finger appears, less where something is in the way."""
    speed_m_s: Positive = 0.1
    """The finger is never faster."""
    cells: tuple[CellsName, ...] = ()
    """Cells that may be used, all unless given: "patch", "patch/3" or "patch/3-7"."""
    patience_s: Positive = 120.0

    @property
    def near_m(self) -> float:
        """Height of the finger above the face of the foam while it guides, negative with contact [m]."""
        if self.gap_m is not None:
            return self.gap_m
        assert self.depth_m is not None
        return -self.depth_m


class StrokeSpec(Table, frozen=True, kw_only=True):
    """Cells over which the finger brushes, one after the other.

    It begins at a corner, goes on to the nearest cell that is left, lifts where that is no neighbour, and
    stays `depth_m` deep in the foam along the local normal. Each time that `stage` begins, the next stroke of
    that stage is given. Defaults are *(assumed)*.
    """

    stage: StageName
    """A stage, or one of its states as in "session.attend"."""
    start_s: NonNegative = 0.5
    cells: Annotated[tuple[CellsName, ...], Meta(min_length=1)]
    """Patches in the order of the list: "patch", "patch/3" or "patch/3-7"."""
    depth_m: Positive = 0.002
    approach_m: Positive = 0.05
    speed_m_s: Positive = 0.1


class TeacherSpec(Table, frozen=True, kw_only=True):
    """A teacher's finger: a warm sphere that does one thing after the other."""

    tip_radius_m: Positive = 0.008
    temperature_c: float = 33.0
    touches: tuple[TouchSpec, ...] = ()
    lessons: tuple[LessonSpec, ...] = ()
    strokes: tuple[StrokeSpec, ...] = ()


def cells_of(key: str, name: str, sizes: Mapping[str, int]) -> tuple[str, range]:
    """The patch and its cells that `name`, a `CellsName` or `CellName` under `key`, means.

    Args:
        key: Where the name stands in the deployment.
        name: As above.
        sizes: Number of cells of every patch.

    Raises:
        DeploymentError: there is no such patch or cell.
    """
    patch, _, numbers = name.partition("/")
    if patch not in sizes:
        raise DeploymentError(f"{key} = {name!r}: unknown patch; there are {', '.join(sizes)}")
    if not numbers:
        return patch, range(sizes[patch])
    first, _, last = numbers.partition("-")
    cells = range(int(first), int(last or first) + 1)
    if not cells:
        raise DeploymentError(f"{key} = {name!r}: the smaller number comes first")
    if cells[-1] >= sizes[patch]:
        raise DeploymentError(f"{key} = {name!r}: {patch} has cells 0 to {sizes[patch] - 1}")
    return patch, cells
