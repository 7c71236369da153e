"""Object stand: a lift that presents an object, lowers away once it is grasped, and returns."""

import math
from enum import Enum, auto

import mujoco

from skinnet.body.added_elements import added_id
from skinnet.body.environment.stand_model import STAND
from skinnet.deployment.environment.stand import StandSpec

__all__ = ["TRANSITIONS", "HeightTrajectory", "Stand", "StandEvent", "StandPhase"]


class StandPhase(Enum):
    """State of the stand: at rest or moving."""

    WAITING = "below"
    RISING = "rising"
    PRESENTED = "up"
    LOWERING = "lowering"
    LOWERED = "away"
    RETURNING = "returning"
    RETURNED = "back"


class StandEvent(Enum):
    """Event that moves the stand to another phase."""

    PRESENT = auto()
    LOWER = auto()
    RETURN = auto()
    ARRIVED = auto()


TRANSITIONS = {
    (StandPhase.WAITING, StandEvent.PRESENT): StandPhase.RISING,
    (StandPhase.RISING, StandEvent.ARRIVED): StandPhase.PRESENTED,
    (StandPhase.PRESENTED, StandEvent.LOWER): StandPhase.LOWERING,
    (StandPhase.LOWERING, StandEvent.ARRIVED): StandPhase.LOWERED,
    (StandPhase.LOWERING, StandEvent.RETURN): StandPhase.RETURNING,
    (StandPhase.LOWERED, StandEvent.RETURN): StandPhase.RETURNING,
    (StandPhase.RETURNING, StandEvent.ARRIVED): StandPhase.RETURNED,
}
"""Transition table of the stand; BACK is final."""


class HeightTrajectory:
    """Trajectory generator for a height, with bounded speed and acceleration; the target may change any time.

    Attributes:
        height_m: Present height [m].
        speed_m_s: Present vertical speed, upwards positive [m/s].
        target_m: Target height [m].
    """

    def __init__(self, limit_m_s: float, acceleration_m_s2: float) -> None:
        """Initialise the trajectory at rest at height 0."""
        self.height_m = self.speed_m_s = self.target_m = 0.0
        self._limit_m_s, self._acceleration_m_s2 = limit_m_s, acceleration_m_s2

    def step(self, step_s: float) -> bool:
        """Advance by `step_s` [s], time-optimal within the limits; return True on arrival at the target."""
        way_m = self.target_m - self.height_m
        if way_m == 0.0 and self.speed_m_s == 0.0:
            return False
        change_m_s = self._acceleration_m_s2 * step_s
        if abs(way_m) <= change_m_s * step_s and abs(self.speed_m_s) <= 2.0 * change_m_s:
            self.height_m, self.speed_m_s = self.target_m, 0.0
            return True
        # The largest v with v² / 2 + v a Δt / 2 ≤ a × way: braking by a Δt a step then ends at the target.
        brakes_m_s = math.sqrt(0.25 * change_m_s * change_m_s + 2.0 * self._acceleration_m_s2 * abs(way_m))
        wanted_m_s = math.copysign(min(self._limit_m_s, brakes_m_s - 0.5 * change_m_s), way_m)
        self.speed_m_s += min(max(wanted_m_s - self.speed_m_s, -change_m_s), change_m_s)
        self.height_m += self.speed_m_s * step_s
        return False


class Stand:
    """Motion of the stand, driven by the stages of the controller's program.

    Its joint motion is prescribed one step ahead, with velocity and acceleration known to MuJoCo, so that
    contact carries the object without a jolt.

    Attributes:
        phase: Present phase.
        history: Each phase so far with the time of its beginning [ns].
    """

    def __init__(self, data: mujoco.MjData, spec: StandSpec) -> None:
        """Initialise the stand at its pose in the model."""
        self.phase = StandPhase.WAITING if spec.rise_m > 0.0 else StandPhase.PRESENTED
        self.history: list[tuple[int, StandPhase]] = [(0, self.phase)]
        self._trajectory = HeightTrajectory(spec.speed_m_s, spec.acceleration_m_s2)
        """Height trajectory above the start pose, at the end of the next step."""
        self._arrives_next_step = False
        self._spec, self._qpos, self._qvel, self._force_n = spec, data.qpos, data.qvel, data.qfrc_applied
        joint = data.model.joint(added_id(data.model, mujoco.mjtObj.mjOBJ_JOINT, STAND))
        self._address, self._dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._mass_kg = float(data.model.dof_M0[self._dof])
        self._due_ns: int | None = None
        """Time [ns] of the timed event that ends the present phase, if any."""

    def begin_stage(self, name: str, t_ns: int) -> None:
        """Begin stage `name` of the controller's program at `t_ns` [ns]."""
        spec = self._spec
        if self.phase is StandPhase.WAITING and name == spec.rise_stage and self._due_ns is None:
            self._due_ns = t_ns + spec.rise_delay_ns
        if self.phase in (StandPhase.RISING, StandPhase.PRESENTED):
            self._due_ns = t_ns + spec.lower_delay_ns if name == spec.lower_stage else None
        elif self.phase in (StandPhase.LOWERING, StandPhase.LOWERED) and name != spec.lower_stage:
            self.apply(StandEvent.RETURN, t_ns)

    def step(self, t_ns: int, step_s: float) -> None:
        """Step the stand to `t_ns` [ns], `step_s` [s] after the last call: set its state, apply its force."""
        self._qpos[self._address] = self._trajectory.height_m
        self._qvel[self._dof] = speed_m_s = self._trajectory.speed_m_s
        if self._arrives_next_step:
            self.apply(StandEvent.ARRIVED, t_ns)
        if self._due_ns is not None and t_ns >= self._due_ns:
            self._on_timer(t_ns)
        self._arrives_next_step = self._trajectory.step(step_s)
        self._force_n[self._dof] = self._mass_kg * (self._trajectory.speed_m_s - speed_m_s) / step_s

    def _on_timer(self, t_ns: int) -> None:
        match self.phase:
            case StandPhase.WAITING:
                self.apply(StandEvent.PRESENT, t_ns)
            case StandPhase.PRESENTED:
                self.apply(StandEvent.LOWER, t_ns)
            case StandPhase.LOWERED:
                self.apply(StandEvent.RETURN, t_ns)

    def apply(self, event: StandEvent, t_ns: int) -> None:
        """Apply the transition of `event` at `t_ns` [ns].

        Raises:
            KeyError: the table has no transition for `event` in the present phase; a bug of ours.
        """
        waits_for_hold = self.phase is StandPhase.RISING
        self.phase = TRANSITIONS[self.phase, event]
        self.history.append((t_ns, self.phase))
        if not waits_for_hold:
            self._due_ns = t_ns + self._spec.lowered_ns if self.phase is StandPhase.LOWERED else None
        up_m = self._spec.rise_m
        self._trajectory.target_m = (
            up_m - self._spec.lower_m if self.phase in (StandPhase.LOWERING, StandPhase.LOWERED) else up_m
        )
