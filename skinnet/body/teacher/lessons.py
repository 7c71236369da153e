"""Lesson by tactile guidance [M14]: the finger drives the robot into a pose, one cell after the other.

The teacher observes the goals' points and the evasion of the arms. In a loop it plans the motions of all
cells that would reach the goals, approaches the cell with the longest motion, follows it while the arm
evades, and replans.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.body.ground_truth.teaching_outcome import LessonOutcome
from skinnet.body.teacher.finger import ContactTarget
from skinnet.body.teacher.finger_task import FingerPhase, FingerTask
from skinnet.body.teacher.lesson_touch import POSITION_TOLERANCE_M, LessonContext, LessonTouchServo
from skinnet.clock import NS_PER_S
from skinnet.pinned_linalg import norm

__all__ = ["Lesson"]

Floats = NDArray[np.float64]

# Parameters of the teacher's behaviour; all are assumptions.
_MIN_PLANNED_RAD = 0.012
"""Minimum planned motion [rad] of a cell to be touched."""
_RETREAT_PAUSE_NS = 100_000_000
"""Pause [ns] between two cells: the finger moves on, and the arm comes to rest."""
_MIN_APPROACH_M = 0.012
"""Minimum approach distance [m] above the finger's holding height at a cell."""
_MAX_INEFFECTIVE_TOUCHES, _MIN_IMPROVEMENT_M = 16, 0.002
"""Termination: number of consecutive touches that reduce the error by less than this [m]."""


class Lesson(FingerTask):
    """Lesson task of the teacher's script."""

    def __init__(self, lesson: LessonContext, targets: Sequence[ContactTarget]) -> None:
        """Prepare the lesson with `targets`, one on each usable cell; it begins with the next step."""
        truth = lesson.ground_truth
        super().__init__(lesson.finger, truth)
        self._lesson = lesson
        self._targets = {spot.row: spot for spot in targets}
        self._servo: LessonTouchServo | None = None
        self._decided = LessonOutcome.IN_PROGRESS
        self._pause_ns = 0
        self._smallest_error_m, self._ineffective_touches = np.inf, 0
        truth.begin_error_m = truth.error_m = lesson.goals.error_m().tolist()

    def abort(self, t_ns: int) -> None:
        """Abort the lesson at `t_ns` [ns]: the finger withdraws."""
        self._decide(LessonOutcome.STAGE_OVER)
        if self.phase is not FingerPhase.WITHDRAW and self._servo is not None:
            self._servo.withdraw(t_ns)
        super().abort(t_ns)

    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""
        truth = self._lesson.ground_truth
        if self._servo is None and t_ns < self._pause_ns and self._in_progress:
            return
        servo = self._servo or self._next_touch(t_ns)
        if servo is None:
            truth.outcome = self._decided
            self._finish(t_ns)
            return
        line = self._finger.approach_line(self._targets[servo.touch.cell])
        height_m = self._finger.height_m(line)
        truth.record(t_ns, height_m, self._finger.force_n())
        self._enter(servo.update(self.phase, line, height_m, t_ns))
        if self.phase is FingerPhase.WITHDRAW and height_m >= servo.height_m - POSITION_TOLERANCE_M:
            self._finger.park()
            self._servo, self._pause_ns = None, t_ns + _RETREAT_PAUSE_NS
            return
        self._finger.pursue(line, servo.height_m, step_ns / NS_PER_S, self._lesson.spec.max_speed_m_s)

    def _decide(self, outcome: LessonOutcome) -> None:
        """Decide the outcome, which is recorded with the end of the lesson; the first decision stands."""
        if self._in_progress:
            self._decided = outcome

    @property
    def _in_progress(self) -> bool:
        return self._decided is LessonOutcome.IN_PROGRESS

    def _next_touch(self, t_ns: int) -> LessonTouchServo | None:
        """Start a touch of the cell with the longest planned motion; None if the lesson is over."""
        lesson = self._lesson
        error_m = lesson.goals.error_m()
        lesson.ground_truth.error_m = error_m.tolist()
        if self._in_progress:
            self._check_termination(error_m, t_ns)
        if not self._in_progress:
            return None
        lines = {row: self._finger.approach_line(spot) for row, spot in self._targets.items()}
        rooms_m = {row: lesson.usable_height_m(line) for row, line in lines.items()}
        min_room_m = lesson.spec.tip_height_m + _MIN_APPROACH_M
        free = np.array([row for row, room_m in rooms_m.items() if room_m >= min_room_m], dtype=np.int64)
        motions_rad = lesson.goals.plan_motions_rad(lesson.evasion.directions(free))
        if motions_rad.max(initial=0.0) < _MIN_PLANNED_RAD:
            self._decide(LessonOutcome.NOTHING_HELPS)
            return None
        row = int(free[np.argmax(motions_rad)])
        self._servo = LessonTouchServo(lesson, row, free[motions_rad > 0.0], rooms_m[row], t_ns)
        lesson.ground_truth.touches.append(self._servo.touch)
        self._enter(FingerPhase.APPROACH)
        self._finger.place(lines[row], rooms_m[row])
        return self._servo

    def _check_termination(self, error_m: Floats, t_ns: int) -> None:
        """Decide the outcome between touches, if a termination criterion is met."""
        if (error_m <= self._lesson.spec.tolerance_m).all():
            self._decide(LessonOutcome.REACHED)
            return
        if t_ns >= self._lesson.end_ns:
            self._decide(LessonOutcome.TIMEOUT)
            return
        total_m = norm(error_m)
        improved = total_m < self._smallest_error_m - _MIN_IMPROVEMENT_M
        self._ineffective_touches = 0 if improved else self._ineffective_touches + 1
        self._smallest_error_m = min(self._smallest_error_m, total_m)
        if self._ineffective_touches > _MAX_INEFFECTIVE_TOUCHES:
            self._decide(LessonOutcome.NOTHING_HELPS)
