"""Touch task: the finger approaches a cell, holds a depth or a force, and withdraws."""

from skinnet.body.ground_truth.teaching_outcome import TouchGroundTruth
from skinnet.body.teacher.finger import ApproachLine, ContactTarget, Finger
from skinnet.body.teacher.finger_task import FingerPhase, FingerTask
from skinnet.clock import NS_PER_S
from skinnet.deployment.environment.teacher import TouchSpec
from skinnet.pinned_linalg import dot

__all__ = ["Touch"]

_INTEGRAL_GAIN_M_S = 0.08
"""Integral gain [m/s] of force control: finger speed at a relative force error of 1 (assumed).

A sphere in foam has F ∝ depth², hence a time constant of depth / (2 × gain): 30 ms at 5 mm.
"""
_FORCE_TOLERANCE = 0.02
"""Relative tolerance within which a force counts as reached."""


class Touch(FingerTask):
    """Touch task of the teacher's script.

    A touch by force controls the force on the targeted force cell, or the total force on the finger
    when it targets the centre of a cell.

    Attributes:
        ground_truth: Ground truth of the touch.
    """

    def __init__(
        self,
        finger: Finger,
        spec: TouchSpec,
        target: ContactTarget,
        ground_truth: TouchGroundTruth,
        foam_thickness_m: float,
    ) -> None:
        """Place the finger above `target`, on foam of thickness `foam_thickness_m` [m]."""
        super().__init__(finger, ground_truth)
        self.ground_truth = ground_truth
        self._spec, self._target = spec, target
        self._min_height_m = -foam_thickness_m
        self._height_m = spec.approach_m
        self._contact_line: ApproachLine | None = None
        self._before_n = finger.skin_force_n()
        self._line = finger.approach_line(target)
        finger.place(self._line, self._height_m)

    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""
        spec, finger, step_s = self._spec, self._finger, step_ns / NS_PER_S
        target_n, line = self._target_force_n(), finger.approach_line(self._target)
        self._record(t_ns, step_s, target_n, line)
        if self.phase is FingerPhase.WITHDRAW:
            if self._raise(spec, step_s):
                self._finish(t_ns)
                return
        else:
            self._advance(target_n, t_ns, step_s)
        if spec.force_n is not None:  # a touch by force tracks the moving cell
            self._line = line
        finger.move(self._line, self._height_m, step_s)

    def _record(self, t_ns: int, step_s: float, target_n: float, line: ApproachLine) -> None:
        """Record forces at `t_ns` [ns], and the way of the cell, now at `line`, since the contact."""
        truth, finger = self.ground_truth, self._finger
        truth.record(t_ns, step_s, finger.force_n(), target_n)
        if self.phase is FingerPhase.HOLD:
            felt_n = dot(finger.skin_force_n() - self._before_n, self._line.normal)
            truth.record_hold(target_n, felt_n, finger.force_along_n(self._line))
        if truth.contact_ns is None or self.phase is FingerPhase.WITHDRAW:
            return
        if self._contact_line is None:
            self._contact_line = line
        truth.evaded_m = dot(self._contact_line.point_m - line.point_m, self._contact_line.normal)

    def record_motion_onset(self) -> None:
        """Record the gap to the target, where it is now, at the first motion of the robot in this touch."""
        if self.ground_truth.onset_gap_m is None:
            line = self._finger.approach_line(self._target)
            self.ground_truth.onset_gap_m = self._finger.height_m(line)

    def _advance(self, target_force_n: float, t_ns: int, step_s: float) -> None:
        """Advance approach or hold by one step of `step_s` [s]."""
        spec = self._spec
        if spec.force_n is not None:
            error = 1.0 - target_force_n / spec.force_n
            inward_m_s = min(max(_INTEGRAL_GAIN_M_S * error, -spec.speed_m_s), spec.speed_m_s)
            self._height_m = max(self._height_m - inward_m_s * step_s, self._min_height_m)
            there = abs(error) <= _FORCE_TOLERANCE or self._height_m <= self._min_height_m
        else:
            assert spec.depth_m is not None
            there = self._lower(spec, spec.depth_m, step_s)
        truth = self.ground_truth
        if self.phase is FingerPhase.APPROACH and there:
            truth.hold_ns = t_ns
            self._enter(FingerPhase.HOLD)
        if truth.hold_ns is not None and t_ns >= truth.hold_ns + round(spec.hold_s * NS_PER_S):
            self._enter(FingerPhase.WITHDRAW)

    def _target_force_n(self) -> float:
        """Normal force [N] on the target: a force cell, or the finger."""
        if self._spec.force_cell is None:
            return self._finger.foam_force_n()
        return self._finger.force_on_cell_n(self._target.row, self._spec.force_cell)
