"""The stand that presents an object, lowers away from it and comes back: the world's part in a grasp."""

import math
from enum import Enum, auto

import mujoco

from skinnet.body.things import STAND
from skinnet.deployment.stand import StandSpec

__all__ = ["MOVES", "Event", "Lift", "Phase", "Stand"]


class Phase(Enum):
    """Where the stand is or goes."""

    BELOW = "below"
    RISING = "rising"
    UP = "up"
    LOWERING = "lowering"
    AWAY = "away"
    RETURNING = "returning"
    BACK = "back"


class Event(Enum):
    """What sends it elsewhere."""

    PRESENT = auto()
    LOWER = auto()
    RETURN = auto()
    ARRIVED = auto()


MOVES = {
    (Phase.BELOW, Event.PRESENT): Phase.RISING,
    (Phase.RISING, Event.ARRIVED): Phase.UP,
    (Phase.UP, Event.LOWER): Phase.LOWERING,
    (Phase.LOWERING, Event.ARRIVED): Phase.AWAY,
    (Phase.LOWERING, Event.RETURN): Phase.RETURNING,
    (Phase.AWAY, Event.RETURN): Phase.RETURNING,
    (Phase.RETURNING, Event.ARRIVED): Phase.BACK,
}
"""All that it ever does; once back, it stays."""


class Lift:
    """A height that goes to its target with bounded speed and acceleration, and may be sent elsewhere.

    Attributes:
        height_m: Where it is.
        speed_m_s: How fast it rises.
        target_m: Where it goes.
    """

    def __init__(self, limit_m_s: float, acceleration_m_s2: float) -> None:
        """At rest at height 0."""
        self.height_m = self.speed_m_s = self.target_m = 0.0
        self._limit_m_s, self._acceleration_m_s2 = limit_m_s, acceleration_m_s2

    def step(self, step_s: float) -> bool:
        """Moves on by `step_s`, as fast as it may and can still stop; returns whether this ends its way."""
        way_m = self.target_m - self.height_m
        if way_m == 0.0 and self.speed_m_s == 0.0:
            return False
        change_m_s = self._acceleration_m_s2 * step_s
        if abs(way_m) <= change_m_s * step_s and abs(self.speed_m_s) <= 2.0 * change_m_s:
            self.height_m, self.speed_m_s = self.target_m, 0.0
            return True
        # The largest v with v² / 2 + v a Δt / 2 ≤ a × way: braking by a Δt a step then ends at the target.
        brakes_m_s = math.sqrt(0.25 * change_m_s**2 + 2.0 * self._acceleration_m_s2 * abs(way_m))
        wanted_m_s = math.copysign(min(self._limit_m_s, brakes_m_s - 0.5 * change_m_s), way_m)
        self.speed_m_s += min(max(wanted_m_s - self.speed_m_s, -change_m_s), change_m_s)
        self.height_m += self.speed_m_s * step_s
        return False


class Stand:
    """Where the stand goes and when, by the stages of the controller's program.

    Its joint is prescribed one step ahead: MuJoCo knows how it moves and accelerates, so that what stands on
    it is carried by contact without a jolt.

    Attributes:
        phase: Where it is or goes.
        history: Each phase so far with the time when it began [ns].
    """

    def __init__(self, data: mujoco.MjData, spec: StandSpec) -> None:
        """Takes the stand of a model, where the model has it."""
        self.phase = Phase.BELOW if spec.below_m > 0.0 else Phase.UP
        self.history: list[tuple[int, Phase]] = [(0, self.phase)]
        self._lift = Lift(spec.speed_m_s, spec.acceleration_m_s2)
        """Its height above where it started, at the end of the next step."""
        self._arrives = False
        self._spec, self._qpos, self._qvel, self._force_n = spec, data.qpos, data.qvel, data.qfrc_applied
        joint = data.model.joint(STAND)
        self._address, self._dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._mass_kg = float(data.model.dof_M0[self._dof])
        self._due_ns: int | None = None
        """When the event that ends the present phase comes, if a time does."""

    def begin_stage(self, name: str, t_ns: int) -> None:
        """The controller's program is in stage `name` from `t_ns` on."""
        spec = self._spec
        if self.phase is Phase.BELOW and name == spec.present_stage and self._due_ns is None:
            self._due_ns = t_ns + spec.present_ns
        if self.phase in (Phase.RISING, Phase.UP):
            self._due_ns = t_ns + spec.lower_ns if name == spec.lower_stage else None
        elif self.phase in (Phase.LOWERING, Phase.AWAY) and name != spec.lower_stage:
            self._go(Event.RETURN, t_ns)

    def step(self, t_ns: int, step_s: float) -> None:
        """It is `t_ns`, one step of `step_s` after the last call: puts it where it is, and pushes it on."""
        self._qpos[self._address] = self._lift.height_m
        self._qvel[self._dof] = speed_m_s = self._lift.speed_m_s
        if self._arrives:
            self._go(Event.ARRIVED, t_ns)
        if self._due_ns is not None and t_ns >= self._due_ns:
            self._time_is_up(t_ns)
        self._arrives = self._lift.step(step_s)
        self._force_n[self._dof] = self._mass_kg * (self._lift.speed_m_s - speed_m_s) / step_s

    def _time_is_up(self, t_ns: int) -> None:
        match self.phase:
            case Phase.BELOW:
                self._go(Event.PRESENT, t_ns)
            case Phase.UP:
                self._go(Event.LOWER, t_ns)
            case Phase.AWAY:
                self._go(Event.RETURN, t_ns)

    def _go(self, event: Event, t_ns: int) -> None:
        """The table's next phase; a `KeyError` would be a bug of ours."""
        waits_for_hold = self.phase is Phase.RISING
        self.phase = MOVES[self.phase, event]
        self.history.append((t_ns, self.phase))
        if not waits_for_hold:
            self._due_ns = t_ns + self._spec.away_ns if self.phase is Phase.AWAY else None
        up_m = self._spec.below_m
        self._lift.target_m = (
            up_m - self._spec.lower_m if self.phase in (Phase.LOWERING, Phase.AWAY) else up_m
        )
