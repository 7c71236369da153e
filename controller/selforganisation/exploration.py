"""Interface of the exploration programs, and the point-to-point motion that they share.

They need revolute DoFs, velocity commands, position feedback and accelerations, and no model [M14, II.B].
"""

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from controller.cell_input import CellRows
from controller.selforganisation.touch_guard import TouchLimits
from controller.touch.tactile_state import COLUMNS, REACTION_COLUMNS
from skinnet.protocol.messages import Modality

__all__ = [
    "CLEARANCE",
    "MIN_SCALE",
    "Exploration",
    "MotionState",
    "PointToPoint",
    "PositionControl",
    "add_readings",
    "steps_with_room",
]

MIN_SCALE = 0.5
"""Fraction of a step or sine below which it tells too little, and is not made; an assumption."""
CLEARANCE = 0.1
"""Clearance from the joint limits, for overshoot, as a fraction of the reach of the motion; an assumption."""


class Exploration(Protocol):
    """Exploration program: a state machine without I/O, ticked by a control loop until it is done."""

    @property
    def done(self) -> bool:
        """True once the program is complete and its result available."""

    @property
    def needs_stream(self) -> bool:
        """True while the accelerations of all cells are needed."""

    @property
    def progress(self) -> float:
        """Completed fraction of the program, 0 to 1."""

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""

    def add_samples(
        self, cells: NDArray[np.int64], t_sampled_ns: NDArray[np.int64], acceleration_g: NDArray[np.float64]
    ) -> None:
        """Add accelerations (n, 3) of cells (n,) [g, cell frames], with their sampling times (n,)."""

    def add_touch(self, cells: NDArray[np.int64], touch: NDArray[np.float64]) -> None:
        """Add touch readings (n, 4) of cells (n,), three of force and one of proximity: they stop motions."""


@dataclass(frozen=True, eq=False)
class PositionControl:
    """Point-to-point position control of all DoFs; the numbers without a source are assumptions."""

    speed_rad_s: float = 0.4
    tolerance_rad: float = 1e-3
    """Distance from the target within which a DoF counts as arrived, and peak-to-peak motion within which it
    counts as still throughout a measurement."""
    rest_ns: int = 200_000_000
    """Time [ns] over which rest is judged: a swing of 2 Hz does not look like rest where it turns."""
    rest_rad: float = 2e-4
    """Peak-to-peak motion over `rest_ns` below which a DoF is at rest: 1 mrad/s."""
    delay_ns: int = 10_000_000
    """Time [ns] from a command to the first feedback of its effect; rest is judged after it."""
    range_rad: NDArray[np.float64] | None = None
    """Position limits (D, 2), infinite for a DoF without; None if they are not known."""
    touch: TouchLimits = field(default_factory=TouchLimits)
    """Readings that stop a motion."""

    def room_rad(self, dof: int, home_rad: NDArray[np.float64]) -> tuple[float, float]:
        """Return the lowest and the highest position of DoF `dof` within its limits, from home (D,)."""
        if self.range_rad is None:
            return -math.inf, math.inf
        lowest_rad, highest_rad = (self.range_rad[dof] - home_rad[dof]).tolist()
        return lowest_rad, highest_rad


class MotionState(Enum):
    """State of a point-to-point motion."""

    MOVING = auto()
    SETTLING = auto()
    ARRIVED = auto()
    STUCK = auto()


