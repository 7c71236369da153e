"""Sensory-motor map exploration: the motion program that measures cell deflections [M14, III.B]."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.deflections import Deflections
from controller.selforganisation.exploration import MotionState, PointToPoint, PositionControl
from controller.selforganisation.kinematic_structure import format_members
from controller.selforganisation.lock_in import LockIn
from controller.selforganisation.touch_guard import TouchGuard
from controller.selforganisation.velocity_sine import SinePlace, VelocitySine
from skinnet import pinned_math

__all__ = ["MapExploration", "MapExplorationConfig"]

_TENTH, _DEVIATIONS_PER_TENTH = 0.1, 7.9580
"""Quantile of the size of normal noise, and the standard deviation per its value."""
STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard gravity (CGPM, 1901)."""


@dataclass(frozen=True)
class MapExplorationConfig:
    """Velocity sine applied to each DoF in turn; 0.3 rad/s at 4 Hz gives 99 % of the signs [meas].

    Below √(g/r)/2π gravity tilt exceeds inertia at the lever arm r; far above, the servo lag attenuates the
    motion. Periods, ramps and limits are assumptions.
    """

    amplitude_rad_s: float = 0.3
    frequency_hz: float = 4.0
    periods: int = 4
    """Number of measured periods, at full amplitude."""
    tilt_frequency_hz: float | None = None
    """Frequency of a second sine, by which gravity tilt is told from inertia; None: the tilt stays."""
    ramp_periods: int = 1
    """Number of periods of each ramp, before and after."""
    settle_ns: int = 250_000_000
    position_control: PositionControl = field(default_factory=PositionControl)
    rest_timeout_ns: int = 5_000_000_000
    """Time [ns] after which DoFs that do not come to rest are reported, and the next sine begins."""
    min_samples: int = 25
    """Samples per sine below which a cell counts as not measured; 250 are due at 250 Hz in 1 s."""
    min_motion_fraction: float = 0.2
    """Fraction of the commanded amplitude below which a DoF counts as not moved."""


