"""Lesson by tactile guidance [M14]: the finger drives the robot into a pose, one cell after the other.

The teacher observes the goals' points and the evasion of the arms. In a loop it plans the motions of all
cells that would reach the goals, approaches the cell with the longest motion, follows it while the arm
evades, and replans. Towards the end of a motion it widens the gap, so that the arm slows down.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.body.evasion import Evasion
from skinnet.body.finger import Finger, Line, Phase, Spot
from skinnet.body.lesson_plan import Goals
from skinnet.body.teaching_truth import LessonTouch, LessonTruth
from skinnet.clock import NS_PER_S
from skinnet.deployment.table import ns_of_s
from skinnet.deployment.teacher import LessonSpec

__all__ = ["Lesson"]

Floats = NDArray[np.float64]

# Parameters of the teacher's behaviour; all are assumptions.
_LOOK_NS = 20_000_000
"""Period [ns] at which the teacher observes the arm."""
_SLOW_RAD = 0.04
"""Remaining motion [rad] below which the finger's gap grows as the remaining motion shrinks."""
_ENOUGH_RAD = 0.008
"""Remaining motion [rad] below which the finger leaves the cell."""
_WORTH_RAD = 0.012
"""Minimum planned motion [rad] of a cell to be touched."""
_STRIDE_RAD = 0.4
"""Motion [rad] after which the linearised plan is invalid and the teacher replans."""
_PAUSE_NS = 100_000_000
"""Pause [ns] between two cells: the finger moves on, and the arm comes to rest."""
_STALLED_NS, _STALLED_RAD = 600_000_000, 0.004
"""Stall criterion: time [ns] and motion [rad]; a cell that moves the arm by less in it is left."""
_NEAR_M = 0.002
"""Position tolerance [m] of the finger."""
_MARGIN_M = 0.003
"""Clearance [m] between the finger and solids behind it."""
_LEAST_ROOM_M = 0.012
"""Minimum approach distance [m] above the finger's holding height at a cell."""
_VAIN_TOUCHES, _GAIN_M = 16, 0.002
"""Termination: number of consecutive touches that reduce the error by less than this [m]."""