class PointToPoint:
    """Point-to-point motion of all DoFs by velocity commands, with feedback between measured rests only.

    Servos integrate velocity commands, so a displacement is commanded open loop, and what remains of the
    distance at the next measured rest is commanded again. That is a sampled loop whose plant has the static
    gain of a servo, one, whatever its dynamics: it cannot oscillate on any servo that comes to rest by
    itself. A loop that is closed at every tick can: on the servo ω²/(s² + 2ζωs + ω²) a position gain K is
    stable only for K < 2ζω = kv/M (Routh–Hurwitz), less with a delay, and no controller without a model
    knows the inertia M.
    """

    def __init__(self, config: PositionControl, n_dofs: int) -> None:
        """Start settled, D = `n_dofs`, with the first measured positions as the target."""
        self.state = MotionState.SETTLING
        self._config = config
        self._target_rad: NDArray[np.float64] | None = None
        self._way_rad = np.zeros(n_dofs)
        self._ticks_left = 0
        self._last_error_rad = np.inf
        self._t_commanded_ns: int | None = None
        self._history: deque[tuple[int, NDArray[np.float64]]] = deque()

    @property
    def target_rad(self) -> NDArray[np.float64]:
        """Target (D,) of the motion.

        Raises:
            RuntimeError: no position was measured yet.
        """
        if self._target_rad is None:
            raise RuntimeError("the motion has no target before the first tick")
        return self._target_rad

    @property
    def last_command_ns(self) -> int:
        """Time [ns] at which the last command that was not zero ended; 0 before the first."""
        return self._t_commanded_ns or 0

    def behind(self, position_rad: NDArray[np.float64]) -> NDArray[np.int64]:
        """Find the DoFs whose positions (D,) are off the target."""
        return np.flatnonzero(np.abs(self.target_rad - position_rad) > self._config.tolerance_rad)

    def restless(self) -> NDArray[np.int64]:
        """Find the DoFs that keep the others from being measured: all that swing, at least the widest."""
        swing_rad = self.swing_rad()
        wide = swing_rad > self._config.rest_rad
        return np.flatnonzero(wide) if wide.any() else np.array([np.argmax(swing_rad)])

    def begin(self, target_rad: NDArray[np.float64]) -> None:
        """Begin the motion to a new target (D,), from what was commanded so far."""
        commanded_rad = self.target_rad
        if self.state is MotionState.MOVING:
            commanded_rad = commanded_rad - self._way_rad
        self._plan(target_rad - commanded_rad)
        self._target_rad = target_rad.copy()
        self._last_error_rad = np.inf

    def retarget(self, target_rad: NDArray[np.float64]) -> None:
        """Set a new target (D,) without a motion towards it, where a DoF stays behind."""
        self._target_rad = target_rad.copy()

    def settle(self) -> None:
        """Wait for the next rest and correct what is left there; after motion by others."""
        self._plan(np.zeros_like(self._way_rad))
        self._last_error_rad = np.inf

    def velocity(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the velocity (D,) [rad/s] at `t_ns`, from the measured positions (D,).

        Called at every tick, also while it returns zeros: it measures whether the DoFs are at rest.
        """
        if self._target_rad is None:
            self._target_rad = position_rad.astype(np.float64)
        period_ns = t_ns - self._history[-1][0] if self._history else 0
        self._record(t_ns, position_rad)
        if self.state is MotionState.SETTLING and self.at_rest(t_ns):
            self._correct(position_rad)
        if self.state is not MotionState.MOVING or period_ns <= 0:
            return np.zeros_like(self._way_rad)
        return self._advance(t_ns, period_ns * 1e-9)

    def at_rest(self, t_ns: int) -> bool:
        """Test that all DoFs have been at rest, since the last command took effect."""
        config = self._config
        since_ns = self._history[0][0]
        if self._t_commanded_ns is not None:
            since_ns = max(since_ns, self._t_commanded_ns + config.delay_ns)
        return t_ns - since_ns >= config.rest_ns and not (self.swing_rad() > config.rest_rad).any()

    def swing_rad(self) -> NDArray[np.float64]:
        """Peak-to-peak motion (D,) over the time in which rest is judged."""
        swing_rad: NDArray[np.float64] = np.ptp([position_rad for _, position_rad in self._history], axis=0)
        return swing_rad

    def _record(self, t_ns: int, position_rad: NDArray[np.float64]) -> None:
        self._history.append((t_ns, position_rad.astype(np.float64)))
        while t_ns - self._history[0][0] > self._config.rest_ns:
            self._history.popleft()

    def _plan(self, way_rad: NDArray[np.float64]) -> None:
        self._way_rad, self._ticks_left = way_rad, 0
        self.state = MotionState.MOVING if way_rad.any() else MotionState.SETTLING

    def _advance(self, t_ns: int, period_s: float) -> NDArray[np.float64]:
        """Return the velocity of this tick, all of equal length over the least number of ticks."""
        if self._ticks_left == 0:
            duration_s = np.abs(self._way_rad).max() / self._config.speed_rad_s
            self._ticks_left = max(1, math.ceil(duration_s / period_s - 1e-9))
        velocity: NDArray[np.float64] = self._way_rad / (self._ticks_left * period_s)
        self._way_rad = self._way_rad - velocity * period_s
        self._ticks_left -= 1
        self._t_commanded_ns = t_ns + round(period_s * 1e9)
        if self._ticks_left == 0:
            self.state = MotionState.SETTLING
        return velocity

    def _correct(self, position_rad: NDArray[np.float64]) -> None:
        """Command what is left of the distance at rest, as long as that has halved the largest error."""
        error_rad = self.target_rad - position_rad
        largest_rad = float(np.abs(error_rad).max(initial=0.0))
        if largest_rad <= self._config.tolerance_rad:
            self.state = MotionState.ARRIVED
        elif largest_rad > 0.5 * self._last_error_rad:
            self.state = MotionState.STUCK
        else:
            self._last_error_rad = largest_rad
            self._plan(error_rad)


def add_readings(program: Exploration, stream: CellRows) -> None:
    """Add the full readings of a tick to a program."""
    values = stream.rows["values"].astype(np.float64)
    program.add_samples(stream.cell, stream.rows["t_sampled_ns"], values[:, COLUMNS[Modality.ACCELERATION]])
    program.add_touch(stream.cell, values[:, REACTION_COLUMNS])


def steps_with_room(step_rad: float, lowest_rad: float, highest_rad: float) -> list[float]:
    """Find the steps, upwards and downwards, that limits `lowest_rad` and `highest_rad` from home leave.

    Returns:
        The longer one first, upwards if they are alike; shorter near a limit, down to half of `step_rad`.
    """
    clearance_rad = CLEARANCE * step_rad
    up_rad = min(step_rad, highest_rad - clearance_rad)
    down_rad = min(step_rad, -lowest_rad - clearance_rad)
    least_rad = MIN_SCALE * step_rad
    steps_rad = [sign * rad for sign, rad in ((1.0, up_rad), (-1.0, down_rad)) if rad >= least_rad]
    return sorted(steps_rad, key=abs, reverse=True)
