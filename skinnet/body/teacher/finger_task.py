"""Finger task: the common course of touches, strokes and lessons, as a state machine of motion phases."""

from abc import ABC, abstractmethod
from enum import Enum
from typing import Protocol

from skinnet.body.teacher.finger import Finger

__all__ = ["TRANSITIONS", "FingerPhase", "FingerTask"]


class FingerPhase(Enum):
    """Motion phase of the finger."""

    PARKED = "parked"
    APPROACH = "approach"
    HOLD = "hold"
    WITHDRAW = "withdraw"


TRANSITIONS = {
    FingerPhase.APPROACH: (FingerPhase.HOLD, FingerPhase.WITHDRAW, FingerPhase.PARKED),
    FingerPhase.HOLD: (FingerPhase.WITHDRAW,),
    FingerPhase.WITHDRAW: (FingerPhase.APPROACH, FingerPhase.PARKED),
    FingerPhase.PARKED: (),
}
"""Transition table of a task: the phases that may follow each; PARKED is final."""


class _TaskOutcome(Protocol):
    """Ground truth of a task (protocol): `end_ns` is set when the finger is parked [ns]."""

    end_ns: int | None


class _VerticalMotion(Protocol):
    """Specification of a motion along the normal (protocol)."""

    @property
    def approach_m(self) -> float:
        """Height [m] above the skin at which the finger appears."""

    @property
    def speed_m_s(self) -> float:
        """Speed [m/s] along the normal."""


class FingerTask(ABC):
    """Task of the teacher's finger, from its appearance to its removal.

    Attributes:
        phase: Motion phase of the finger.
    """

    def __init__(self, finger: Finger, outcome: _TaskOutcome) -> None:
        """Begin the approach of `finger`; the end of the task is recorded in `outcome`."""
        self.phase = FingerPhase.APPROACH
        self._finger = finger
        self._outcome = outcome
        self._height_m = 0.0

    @property
    def finished(self) -> bool:
        """True once the finger is parked; the next task may begin."""
        return self.phase is FingerPhase.PARKED

    @abstractmethod
    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""

    def abort(self, t_ns: int) -> None:
        """Abort the task at `t_ns` [ns], the end of its stage: the finger withdraws."""
        self._enter(FingerPhase.WITHDRAW)

    def _enter(self, phase: FingerPhase) -> None:
        """Enter a phase; one that may not follow is a bug of ours."""
        assert phase is self.phase or phase in TRANSITIONS[self.phase], f"{phase} after {self.phase}"
        self.phase = phase

    def _finish(self, t_ns: int) -> None:
        """End the task at `t_ns` [ns] and park the finger."""
        self._outcome.end_ns = t_ns
        self._enter(FingerPhase.PARKED)
        self._finger.park()

    def _lower(self, spec: _VerticalMotion, depth_m: float, step_s: float) -> bool:
        """Lower the finger by one step; return True at the depth `depth_m` [m]."""
        self._height_m = max(self._height_m - spec.speed_m_s * step_s, -depth_m)
        return self._height_m <= -depth_m

    def _raise(self, spec: _VerticalMotion, step_s: float) -> bool:
        """Raise the finger by one step; return True at the height where its approach began."""
        self._height_m += spec.speed_m_s * step_s
        return self._height_m >= spec.approach_m
