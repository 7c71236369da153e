"""Teacher: one finger that executes a script of touches, lessons and strokes, by program stage."""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import mujoco

from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.ground_truth.cell_kinematics import MovingSkin
from skinnet.body.ground_truth.teaching_outcome import (
    LessonGroundTruth,
    StrokeGroundTruth,
    TeachingOutcome,
    TouchGroundTruth,
)
from skinnet.body.model import BodyModel
from skinnet.body.teacher.evasion import Evasion
from skinnet.body.teacher.finger import ContactTarget, Finger, contact_target
from skinnet.body.teacher.finger_task import FingerPhase, FingerTask
from skinnet.body.teacher.lesson_plan import PositionGoals
from skinnet.body.teacher.lesson_touch import LessonContext
from skinnet.body.teacher.lessons import Lesson
from skinnet.body.teacher.reachable_force import largest_force_n
from skinnet.body.teacher.strokes import Stroke, SweepPath, plan_sweeps
from skinnet.body.teacher.touches import Touch
from skinnet.clock import NS_PER_S
from skinnet.deployment.cell_names import parse_cell_range
from skinnet.deployment.environment.teacher import TeacherSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.errors import DeploymentError

__all__ = ["Teacher", "TeacherSkin"]

_PUSHED_FORCE_CELL = 0
"""Force cell that a lesson with contact pushes on each cell: one force cell gives the largest reading."""


class TeacherSkin(NamedTuple):
    """Skin interface of the teacher: foundation and cell names.

    Attributes:
        foundation: Foundation of the cells.
        cells: Rows of each patch's cells, by the name of the patch.
        spec: Geometry of a cell.
    """

    foundation: Foundation
    cells: Mapping[str, slice]
    spec: CellSpec

    def contact_targets(
        self, key: str, names: Sequence[str], force_cell: int | None = None
    ) -> list[ContactTarget]:
        """Resolve contact targets of the cells `names`, given under `key` of the deployment.

        Raises:
            DeploymentError: there is no such patch or cell.
        """
        sizes = {patch: rows.stop - rows.start for patch, rows in self.cells.items()}
        found = [parse_cell_range(key, name, sizes) for name in names]
        rows = [self.cells[patch].start + cell for patch, cells in found for cell in cells]
        return [contact_target(self.foundation, row, self.spec, force_cell) for row in rows]


class _ScheduledTask(NamedTuple):
    """Scheduled task of the present stage: begin time [ns] and factory."""

    t_ns: int
    begin: Callable[[int], FingerTask]


