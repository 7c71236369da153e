"""Structural self-exploration: the motion program that measures gravity before and after each step."""

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.exploration import PositionControl
from controller.selforganisation.kinematic_structure import (
    KinematicStructure,
    activity_matrix,
    find_structure,
)

__all__ = ["StructuralExploration", "StructuralExplorationConfig"]


@dataclass(frozen=True)
class StructuralExplorationConfig:
    """Timing and threshold of [M14, VI.A]; limits without a source are assumptions."""

    step_rad: float = 0.1
    average_ns: int = 1_000_000_000
    settle_ns: int = 500_000_000
    threshold_g: float = 0.01
    position_control: PositionControl = field(default_factory=PositionControl)
    move_timeout_ns: int = 5_000_000_000
    """Time [ns] after which a DoF that has not completed its step is reported and skipped."""
    min_samples: int = 25
    """Samples per window below which a cell counts as not measured; 250 are due at 250 Hz in 1 s."""


class _Phase(Enum):
    BEFORE = 0
    MOVE = 1
    SETTLE = 2
    AFTER = 3
    DONE = 4


_RUNS = 2


class StructuralExploration:
    """Exploration program: steps each DoF, all forth, then all back, and compares gravity [M14, III.A].

    In the first run every DoF stays at its step, which tilts the axes of the next ones off gravity. Targets
    are absolute, the pose at the first tick and that plus the step, hence no drift.
    """

    def __init__(self, config: StructuralExplorationConfig, n_dofs: int, n_cells: int, start_ns: int) -> None:
        """Start at `start_ns`, with D = `n_dofs` and S = `n_cells`."""
        self._config = config
        self._n_dofs, self._n_cells = n_dofs, n_cells
        self._start_ns = self._phase_start_ns = self._move_start_ns = start_ns
        self._phase = _Phase.BEFORE if n_dofs else _Phase.DONE
        self._step = 0
        self._home_rad: NDArray[np.float64] | None = None
        self._target_rad = np.zeros(n_dofs)
        self._windows = [(start_ns, (0, 0, 0))]
        self._sum_g = np.zeros((2, _RUNS, n_dofs, n_cells, 3))
        self._count = np.zeros((2, _RUNS, n_dofs, n_cells), dtype=np.int64)
        self._failed_steps: list[str] = []

    @property
    def done(self) -> bool:
        """True once all steps are made and measured."""
        return self._phase is _Phase.DONE

    @property
    def needs_stream(self) -> bool:
        """True while the accelerations of all cells are needed."""
        return not self.done

    @property
    def progress(self) -> float:
        """Completed fraction of the program, 0 to 1."""
        steps = _RUNS * self._n_dofs
        return 1.0 if self.done else (self._step + self._phase.value / _Phase.DONE.value) / steps

    @cached_property
    def result(self) -> KinematicStructure:
        """Kinematic structure, with failed steps and measurements among its problems.

        Raises:
            RuntimeError: the program is not done.
        """
        if not self.done:
            raise RuntimeError("structural exploration is not done; wait for `done`")
        enough = self._count >= self._config.min_samples
        count = np.where(enough, self._count, 1)[..., None]
        before_g, after_g = np.where(enough[..., None], self._sum_g / count, np.nan)
        active, unknown = activity_matrix(before_g, after_g, self._config.threshold_g)
        return find_structure(active, unknown, self._failed_steps)

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""
        if self._home_rad is None:
            self._home_rad = position_rad.astype(np.float64)
            self._target_rad = self._home_rad.copy()
        if t_ns < self._start_ns or self.done:
            return np.zeros(self._n_dofs)
        self._advance(t_ns, position_rad)
        return self._config.position_control.velocity(self._target_rad, position_rad)

    def add_samples(
        self, cells: NDArray[np.int64], t_sampled_ns: NDArray[np.int64], acceleration_g: NDArray[np.float64]
    ) -> None:
        """Add accelerations (n, 3) of cells (n,) [g, cell frames] to the mean of their window.

        The last two windows accept samples, for those that arrive late.
        """
        for begin_ns, window in self._windows:
            inside = (t_sampled_ns >= begin_ns) & (t_sampled_ns < begin_ns + self._config.average_ns)
            rows, values_g = cells[inside], acceleration_g[inside]
            for axis in range(3):
                self._sum_g[window][:, axis] += np.bincount(rows, values_g[:, axis], self._n_cells)
            self._count[window] += np.bincount(rows, minlength=self._n_cells)

    def _advance(self, t_ns: int, position_rad: NDArray[np.float64]) -> None:
        config = self._config
        run, dof = divmod(self._step, self._n_dofs)
        elapsed_ns = t_ns - self._phase_start_ns
        match self._phase:
            case _Phase.BEFORE if elapsed_ns >= config.average_ns:
                assert self._home_rad is not None
                self._target_rad[dof] = self._home_rad[dof] + (config.step_rad if run == 0 else 0.0)
                self._move_start_ns = t_ns
                self._enter(_Phase.MOVE, t_ns)
            case _Phase.MOVE:
                arrived = (
                    abs(self._target_rad[dof] - position_rad[dof]) <= config.position_control.tolerance_rad
                )
                if not arrived and elapsed_ns >= config.move_timeout_ns:
                    self._failed_steps.append(
                        f"DoF {dof} did not complete its step before the timeout in run {run}"
                    )
                    self._target_rad[dof] = position_rad[dof]
                if arrived or elapsed_ns >= config.move_timeout_ns:
                    self._enter(_Phase.SETTLE, t_ns)
            case _Phase.SETTLE if self._has_settled(t_ns):
                self._open_window(1, t_ns)
                self._enter(_Phase.AFTER, t_ns)
            case _Phase.AFTER if self._step == _RUNS * self._n_dofs - 1:
                # rests once more, until the last samples arrive
                if elapsed_ns >= config.average_ns + config.settle_ns:
                    self._enter(_Phase.DONE, t_ns)
            case _Phase.AFTER if elapsed_ns >= config.average_ns:
                self._step += 1
                self._open_window(0, t_ns)
                self._enter(_Phase.BEFORE, t_ns)
            case _:
                pass

    def _has_settled(self, t_ns: int) -> bool:
        """Return True once the settling time is over: counted from the start of the move, half of it at rest.

        28 steps, each 0.5 s of settling and two averages of 1.0 s, are the 70 s of [M14], which leaves no
        extra time for the moves.
        """
        settle_ns = self._config.settle_ns
        return t_ns - self._move_start_ns >= settle_ns and t_ns - self._phase_start_ns >= settle_ns // 2

    def _enter(self, phase: _Phase, t_ns: int) -> None:
        self._phase, self._phase_start_ns = phase, t_ns

    def _open_window(self, side: int, t_ns: int) -> None:
        run, dof = divmod(self._step, self._n_dofs)
        self._windows = [self._windows[-1], (t_ns, (side, run, dof))]
