"""Lesson by tactile guidance [M14]: the finger drives the robot into a pose, one cell after the other.

The teacher observes the goals' points and the evasion of the arms. In a loop it plans the motions of all
cells that would reach the goals, approaches the cell with the longest motion, follows it while the arm
evades, and replans. Towards the end of a motion it widens the gap, so that the arm slows down.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.body.ground_truth.teaching_outcome import LessonGroundTruth, LessonTouch
from skinnet.body.teacher.evasion import Evasion
from skinnet.body.teacher.finger import ApproachLine, ContactTarget, Finger, FingerPhase
from skinnet.body.teacher.lesson_plan import PositionGoals
from skinnet.clock import NS_PER_S
from skinnet.deployment.environment.teacher import LessonSpec
from skinnet.deployment.types import ns_of_s

__all__ = ["Lesson"]

Floats = NDArray[np.float64]

# Parameters of the teacher's behaviour; all are assumptions.
_OBSERVATION_PERIOD_NS = 20_000_000
"""Period [ns] at which the teacher observes the arm."""
_SLOWDOWN_RAD = 0.04
"""Remaining motion [rad] below which the finger's gap grows as the remaining motion shrinks."""
_MIN_REMAINING_RAD = 0.008
"""Remaining motion [rad] below which the finger leaves the cell."""
_MIN_PLANNED_RAD = 0.012
"""Minimum planned motion [rad] of a cell to be touched."""
_REPLANNING_RAD = 0.4
"""Motion [rad] after which the linearised plan is invalid and the teacher replans."""
_RETREAT_PAUSE_NS = 100_000_000
"""Pause [ns] between two cells: the finger moves on, and the arm comes to rest."""
_STALL_TIME_NS, _STALL_MOTION_RAD = 600_000_000, 0.004
"""Stall criterion: time [ns] and motion [rad]; a cell that moves the arm by less in it is left."""
_POSITION_TOLERANCE_M = 0.002
"""Position tolerance [m] of the finger."""
_CLEARANCE_M = 0.003
"""Clearance [m] between the finger and solids behind it."""
_MIN_APPROACH_M = 0.012
"""Minimum approach distance [m] above the finger's holding height at a cell."""
_MAX_INEFFECTIVE_TOUCHES, _MIN_IMPROVEMENT_M = 16, 0.002
"""Termination: number of consecutive touches that reduce the error by less than this [m]."""