class Teacher:
    """Teacher that executes its script of touches, lessons and strokes, one task at a time.

    A task begins `start_s` after its stage, or when the finger is free again: in the order of `start_s`,
    touches before lessons before strokes. Each time a stage begins, all its touches are scheduled, and the
    next one of its lessons and strokes. When another stage begins, the finger withdraws and the remaining
    tasks of the old stage are dropped.

    Attributes:
        finger: The finger.
        outcome: Ground truth of the tasks so far.
    """

    def __init__(
        self, model: BodyModel, data: mujoco.MjData, skin: TeacherSkin, spec: TeacherSpec, source: str
    ) -> None:
        """Resolve the script and park the finger.

        Args:
            model: The robot model.
            data: MuJoCo's state.
            skin: The robot's skin.
            spec: The script.
            source: Model file, for error messages.

        Raises:
            DeploymentError: the script names a cell that does not exist, or a force that the finger cannot
                reach there.
            ModelError: a lesson's goal names a body that does not exist.
        """
        self.outcome = TeachingOutcome()
        foundation = skin.foundation
        self.finger = Finger(data, model.finger_body_id, foundation, spec.tip_radius_m)
        self._foundation, self._spec = foundation, spec
        self._moving_skin = MovingSkin(model, data, foundation.surface, foundation.foam.thickness_m)
        self._touch_targets = [
            skin.contact_targets(f"teacher.touches[{i}].cell", [touch.cell], touch.force_cell)[0]
            for i, touch in enumerate(spec.touches)
        ]
        self._require_reachable_forces(data)
        self._lesson_targets = [
            skin.contact_targets(
                f"teacher.lessons[{i}].cells",
                lesson.cells or tuple(skin.cells),
                None if lesson.depth_m is None else _PUSHED_FORCE_CELL,
            )
            for i, lesson in enumerate(spec.lessons)
        ]
        self._goals = [
            PositionGoals(model, data, lesson.goals, f"teacher.lessons[{i}]", source)
            for i, lesson in enumerate(spec.lessons)
        ]
        self.sweeps = [
            [
                SweepPath(spots)
                for name in stroke.cells
                for spots in plan_sweeps(
                    skin.contact_targets(f"teacher.strokes[{i}].cells", [name]), skin.spec.side_m
                )
            ]
            for i, stroke in enumerate(spec.strokes)
        ]
        self._stage_visits: Counter[str] = Counter()
        self._queue: deque[_ScheduledTask] = deque()
        self._task: FingerTask | None = None

    @property
    def phase(self) -> FingerPhase:
        """Motion phase of the finger."""
        return FingerPhase.PARKED if self._task is None else self._task.phase

    def begin_stage(self, name: str, t_ns: int) -> None:
        """Begin stage `name` of the controller's program at `t_ns` [ns]: schedule its tasks."""
        spec = self._spec
        count = self._stage_visits[name]
        self._stage_visits[name] += 1
        touches = [i for i, touch in enumerate(spec.touches) if touch.stage == name]
        lessons = [i for i, lesson in enumerate(spec.lessons) if lesson.stage == name]
        strokes = [i for i, stroke in enumerate(spec.strokes) if stroke.stage == name]
        due = [(spec.touches[i].start_s, partial(self._touch, i)) for i in touches]
        due += [(spec.lessons[i].start_s, partial(self._lesson, i)) for i in lessons[count : count + 1]]
        due += [(spec.strokes[i].start_s, partial(self._stroke, i)) for i in strokes[count : count + 1]]
        due.sort(key=lambda entry: entry[0])
        self._queue = deque(_ScheduledTask(t_ns + round(start_s * NS_PER_S), begin) for start_s, begin in due)
        if self._task is not None:
            self._task.abort(t_ns)

    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""
        if self._task is None and self._queue and t_ns >= self._queue[0].t_ns:
            self._task = self._queue.popleft().begin(t_ns)
        if self._task is not None:
            self._task.step(t_ns, step_ns)
            if self._task.finished:
                self._task = None

    def record_motion_onset(self) -> None:
        """Record that the robot begins to move, if a touch is under way."""
        if isinstance(self._task, Touch):
            self._task.record_motion_onset()

    def _require_reachable_forces(self, data: mujoco.MjData) -> None:
        """Require of all touches by force that the foam can give it before the tip meets the rigid shell.

        Raises:
            DeploymentError: it cannot; names the largest force.
        """
        for i, (touch, target) in enumerate(zip(self._spec.touches, self._touch_targets, strict=True)):
            if touch.force_n is None:
                continue
            largest_n = largest_force_n(data, self._foundation, self.finger, target, touch.force_cell)
            if touch.force_n > largest_n:
                place = "" if touch.force_cell is None else f" on force cell {touch.force_cell}"
                raise DeploymentError(
                    f"teacher.touches[{i}].force_n = {touch.force_n:g}: the finger reaches at most "
                    f"{math.floor(1e3 * largest_n) / 1e3:g} N{place} of {touch.cell}, with the foam fully "
                    "compressed under its tip; take less, a larger teacher.tip_radius_m, or stiffer or "
                    "thicker body.foam"
                )

    def _touch(self, index: int, t_ns: int) -> FingerTask:
        spec = self._spec.touches[index]
        truth = TouchGroundTruth(
            touch=index,
            cell=spec.cell,
            stage=spec.stage,
            begin_ns=t_ns,
            depth_controlled=spec.depth_m is not None,
        )
        self.outcome.touches.append(truth)
        return Touch(self.finger, spec, self._touch_targets[index], truth, self._foundation.foam.thickness_m)

    def _lesson(self, index: int, t_ns: int) -> FingerTask:
        spec = self._spec.lessons[index]
        truth = LessonGroundTruth(lesson=index, stage=spec.stage, begin_ns=t_ns)
        self.outcome.lessons.append(truth)
        lesson = LessonContext(self.finger, spec, self._goals[index], Evasion(self._moving_skin), truth)
        return Lesson(lesson, self._lesson_targets[index])

    def _stroke(self, index: int, t_ns: int) -> FingerTask:
        spec, sweeps = self._spec.strokes[index], self.sweeps[index]
        asked = [spot.row for sweep in sweeps for spot in sweep.targets]
        truth = StrokeGroundTruth(stroke=index, stage=spec.stage, begin_ns=t_ns, requested_cells=asked)
        self.outcome.strokes.append(truth)
        return Stroke(self.finger, self._foundation, spec, sweeps, truth)
