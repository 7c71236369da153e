"""Exploration of the sensory-motor map: the motion program whose deflections `sensory_motor_map` weighs."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.exploration import Hold
from controller.selforganisation.lock_in import LockIn
from controller.selforganisation.structure import named

__all__ = ["Deflections", "MapExploration", "MapExplorationConfig"]

STANDARD_GRAVITY_M_S2 = 9.80665
"""One g (CGPM, 1901)."""


@dataclass(frozen=True)
class MapExplorationConfig:
    """The velocity sine of one DoF after the other; 0.3 rad/s at 4 Hz tells 99 % of the signs [meas].

    Below √(g/r)/2π gravity tilt beats inertia at the lever arm r; far above, the servo lag eats the motion.
    Periods, ramps and limits are assumptions.
    """

    amplitude_rad_s: float = 0.3
    frequency_hz: float = 4.0
    periods: int = 4
    """Measured, at full amplitude."""
    ramp_periods: int = 1
    """For fading in before, and out after."""
    settle_ns: int = 250_000_000
    hold: Hold = field(default_factory=Hold)
    min_samples: int = 25
    """A cell with fewer samples of a sine counts as not measured; 250 are due at 250 Hz in 1 s."""
    min_motion: float = 0.2
    """A DoF that moves by less than this share of its command counts as not moved."""


@dataclass(frozen=True, eq=False)
class Deflections:
    """What one exploration found, in one pose."""

    pose_rad: NDArray[np.float64]
    """(D,): where the map was explored."""
    deflection_m: NDArray[np.float64]
    """(S, D, 3): acceleration along the axes of a cell per joint acceleration [m/s² per rad/s²], in phase.

    Zero where it was not measured.
    """
    problems: tuple[str, ...]
    """What was not measured, one line each."""


class MapExploration:
    """Plays a velocity sine on one DoF after the other and measures what the cells feel of it [M14, III.B].

    The envelope of the sine is symmetric over a whole number of periods: velocity and acceleration begin and
    end at zero, and the position comes back to where it was; what the servo leaves is held away in between.

    A deflection is the part of a cell's acceleration that is in phase with the *measured* joint acceleration,
    so that servo lag, servo gain and whatever is a quarter period off drop out. Centripetal acceleration, at
    twice the frequency, drops out too. Two things are not compensated. Gravity tilt is in phase with −q̈ and
    adds −G·g/(2πf)² to the row J of the Jacobian, G being the change of 'up' in the cell's frame per radian:
    at 4 Hz like a lever arm of up to 16 mm, at 8 Hz of 4 mm. And the other joints are taken to be at rest.
    """

    def __init__(self, config: MapExplorationConfig, n_dofs: int, n_cells: int, start_ns: int) -> None:
        """Starts at `start_ns`: D = `n_dofs`, S = `n_cells`."""
        self._config = config
        self._n_dofs, self._n_cells = n_dofs, n_cells
        self._ramp_ns = round(1e9 * config.ramp_periods / config.frequency_hz)
        self._sine_ns = round(1e9 * config.periods / config.frequency_hz) + 2 * self._ramp_ns
        self._phase_start_ns = start_ns
        self._window_ns = (start_ns, start_ns)
        self._dof = -1
        self._playing = self._done = False
        self._home_rad = np.zeros(0)
        self._deflection_m = np.zeros((n_cells, n_dofs, 3))
        self._problems: list[str] = []
        self._clear()

    @property
    def done(self) -> bool:
        """All DoFs were played and are back."""
        return self._done

    @property
    def wants_stream(self) -> bool:
        """The accelerations of all cells are needed now."""
        return not self._done

    @property
    def progress(self) -> float:
        """Share of the program that is done, 0 to 1."""
        return 1.0 if self._done else (self._dof + 1) / (self._n_dofs + 1)

    @cached_property
    def result(self) -> Deflections:
        """What was found.

        Raises:
            RuntimeError: the program is not done.
        """
        if not self._done:
            raise RuntimeError("the exploration of the sensory-motor map is not done; wait for `done`")
        return Deflections(self._home_rad, self._deflection_m, tuple(self._problems))

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""
        if not len(self._home_rad):
            self._home_rad = position_rad.astype(np.float64)
        self._advance(t_ns)
        if self._done:
            return np.zeros(self._n_dofs)
        if not self._playing:
            return self._config.hold.velocity(self._home_rad, position_rad)
        velocity = np.zeros(self._n_dofs)
        velocity[self._dof] = self._sine((t_ns - self._phase_start_ns) * 1e-9)
        return velocity

    def add_positions(self, t_measured_ns: int, position_rad: NDArray[np.float64]) -> None:
        """Takes in the joint positions (D,) measured at `t_measured_ns`: the reference of phase and size."""
        if self._window_ns[0] <= t_measured_ns < self._window_ns[1]:
            t_s = np.array([t_measured_ns - self._window_ns[0]]) * 1e-9
            shift_rad = position_rad[self._dof] - self._home_rad[self._dof]
            self._joint.add(np.zeros(1, dtype=np.int64), t_s, np.array([[shift_rad]]))

    def add_samples(
        self, cells: NDArray[np.int64], t_sampled_ns: NDArray[np.int64], acceleration_g: NDArray[np.float64]
    ) -> None:
        """Takes in accelerations (n, 3) of cells (n,) [g, cell frames], with their sample times (n,).

        The window of a sine stays open until the next sine begins: what comes late is not lost.
        """
        begin_ns, end_ns = self._window_ns
        inside = (t_sampled_ns >= begin_ns) & (t_sampled_ns < end_ns)
        t_s = (t_sampled_ns[inside] - begin_ns) / 1e9
        self._cells.add(cells[inside], t_s, acceleration_g[inside])

    def _advance(self, t_ns: int) -> None:
        """Goes on from holding to the next sine, or from a sine to holding, when it is time."""
        elapsed_ns = t_ns - self._phase_start_ns
        if self._playing and elapsed_ns >= self._sine_ns:
            self._playing = False
            self._phase_start_ns = t_ns
        elif not (self._playing or self._done) and elapsed_ns >= self._config.settle_ns:
            if self._dof >= 0:
                self._collect()
            self._dof += 1
            self._playing = self._dof < self._n_dofs
            self._done = not self._playing
            self._phase_start_ns = t_ns
            measured_ns = self._sine_ns - 2 * self._ramp_ns if self._playing else 0
            self._window_ns = (t_ns + self._ramp_ns, t_ns + self._ramp_ns + measured_ns)
            self._clear()

    def _sine(self, t_s: float) -> float:
        """Velocity [rad/s] at `t_s` after the beginning of the sine."""
        to_end_s = min(t_s, self._sine_ns * 1e-9 - t_s)
        ramp_s = self._ramp_ns * 1e-9
        fade = 0.5 - 0.5 * math.cos(math.pi * to_end_s / ramp_s) if to_end_s < ramp_s else 1.0
        return self._config.amplitude_rad_s * fade * math.sin(2.0 * math.pi * self._config.frequency_hz * t_s)

    def _clear(self) -> None:
        self._cells = LockIn(self._n_cells, 3, self._config.frequency_hz)
        self._joint = LockIn(1, 1, self._config.frequency_hz)

    def _collect(self) -> None:
        """Reduces the sine of the present DoF to its deflections."""
        config, dof = self._config, self._dof
        angular_hz = 2.0 * math.pi * config.frequency_hz
        motion_rad = complex(self._joint.amplitude(config.min_samples)[0, 0])
        if not abs(motion_rad) >= config.min_motion * config.amplitude_rad_s / angular_hz:
            self._problems.append(f"DoF {dof} did not follow its sine")
            return
        per_acceleration = self._cells.amplitude(config.min_samples) / (-(angular_hz**2) * motion_rad)
        deflection_m = STANDARD_GRAVITY_M_S2 * per_acceleration.real
        blind = np.isnan(deflection_m).any(axis=1)
        if blind.any():
            self._problems.append(f"DoF {dof}: {named('cell', np.flatnonzero(blind))} with too few samples")
        self._deflection_m[~blind, dof] = deflection_m[~blind]