class Lesson:
    """Lesson task of the teacher's script.

    Attributes:
        phase: Motion phase of the finger.
        over: The lesson has ended and the finger is parked.
        truth: Ground truth of the lesson.
    """

    def __init__(
        self,
        finger: Finger,
        spec: LessonSpec,
        spots: Sequence[Spot],
        goals: Goals,
        evasion: Evasion,
        truth: LessonTruth,
    ) -> None:
        """Prepare the lesson; it begins with the next step.

        Args:
            finger: The finger.
            spec: The lesson.
            spots: Usable contact targets, one on each cell.
            goals: Its goals.
            evasion: Evasive motion of the cells.
            truth: Ground truth, filled in during the lesson.
        """
        self.phase = Phase.APPROACH
        self.over = False
        self.truth = truth
        self._finger, self._spec, self._goals, self._evasion = finger, spec, goals, evasion
        self._spots = {spot.row: spot for spot in spots}
        self._near_m = spec.near_m
        self._end_ns = truth.begin_ns + ns_of_s(spec.patience_s)
        self._outcome = ""
        self._touch: LessonTouch | None = None
        self._plan = np.zeros(0, dtype=np.int64)
        self._start_rad = np.zeros(0)
        self._height_m = self._room_m = 0.0
        self._look_ns = self._pause_ns = 0
        self._progress = (0, 0.0)
        self._best_m, self._vain = np.inf, 0
        truth.begin_error_m = truth.error_m = goals.error_m().tolist()

    def leave(self, t_ns: int) -> None:
        """Abort the lesson at `t_ns` [ns]: the finger withdraws."""
        self._outcome = self._outcome or "stage over"
        if self.phase is not Phase.WITHDRAW:
            self._withdraw(t_ns)

    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""
        if self._touch is None and t_ns < self._pause_ns and not self._outcome:
            return
        touch = self._touch or self._next_touch(t_ns)
        if touch is None:
            self.truth.end_ns, self.truth.outcome = t_ns, self._outcome
            self.phase, self.over = Phase.PARKED, True
            return
        line = self._finger.line(self._spots[touch.cell])
        height_m = self._finger.height_m(line)
        self.truth.observe(t_ns, height_m, self._finger.force_n())
        if t_ns >= self._look_ns:
            self._look(touch, line, height_m, t_ns)
        if self.phase is Phase.WITHDRAW and height_m >= self._height_m - _NEAR_M:
            self._finger.park()
            self._touch, self._pause_ns = None, t_ns + _PAUSE_NS
            return
        self._finger.pursue(line, self._height_m, step_ns / NS_PER_S, self._spec.speed_m_s)

    def _next_touch(self, t_ns: int) -> LessonTouch | None:
        """Start a touch of the cell with the longest planned motion; None if the lesson is over."""
        error_m = self._goals.error_m()
        self.truth.error_m = error_m.tolist()
        if not self._outcome:
            self._outcome = self._judge(error_m, t_ns)
        if self._outcome:
            return None
        lines = {row: self._finger.line(spot) for row, spot in self._spots.items()}
        rooms_m = {row: self._usable_m(line) for row, line in lines.items()}
        free = np.array(
            [row for row, room_m in rooms_m.items() if room_m >= self._near_m + _LEAST_ROOM_M], dtype=np.int64
        )
        directions = self._evasion.directions(free)
        motions_rad = self._goals.motions_rad(directions)
        if motions_rad.max(initial=0.0) < _WORTH_RAD:
            self._outcome = "nothing helps"
            return None
        row = int(free[np.argmax(motions_rad)])
        self._plan = free[motions_rad > 0.0]
        self._start_rad = self._evasion.position_rad()
        self._height_m = self._room_m = rooms_m[row]
        self._look_ns, self._progress = t_ns, (t_ns, 0.0)
        self._touch = LessonTouch(row, t_ns)
        self.truth.touches.append(self._touch)
        self.phase = Phase.APPROACH
        self._finger.appear(lines[row], self._height_m)
        return self._touch

    def _judge(self, error_m: Floats, t_ns: int) -> str:
        """Evaluate the termination criteria between touches: the outcome, or "" to continue."""
        if (error_m <= self._spec.tolerance_m).all():
            return "reached"
        if t_ns >= self._end_ns:
            return "out of patience"
        total_m = float(np.linalg.norm(error_m))
        self._vain = 0 if total_m < self._best_m - _GAIN_M else self._vain + 1
        self._best_m = min(self._best_m, total_m)
        return "nothing helps" if self._vain > _VAIN_TOUCHES else ""

    def _look(self, touch: LessonTouch, line: Line, height_m: float, t_ns: int) -> None:
        """Observe the arm's motion; set the finger's height, or withdraw."""
        self._look_ns = t_ns + _LOOK_NS
        self._room_m = self._usable_m(line)
        if self.phase is Phase.WITHDRAW:
            self._height_m = self._room_m
            return
        moved_rad = self._evasion.position_rad() - self._start_rad
        touch.moved_rad = float(np.linalg.norm(moved_rad))
        seen = self._evasion.see(touch.cell, moved_rad)
        left_rad = self._left_rad(touch.cell)
        near = abs(height_m - self._height_m) < _NEAR_M
        if near:
            self.phase = Phase.HOLD
        if not near or touch.moved_rad >= self._progress[1] + _STALLED_RAD:
            self._progress = (t_ns, touch.moved_rad)
        stalled = t_ns >= self._progress[0] + _STALLED_NS
        if stalled and not seen:
            self._evasion.forget(touch.cell)
        if (
            stalled
            or left_rad < _ENOUGH_RAD
            or touch.moved_rad > _STRIDE_RAD
            or t_ns >= self._end_ns
            or self._room_m < self._near_m + _MARGIN_M
        ):
            self._withdraw(t_ns)
        else:
            self._height_m = self._near_m
            if self._spec.gap_m is not None:
                self._height_m = min(self._near_m * max(1.0, _SLOW_RAD / left_rad), self._room_m)

    def _left_rad(self, row: int) -> float:
        """Remaining motion [rad] of the cell `row`, given that the plan's other cells move as planned."""
        directions = self._evasion.directions(self._plan)
        motions_rad = self._goals.motions_rad(directions)
        self.truth.error_m = self._goals.error_m().tolist()
        return float(motions_rad[self._plan == row][0])

    def _usable_m(self, line: Line) -> float:
        """Usable height [m] above the cell, up to which the finger can withdraw."""
        approach_m = self._spec.approach_m
        return min(approach_m, self._finger.room_m(line, approach_m + _MARGIN_M) - _MARGIN_M)

    def _withdraw(self, t_ns: int) -> None:
        self.phase = Phase.WITHDRAW
        self._height_m = self._room_m
        if self._touch is not None:
            self._touch.end_ns = t_ns