class Lesson:
    """Lesson task of the teacher's script.

    Attributes:
        phase: Motion phase of the finger.
        finished: The lesson has ended and the finger is parked.
        ground_truth: Ground truth of the lesson.
    """

    def __init__(
        self,
        finger: Finger,
        spec: LessonSpec,
        targets: Sequence[ContactTarget],
        goals: PositionGoals,
        evasion: Evasion,
        ground_truth: LessonGroundTruth,
    ) -> None:
        """Prepare the lesson; it begins with the next step.

        Args:
            finger: The finger.
            spec: The lesson.
            targets: Usable contact targets, one on each cell.
            goals: Its goals.
            evasion: Evasive motion of the cells.
            ground_truth: Ground truth, filled in during the lesson.
        """
        self.phase = FingerPhase.APPROACH
        self.finished = False
        self.ground_truth = ground_truth
        self._finger, self._spec, self._goals, self._evasion = finger, spec, goals, evasion
        self._targets = {spot.row: spot for spot in targets}
        self._near_m = spec.tip_height_m
        self._end_ns = ground_truth.begin_ns + ns_of_s(spec.timeout_s)
        self._outcome = ""
        self._touch: LessonTouch | None = None
        self._plan = np.zeros(0, dtype=np.int64)
        self._start_rad = np.zeros(0)
        self._height_m = self._free_height_m = 0.0
        self._next_observation_ns = self._pause_ns = 0
        self._progress = (0, 0.0)
        self._smallest_error_m, self._ineffective_touches = np.inf, 0
        ground_truth.begin_error_m = ground_truth.error_m = goals.error_m().tolist()

    def abort(self, t_ns: int) -> None:
        """Abort the lesson at `t_ns` [ns]: the finger withdraws."""
        self._outcome = self._outcome or "stage over"
        if self.phase is not FingerPhase.WITHDRAW:
            self._withdraw(t_ns)

    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""
        if self._touch is None and t_ns < self._pause_ns and not self._outcome:
            return
        touch = self._touch or self._next_touch(t_ns)
        if touch is None:
            self.ground_truth.end_ns, self.ground_truth.outcome = t_ns, self._outcome
            self.phase, self.finished = FingerPhase.PARKED, True
            return
        line = self._finger.approach_line(self._targets[touch.cell])
        height_m = self._finger.height_m(line)
        self.ground_truth.record(t_ns, height_m, self._finger.force_n())
        if t_ns >= self._next_observation_ns:
            self._observe(touch, line, height_m, t_ns)
        if self.phase is FingerPhase.WITHDRAW and height_m >= self._height_m - _POSITION_TOLERANCE_M:
            self._finger.park()
            self._touch, self._pause_ns = None, t_ns + _RETREAT_PAUSE_NS
            return
        self._finger.pursue(line, self._height_m, step_ns / NS_PER_S, self._spec.max_speed_m_s)

    def _next_touch(self, t_ns: int) -> LessonTouch | None:
        """Start a touch of the cell with the longest planned motion; None if the lesson is over."""
        error_m = self._goals.error_m()
        self.ground_truth.error_m = error_m.tolist()
        if not self._outcome:
            self._outcome = self._check_termination(error_m, t_ns)
        if self._outcome:
            return None
        lines = {row: self._finger.approach_line(spot) for row, spot in self._targets.items()}
        rooms_m = {row: self._usable_height_m(line) for row, line in lines.items()}
        free = np.array(
            [row for row, room_m in rooms_m.items() if room_m >= self._near_m + _MIN_APPROACH_M],
            dtype=np.int64,
        )
        directions = self._evasion.directions(free)
        motions_rad = self._goals.plan_motions_rad(directions)
        if motions_rad.max(initial=0.0) < _MIN_PLANNED_RAD:
            self._outcome = "nothing helps"
            return None
        row = int(free[np.argmax(motions_rad)])
        self._plan = free[motions_rad > 0.0]
        self._start_rad = self._evasion.position_rad()
        self._height_m = self._free_height_m = rooms_m[row]
        self._next_observation_ns, self._progress = t_ns, (t_ns, 0.0)
        self._touch = LessonTouch(row, t_ns)
        self.ground_truth.touches.append(self._touch)
        self.phase = FingerPhase.APPROACH
        self._finger.place(lines[row], self._height_m)
        return self._touch

    def _check_termination(self, error_m: Floats, t_ns: int) -> str:
        """Evaluate the termination criteria between touches: the outcome, or "" to continue."""
        if (error_m <= self._spec.tolerance_m).all():
            return "reached"
        if t_ns >= self._end_ns:
            return "out of patience"
        total_m = float(np.linalg.norm(error_m))
        self._ineffective_touches = (
            0 if total_m < self._smallest_error_m - _MIN_IMPROVEMENT_M else self._ineffective_touches + 1
        )
        self._smallest_error_m = min(self._smallest_error_m, total_m)
        return "nothing helps" if self._ineffective_touches > _MAX_INEFFECTIVE_TOUCHES else ""

    def _observe(self, touch: LessonTouch, line: ApproachLine, height_m: float, t_ns: int) -> None:
        """Observe the arm's motion; set the finger's height, or withdraw."""
        self._next_observation_ns = t_ns + _OBSERVATION_PERIOD_NS
        self._free_height_m = self._usable_height_m(line)
        if self.phase is FingerPhase.WITHDRAW:
            self._height_m = self._free_height_m
            return
        moved_rad = self._evasion.position_rad() - self._start_rad
        touch.joint_motion_rad = float(np.linalg.norm(moved_rad))
        seen = self._evasion.observe(touch.cell, moved_rad)
        left_rad = self._remaining_rad(touch.cell)
        near = abs(height_m - self._height_m) < _POSITION_TOLERANCE_M
        if near:
            self.phase = FingerPhase.HOLD
        if not near or touch.joint_motion_rad >= self._progress[1] + _STALL_MOTION_RAD:
            self._progress = (t_ns, touch.joint_motion_rad)
        stalled = t_ns >= self._progress[0] + _STALL_TIME_NS
        if stalled and not seen:
            self._evasion.mark_unresponsive(touch.cell)
        if (
            stalled
            or left_rad < _MIN_REMAINING_RAD
            or touch.joint_motion_rad > _REPLANNING_RAD
            or t_ns >= self._end_ns
            or self._free_height_m < self._near_m + _CLEARANCE_M
        ):
            self._withdraw(t_ns)
        else:
            self._height_m = self._near_m
            if self._spec.clearance_m is not None:
                self._height_m = min(self._near_m * max(1.0, _SLOWDOWN_RAD / left_rad), self._free_height_m)

    def _remaining_rad(self, row: int) -> float:
        """Remaining motion [rad] of the cell `row`, given that the plan's other cells move as planned."""
        directions = self._evasion.directions(self._plan)
        motions_rad = self._goals.plan_motions_rad(directions)
        self.ground_truth.error_m = self._goals.error_m().tolist()
        return float(motions_rad[self._plan == row][0])

    def _usable_height_m(self, line: ApproachLine) -> float:
        """Usable height [m] above the cell, up to which the finger can withdraw."""
        approach_m = self._spec.approach_m
        return min(approach_m, self._finger.free_distance_m(line, approach_m + _CLEARANCE_M) - _CLEARANCE_M)

    def _withdraw(self, t_ns: int) -> None:
        self.phase = FingerPhase.WITHDRAW
        self._height_m = self._free_height_m
        if self._touch is not None:
            self._touch.end_ns = t_ns