class MapExploration:
    """Exploration program: applies a velocity sine to each DoF in turn and measures deflections [M14, III.B].

    What is left of a sine at rest is corrected before the next. A sine begins off home, or is smaller, where
    limits of the DoF leave no room for it. Contact, or what comes nearer, stops it, and it is repeated
    mirrored.

    A deflection is the part of a cell's acceleration that is in phase with the *measured* joint acceleration,
    which rejects servo lag, servo gain and all quadrature components. Centripetal acceleration, at twice the
    frequency, is rejected too. Gravity tilt is in phase with −q̈ and adds −G·g/(2πf)² to the row J of the
    Jacobian, G being the change of 'up' in the cell's frame per radian: at 4 Hz like a lever arm of up to
    16 mm, at 8 Hz of 4 mm. Deflections D at two frequencies give J = (f₁² D₁ − f₂² D₂)/(f₁² − f₂²). The
    other joints are assumed to be at rest; how far they are not is in the coupling.
    """

    def __init__(
        self,
        config: MapExplorationConfig,
        n_dofs: int,
        n_cells: int,
        start_ns: int,
        *,
        dof_names: Sequence[str] = (),
        cell_names: Sequence[str] = (),
    ) -> None:
        """Start at `start_ns`, with D = `n_dofs` and S = `n_cells`; messages use the names that are given."""
        self._config = config
        self._n_dofs, self._n_cells = n_dofs, n_cells
        self._dof_names, self._cell_names = dof_names, cell_names
        self._motion = PointToPoint(config.position_control, n_dofs)
        self._sines = [
            VelocitySine(config.amplitude_rad_s, frequency_hz, config.periods, config.ramp_periods)
            for frequency_hz in (config.frequency_hz, config.tilt_frequency_hz)
            if frequency_hz is not None
        ]
        self._phase_start_ns = start_ns
        self._window_ns = (start_ns, start_ns)
        self._sine_number = -1
        self._guard = TouchGuard(n_cells, config.position_control.touch)
        self._places: list[SinePlace] = []
        """Places of the present sine that have room; the first is the one in use."""
        self._in_place = True
        """False on the way to the place of the present sine."""
        self._exciting = self._stopped = self._done = False
        self._home_rad = np.zeros(0)
        n_frequencies = len(self._sines)
        self._in_phase_m = np.zeros((n_frequencies, n_cells, n_dofs, 3))
        self._noise_m = np.zeros((n_frequencies, n_dofs))
        self._coupling = np.tile(np.eye(n_dofs), (n_frequencies, 1, 1))
        self._measured = np.zeros((n_frequencies, n_dofs), dtype=np.bool_)
        self._problems: list[str] = []
        self._reset_lock_ins()

    @property
    def done(self) -> bool:
        """True once all DoFs are excited and back at their start."""
        return self._done

    @property
    def needs_stream(self) -> bool:
        """True while the accelerations of all cells are needed."""
        return not self._done

    @property
    def progress(self) -> float:
        """Completed fraction of the program, 0 to 1."""
        return 1.0 if self._done else (self._sine_number + 1) / (self._n_sines + 1)

    @cached_property
    def result(self) -> Deflections:
        """Measured deflections.

        Raises:
            RuntimeError: the program is not done.
        """
        if not self._done:
            raise RuntimeError("map exploration is not done; wait for `done`")
        measured: NDArray[np.bool_] = np.logical_and.reduce(self._measured, axis=0)
        deflection_m, noise_m = self._in_phase_m[0], self._noise_m[0]
        if len(self._sines) > 1:
            square, tilt_square = (sine.frequency_hz * sine.frequency_hz for sine in self._sines)
            without_tilt_m = (square * deflection_m - tilt_square * self._in_phase_m[1]) / (
                square - tilt_square
            )
            is_measured = self._in_phase_m.any(axis=3)
            at_both: NDArray[np.bool_] = np.logical_and.reduce(is_measured, axis=0)
            deflection_m = np.where(at_both[:, :, None], without_tilt_m, 0.0)
            own, other = square * self._noise_m[0], tilt_square * self._noise_m[1]
            noise_m = np.sqrt(own * own + other * other) / abs(square - tilt_square)
        problems = tuple(self._problems)
        return Deflections(self._home_rad, deflection_m, self._coupling[0], measured, noise_m, problems)

    @property
    def _n_sines(self) -> int:
        return self._n_dofs * len(self._sines)

    @property
    def _dof(self) -> int:
        """DoF of the present sine, the DoFs in turn at all their frequencies."""
        return self._sine_number // len(self._sines)

    @property
    def _frequency_number(self) -> int:
        return self._sine_number % len(self._sines)

    @property
    def _sine(self) -> VelocitySine:
        return self._sines[self._frequency_number]

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""
        if not len(self._home_rad):
            self._home_rad = position_rad.astype(np.float64)
            self._motion.retarget(self._home_rad)
        if self._motion.state is MotionState.MOVING and not self._exciting:
            self._guard.rest()  # what touched at the last rest is left behind
        self._advance(t_ns)
        correction = self._motion.velocity(t_ns, position_rad)
        if self._done:
            return np.zeros(self._n_dofs)
        if not self._exciting:
            return correction
        velocity = np.zeros(self._n_dofs)
        t_s = (t_ns - self._phase_start_ns) * 1e-9
        velocity[self._dof] = self._places[0].scale * self._sine.velocity_rad_s(t_s)
        return velocity

    def add_positions(self, t_measured_ns: int, position_rad: NDArray[np.float64]) -> None:
        """Add the joint positions (D,) measured at `t_measured_ns`: the reference of phase and amplitude."""
        if self._window_ns[0] <= t_measured_ns < self._window_ns[1]:
            t_s = np.array([t_measured_ns - self._window_ns[0]]) * 1e-9
            shift_rad = position_rad - self._home_rad
            self._joints.add(np.zeros(1, dtype=np.int64), t_s, shift_rad[None])

    def add_samples(
        self, cells: NDArray[np.int64], t_sampled_ns: NDArray[np.int64], acceleration_g: NDArray[np.float64]
    ) -> None:
        """Add accelerations (n, 3) of cells (n,) [g, cell frames], with their sampling times (n,).

        The window of a sine stays open until the next sine begins, for samples that arrive late.
        """
        begin_ns, end_ns = self._window_ns
        inside = (t_sampled_ns >= begin_ns) & (t_sampled_ns < end_ns)
        t_s = (t_sampled_ns[inside] - begin_ns) / 1e9
        self._cells.add(cells[inside], t_s, acceleration_g[inside])

    def add_touch(self, cells: NDArray[np.int64], touch: NDArray[np.float64]) -> None:
        """Add touch readings (n, 4) of cells (n,), three of force and one of proximity."""
        self._guard.add(cells, touch)

    def _advance(self, t_ns: int) -> None:
        """Switch between holding and sine at their ends."""
        elapsed_ns = t_ns - self._phase_start_ns
        if self._exciting:
            self._stopped = self._guard.cells.size > 0
            if self._stopped or elapsed_ns >= self._sine.duration_ns:
                self._exciting = False
                self._phase_start_ns = t_ns
                self._guard.rest()
                self._motion.settle()
        elif not self._done and self._has_settled(elapsed_ns):
            if not self._in_place:
                self._begin(t_ns)
            elif self._stopped:
                self._repeat_mirrored(t_ns)
            else:
                if self._sine_number >= 0:
                    self._reduce_to_deflections()
                self._next_sine(t_ns)

    def _repeat_mirrored(self, t_ns: int) -> None:
        """Repeat a sine that a cell has stopped to the other side, if it has room; else go on to the next."""
        del self._places[0]
        if self._places:
            self._go_to_place(t_ns)
            return
        self._problems.append(
            f"{self._dof_text([self._dof])} did not complete its sine: something touched or came near "
            f"{format_members('cell', self._guard.cells, self._cell_names)}"
        )
        self._next_sine(t_ns)

    def _next_sine(self, t_ns: int) -> None:
        """Go to the place of the next sine that has room within the limits; home after the last."""
        self._sine_number += 1
        while self._sine_number < self._n_sines:
            room_rad = self._config.position_control.room_rad(self._dof, self._home_rad)
            self._places = self._sine.places(*room_rad)
            if self._places:
                break
            self._problems.append(
                f"{self._dof_text([self._dof])} was not moved: its limits leave no room for its sine of "
                f"{self._sine.frequency_hz} Hz"
            )
            self._sine_number += 1
        self._go_to_place(t_ns)

    def _go_to_place(self, t_ns: int) -> None:
        """Go to where the sine begins, or home after the last; begin it at once if it is there."""
        target_rad = self._home_rad.copy()
        if self._sine_number < self._n_sines:
            target_rad[self._dof] += self._places[0].offset_rad
        self._in_place = bool((target_rad == self._motion.target_rad).all())
        if self._in_place:
            self._begin(t_ns)
        else:
            self._phase_start_ns = t_ns
            self._window_ns = (t_ns, t_ns)
            self._motion.begin(target_rad)

    def _begin(self, t_ns: int) -> None:
        """Begin the sine; end after the last."""
        self._in_place = True
        self._done = self._sine_number >= self._n_sines
        self._window_ns = (t_ns, t_ns)
        if not self._done:
            self._excite(t_ns)

    def _excite(self, t_ns: int) -> None:
        self._exciting = True
        self._phase_start_ns = t_ns
        begin_ns = t_ns + self._sine.ramp_ns
        self._window_ns = (begin_ns, begin_ns + self._sine.full_ns)
        self._reset_lock_ins()
        self._guard.arm()

    def _has_settled(self, elapsed_ns: int) -> bool:
        """Return True once the settling time is over with all DoFs at rest; report those that do not rest."""
        config, motion = self._config, self._motion
        if elapsed_ns < config.settle_ns:
            return False
        if motion.state in (MotionState.ARRIVED, MotionState.STUCK):
            return True
        if elapsed_ns < config.rest_timeout_ns:
            return False
        is_next = self._in_place and not (self._stopped and len(self._places) > 1)
        following = self._sine_number + is_next
        if following < self._n_sines:
            following_dof = following // len(self._sines)
            before = f"before the sine of {self._dof_text([following_dof])}"
        else:
            before = "after the last sine"
        self._problems.append(f"{self._dof_text(motion.restless())} did not come to rest {before}")
        return True

    def _dof_text(self, dofs: Sequence[int] | NDArray[np.int64]) -> str:
        return format_members("DoF", dofs, self._dof_names)

    def _reset_lock_ins(self) -> None:
        self._cells = LockIn(self._n_cells, 3, self._sine.frequency_hz)
        self._joints = LockIn(1, self._n_dofs, self._sine.frequency_hz)

    def _reduce_to_deflections(self) -> None:
        """Reduce the samples of the current DoF to its deflections."""
        config, number, dof = self._config, self._frequency_number, self._dof
        angular_hz = 2.0 * math.pi * self._sine.frequency_hz
        motions_rad = self._joints.amplitude(config.min_samples)[0]
        motion_rad = complex(motions_rad[dof])
        length_rad = pinned_math.hypot(motion_rad.real, motion_rad.imag)
        wanted_rad = abs(self._places[0].scale) * config.amplitude_rad_s / angular_hz
        if not length_rad >= config.min_motion_fraction * wanted_rad:
            self._problems.append(
                f"{self._dof_text([dof])} did not follow its sine: its amplitude is below the minimum "
                "fraction of the command"
            )
            return
        self._measured[number, dof] = True
        in_phase = motions_rad.real * motion_rad.real + motions_rad.imag * motion_rad.imag
        self._coupling[number, :, dof] = in_phase / (length_rad * length_rad)
        # the real part of amplitude / (−ω² motion), in real numbers: complex division depends on the CPU
        amplitude = self._cells.amplitude(config.min_samples)
        along = amplitude.real * motion_rad.real + amplitude.imag * motion_rad.imag
        acceleration = angular_hz * angular_hz * length_rad * length_rad
        deflection_m = STANDARD_GRAVITY_M_S2 * (along / -acceleration)
        blind = np.isnan(deflection_m).any(axis=1)
        if blind.any():
            self._problems.append(
                f"{self._dof_text([dof])}: "
                f"{format_members('cell', np.flatnonzero(blind), self._cell_names)} with too few samples"
            )
        self._in_phase_m[number, ~blind, dof] = deflection_m[~blind]
        # what rests has noise alone out of phase with the joint; what moves may have reactions of others, too
        across = amplitude.imag * motion_rad.real - amplitude.real * motion_rad.imag
        quadrature_m = np.abs(STANDARD_GRAVITY_M_S2 * (across[~blind] / acceleration))
        if quadrature_m.size:
            self._noise_m[number, dof] = _DEVIATIONS_PER_TENTH * np.quantile(quadrature_m, _TENTH)
