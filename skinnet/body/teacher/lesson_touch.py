"""Servo of the finger at one cell of a lesson: target height, end of the motion, stall.

Towards the end of a motion the finger widens the gap, so that the arm slows down.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.ground_truth.teaching_outcome import LessonGroundTruth, LessonTouch
from skinnet.body.teacher.evasion import Evasion
from skinnet.body.teacher.finger import ApproachLine, Finger
from skinnet.body.teacher.finger_task import FingerPhase
from skinnet.body.teacher.lesson_plan import PositionGoals
from skinnet.deployment.environment.teacher import LessonSpec
from skinnet.deployment.types import ns_of_s
from skinnet.pinned_linalg import norm

__all__ = ["CLEARANCE_M", "POSITION_TOLERANCE_M", "LessonContext", "LessonTouchServo"]

CLEARANCE_M = 0.003
"""Clearance [m] between the finger and solids behind it (assumed, as all of the following)."""
POSITION_TOLERANCE_M = 0.002
"""Position tolerance [m] of the finger."""
_OBSERVATION_PERIOD_NS = 20_000_000
"""Period [ns] at which the teacher observes the arm."""
_SLOWDOWN_RAD = 0.04
"""Remaining motion [rad] below which the finger's gap grows as the remaining motion shrinks."""
_MIN_REMAINING_RAD = 0.008
"""Remaining motion [rad] below which the finger leaves the cell."""
_REPLANNING_RAD = 0.4
"""Motion [rad] after which the linearised plan is invalid and the teacher replans."""
_STALL_TIME_NS, _STALL_MOTION_RAD = 600_000_000, 0.004
"""Stall criterion: time [ns] and motion [rad]; a cell that moves the arm by less in it is left."""


class LessonContext(NamedTuple):
    """Context of a lesson, the same for all its touches.

    Attributes:
        finger: The finger.
        spec: The lesson.
        goals: Its goals.
        evasion: Evasive motion of the cells.
        ground_truth: Ground truth, filled in during the lesson.
    """

    finger: Finger
    spec: LessonSpec
    goals: PositionGoals
    evasion: Evasion
    ground_truth: LessonGroundTruth

    @property
    def end_ns(self) -> int:
        """Time [ns] at which the timeout of the lesson has passed."""
        return self.ground_truth.begin_ns + ns_of_s(self.spec.timeout_s)

    def usable_height_m(self, line: ApproachLine) -> float:
        """Usable height [m] above the cell, up to which the finger can withdraw along `line`."""
        approach_m = self.spec.approach_m
        return min(approach_m, self.finger.free_distance_m(line, approach_m + CLEARANCE_M) - CLEARANCE_M)


class LessonTouchServo:
    """Servo of the finger at one cell, from its appearance above the cell to its withdrawal.

    Attributes:
        touch: Ground truth of the touch.
        height_m: Target height of the finger above the cell [m].
    """

    def __init__(
        self, lesson: LessonContext, row: int, planned_rows: NDArray[np.int64], height_m: float, t_ns: int
    ) -> None:
        """Begin the touch of cell `row` at `t_ns` [ns].

        Args:
            lesson: The lesson.
            row: Row of the cell.
            planned_rows: Rows of all cells that the plan moves.
            height_m: Height at which the finger appears [m].
            t_ns: Present time [ns].
        """
        self.touch = LessonTouch(row, t_ns)
        self.height_m = self._free_height_m = height_m
        self._lesson, self._planned_rows = lesson, planned_rows
        self._start_rad = lesson.evasion.position_rad()
        self._next_observation_ns = t_ns
        self._progress = (t_ns, 0.0)

    def update(self, phase: FingerPhase, line: ApproachLine, height_m: float, t_ns: int) -> FingerPhase:
        """Update the target height from an observation, if one is due; return the next phase.

        Args:
            phase: Present phase.
            line: Present approach line of the cell.
            height_m: Present height of the finger above the cell [m].
            t_ns: Present time [ns].
        """
        if t_ns < self._next_observation_ns:
            return phase
        self._next_observation_ns += _OBSERVATION_PERIOD_NS  # on a grid of its own, whatever the step
        self._free_height_m = self._lesson.usable_height_m(line)
        if phase is FingerPhase.WITHDRAW:
            self.height_m = self._free_height_m
            return phase
        near = abs(height_m - self.height_m) < POSITION_TOLERANCE_M
        remaining_rad = self._observe(near, t_ns)
        if remaining_rad is None:
            self.withdraw(t_ns)
            return FingerPhase.WITHDRAW
        spec = self._lesson.spec
        self.height_m = spec.tip_height_m
        if spec.clearance_m is not None:
            gap_m = spec.tip_height_m * max(1.0, _SLOWDOWN_RAD / remaining_rad)
            self.height_m = min(gap_m, self._free_height_m)
        return FingerPhase.HOLD if near else phase

    def withdraw(self, t_ns: int) -> None:
        """Withdraw the finger from `t_ns` [ns] on."""
        self.height_m = self._free_height_m
        self.touch.end_ns = t_ns

    def _observe(self, near: bool, t_ns: int) -> float | None:
        """Observe the arm's motion; return the remaining motion [rad], or None to leave the cell."""
        lesson, touch = self._lesson, self.touch
        moved_rad = lesson.evasion.position_rad() - self._start_rad
        touch.joint_motion_rad = norm(moved_rad)
        seen = lesson.evasion.observe(touch.cell, moved_rad)
        remaining_rad = self._remaining_rad()
        if not near or touch.joint_motion_rad >= self._progress[1] + _STALL_MOTION_RAD:
            self._progress = (t_ns, touch.joint_motion_rad)
        stalled = t_ns >= self._progress[0] + _STALL_TIME_NS
        if stalled and not seen:
            lesson.evasion.mark_unresponsive(touch.cell)
        leaves = (
            stalled
            or remaining_rad < _MIN_REMAINING_RAD
            or touch.joint_motion_rad > _REPLANNING_RAD
            or t_ns >= lesson.end_ns
            or self._free_height_m < lesson.spec.tip_height_m + CLEARANCE_M
        )
        return None if leaves else remaining_rad

    def _remaining_rad(self) -> float:
        """Remaining motion [rad] of the cell, given that the plan's other cells move as planned."""
        lesson, rows = self._lesson, self._planned_rows
        motions_rad = lesson.goals.plan_motions_rad(lesson.evasion.directions(rows))
        lesson.ground_truth.error_m = lesson.goals.error_m().tolist()
        return float(motions_rad[rows == self.touch.cell][0])
