"""Sensory-motor map exploration: the motion program that measures cell deflections [M14, III.B]."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.exploration import MotionState, PointToPoint, PositionControl
from controller.selforganisation.kinematic_structure import format_members
from controller.selforganisation.lock_in import LockIn
from skinnet import pinned_math
from skinnet.pinned_linalg import solve

__all__ = ["Deflections", "MapExploration", "MapExplorationConfig"]

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


@dataclass(frozen=True, eq=False)
class Deflections:
    """Measured deflections of all cells in one pose.

    In the sine of DoF e the in-phase acceleration is the sum over all DoFs d of deflection times motion.
    """

    pose_rad: NDArray[np.float64]
    """Explored pose (D,)."""
    deflection_m: NDArray[np.float64]
    """Deflections (S, D, 3): in-phase acceleration along cell axes per joint acceleration [m/s² per rad/s²].

    Zero where not measured.
    """
    coupling: NDArray[np.float64]
    """Motion of DoF d, in phase, per motion of the excited DoF e (D, D): one on the diagonal."""
    measured: NDArray[np.bool_]
    """DoFs (D,) that followed their sine."""
    problems: tuple[str, ...]
    """Missing measurements, one line each."""

    def lever_arms_m(self) -> NDArray[np.float64]:
        """Lever arm (S, D) [m] of every DoF at every cell, up to gravity tilt; zero where not measured.

        With the coupling C, D = J C: what a reaction torque moves belongs to the joint that yields.
        """
        n_cells, n_dofs, _ = self.deflection_m.shape
        by_sine = self.deflection_m.transpose(1, 0, 2).reshape(n_dofs, 3 * n_cells)
        by_dof = solve(self.coupling.T, by_sine).reshape(n_dofs, n_cells, 3)
        lever_m: NDArray[np.float64] = np.linalg.norm(by_dof, axis=2).T * self.measured
        return lever_m


class MapExploration:
    """Exploration program: applies a velocity sine to each DoF in turn and measures deflections [M14, III.B].

    The envelope of the sine is symmetric over a whole number of periods: velocity and acceleration begin and
    end at zero, and the position returns to its start; what is left at rest is corrected between sines.

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
        self._frequencies_hz = [config.frequency_hz]
        if config.tilt_frequency_hz is not None:
            self._frequencies_hz.append(config.tilt_frequency_hz)
        self._phase_start_ns = start_ns
        self._window_ns = (start_ns, start_ns)
        self._sine_number = -1
        self._exciting = self._done = False
        self._home_rad = np.zeros(0)
        n_frequencies = len(self._frequencies_hz)
        self._in_phase_m = np.zeros((n_frequencies, n_cells, n_dofs, 3))
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
        measured: NDArray[np.bool_] = self._measured.all(axis=0)
        deflection_m = self._in_phase_m[0]
        if len(self._frequencies_hz) > 1:
            square, tilt_square = (frequency_hz * frequency_hz for frequency_hz in self._frequencies_hz)
            without_tilt_m = (square * deflection_m - tilt_square * self._in_phase_m[1]) / (
                square - tilt_square
            )
            deflection_m = np.where(measured[:, None], without_tilt_m, 0.0)
        return Deflections(self._home_rad, deflection_m, self._coupling[0], measured, tuple(self._problems))

    @property
    def _n_sines(self) -> int:
        return self._n_dofs * len(self._frequencies_hz)

    @property
    def _dof(self) -> int:
        """DoF of the present sine, the DoFs in turn at all their frequencies."""
        return self._sine_number // len(self._frequencies_hz)

    @property
    def _frequency_number(self) -> int:
        return self._sine_number % len(self._frequencies_hz)

    @property
    def _frequency_hz(self) -> float:
        return self._frequencies_hz[self._frequency_number]

    @property
    def _ramp_ns(self) -> int:
        return round(1e9 * self._config.ramp_periods / self._frequency_hz)

    @property
    def _sine_ns(self) -> int:
        return round(1e9 * self._config.periods / self._frequency_hz) + 2 * self._ramp_ns

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""
        if not len(self._home_rad):
            self._home_rad = position_rad.astype(np.float64)
            self._motion.retarget(self._home_rad)
        self._advance(t_ns)
        correction = self._motion.velocity(t_ns, position_rad)
        if self._done:
            return np.zeros(self._n_dofs)
        if not self._exciting:
            return correction
        velocity = np.zeros(self._n_dofs)
        velocity[self._dof] = self._sine((t_ns - self._phase_start_ns) * 1e-9)
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

    def _advance(self, t_ns: int) -> None:
        """Switch between holding and sine at their ends."""
        elapsed_ns = t_ns - self._phase_start_ns
        if self._exciting and elapsed_ns >= self._sine_ns:
            self._exciting = False
            self._phase_start_ns = t_ns
            self._motion.settle()
        elif not (self._exciting or self._done) and self._has_settled(elapsed_ns):
            if self._sine_number >= 0:
                self._reduce_to_deflections()
            self._sine_number += 1
            self._exciting = self._sine_number < self._n_sines
            self._done = not self._exciting
            self._phase_start_ns = t_ns
            measured_ns = self._sine_ns - 2 * self._ramp_ns if self._exciting else 0
            self._window_ns = (t_ns + self._ramp_ns, t_ns + self._ramp_ns + measured_ns)
            self._reset_lock_ins()

    def _has_settled(self, elapsed_ns: int) -> bool:
        """Return True once the settling time is over with all DoFs at rest; report those that do not rest."""
        config, motion = self._config, self._motion
        if elapsed_ns < config.settle_ns:
            return False
        if motion.state in (MotionState.ARRIVED, MotionState.STUCK):
            return True
        if elapsed_ns < config.rest_timeout_ns:
            return False
        following = self._sine_number + 1
        if following < self._n_sines:
            following_dof = following // len(self._frequencies_hz)
            before = f"before the sine of {self._dof_text([following_dof])}"
        else:
            before = "after the last sine"
        self._problems.append(f"{self._dof_text(motion.restless())} did not come to rest {before}")
        return True

    def _dof_text(self, dofs: Sequence[int] | NDArray[np.int64]) -> str:
        return format_members("DoF", dofs, self._dof_names)

    def _sine(self, t_s: float) -> float:
        """Return the velocity [rad/s] at `t_s` after the start of the sine."""
        to_end_s = min(t_s, self._sine_ns * 1e-9 - t_s)
        ramp_s = self._ramp_ns * 1e-9
        fade = 0.5 - 0.5 * pinned_math.cos(math.pi * to_end_s / ramp_s) if to_end_s < ramp_s else 1.0
        return self._config.amplitude_rad_s * fade * pinned_math.sin(2.0 * math.pi * self._frequency_hz * t_s)

    def _reset_lock_ins(self) -> None:
        self._cells = LockIn(self._n_cells, 3, self._frequency_hz)
        self._joints = LockIn(1, self._n_dofs, self._frequency_hz)

    def _reduce_to_deflections(self) -> None:
        """Reduce the samples of the current DoF to its deflections."""
        config, number, dof = self._config, self._frequency_number, self._dof
        angular_hz = 2.0 * math.pi * self._frequency_hz
        motions_rad = self._joints.amplitude(config.min_samples)[0]
        motion_rad = complex(motions_rad[dof])
        length_rad = pinned_math.hypot(motion_rad.real, motion_rad.imag)
        if not length_rad >= config.min_motion_fraction * config.amplitude_rad_s / angular_hz:
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
