"""Structural self-exploration: the motion program that measures gravity before and after each step."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from controller.selforganisation.exploration import (
    MotionState,
    PointToPoint,
    PositionControl,
    steps_with_room,
)
from controller.selforganisation.kinematic_structure import (
    KinematicStructure,
    activity_matrix,
    barely_active,
    find_structure,
    format_members,
)
from controller.selforganisation.touch_guard import TouchGuard

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
    """Time [ns] after which a motion that has not come to rest at its target has failed."""
    max_attempts: int = 2
    """Attempts at a step; what fails the last one is reported."""
    min_samples: int = 25
    """Samples per window below which a cell counts as not measured; 250 are due at 250 Hz in 1 s."""


class _Phase(Enum):
    RETURN = -1
    BEFORE = 0
    MOVE = 1
    AFTER = 2
    LAST = 3
    DONE = 4


_RUNS = 2
_Window = tuple[int, int, int]
"""Side (before, after), run and DoF of an average."""


class StructuralExploration:
    """Exploration program: steps each DoF, all forth, then all back, and compares gravity [M14, III.A].

    A step goes to the side with room within the limits of the DoF, upwards first. Contact, or what comes
    nearer, stops it: it goes back and to the other side. A DoF that can go to neither is among the problems.

    In the first run every DoF stays at its step, which tilts the axes of the next ones off gravity. Targets
    are absolute, the pose at the first tick and that plus the step, hence no drift.

    A step counts only between two measured rests: all DoFs are still throughout the averages before and after
    it. Else it is repeated; if that fails as well, the DoF is among the problems. Unless all were still its
    measurements in this run are dropped: they say nothing about any cell.
    """

    def __init__(
        self,
        config: StructuralExplorationConfig,
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
        self._start_ns = self._phase_start_ns = start_ns
        self._phase = _Phase.BEFORE if n_dofs else _Phase.DONE
        self._step, self._attempt = 0, 1
        self._progress = 0.0
        self._motion = PointToPoint(config.position_control, n_dofs)
        self._home_rad: NDArray[np.float64] | None = None
        self._guard = TouchGuard(n_cells, config.position_control.touch)
        self._origin_rad = np.zeros(n_dofs)
        self._steps_rad: list[list[float]] = [[] for _ in range(n_dofs)]
        """Steps of each DoF that have room, from home; the first is the next one to be made."""
        self._extremes_rad = np.zeros((2, n_dofs))
        self._windows: list[tuple[int, _Window]] = [(start_ns, (0, 0, 0))]
        self._sum_g = np.zeros((2, _RUNS, n_dofs, n_cells, 3))
        self._count = np.zeros((2, _RUNS, n_dofs, n_cells), dtype=np.int64)
        self._lost = np.zeros((_RUNS, n_dofs), dtype=np.bool_)
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
        return 1.0 if self.done else self._progress

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
        threshold_g = self._config.threshold_g
        active, unknown = activity_matrix(before_g, after_g, threshold_g, self._lost)
        active[:, barely_active(before_g, after_g, threshold_g)] = False
        return find_structure(
            active, unknown, self._failed_steps, dof_names=self._dof_names, cell_names=self._cell_names
        )

    def step(self, t_ns: int, position_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the velocity command (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""
        if self._home_rad is None:
            self._home_rad = position_rad.astype(np.float64)
            self._extremes_rad[:] = position_rad
            self._motion.retarget(self._home_rad)
            self._plan_steps(self._home_rad)
        if t_ns < self._start_ns or self.done:
            return np.zeros(self._n_dofs)
        self._extremes_rad[0] = np.minimum(self._extremes_rad[0], position_rad)
        self._extremes_rad[1] = np.maximum(self._extremes_rad[1], position_rad)
        self._advance(t_ns, position_rad)
        return self._motion.velocity(t_ns, position_rad)

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

    def add_touch(self, cells: NDArray[np.int64], touch: NDArray[np.float64]) -> None:
        """Add touch readings (n, 4) of cells (n,), three of force and one of proximity."""
        self._guard.add(cells, touch)

    def _plan_steps(self, home_rad: NDArray[np.float64]) -> None:
        """Find the steps with room; a DoF without is lost. Skip the first steps if there are none."""
        config = self._config
        for dof in range(self._n_dofs):
            room_rad = config.position_control.room_rad(dof, home_rad)
            self._steps_rad[dof] = steps_with_room(config.step_rad, *room_rad)
            if not self._steps_rad[dof]:
                self._lost[:, dof] = True
                self._failed_steps.append(
                    f"{self._dof_text([dof])} was not stepped: no room for a step of {config.step_rad} rad "
                    "within its limits"
                )
        self._skip_lost_steps()
        if self._step < _RUNS * self._n_dofs:
            self._windows = [(self._start_ns, (0, *divmod(self._step, self._n_dofs)))]
        else:
            self._end(self._start_ns)

    def _skip_lost_steps(self) -> None:
        """Go on to the next step that can be made, if the present one cannot."""
        while self._step < _RUNS * self._n_dofs and self._lost[:, self._step % self._n_dofs].all():
            self._step += 1

    def _advance(self, t_ns: int, position_rad: NDArray[np.float64]) -> None:
        config, motion = self._config, self._motion
        elapsed_ns = t_ns - self._phase_start_ns
        timed_out = elapsed_ns >= config.move_timeout_ns
        match self._phase:
            case _Phase.RETURN if motion.state is MotionState.ARRIVED or timed_out:
                if self._lost[divmod(self._step, self._n_dofs)]:
                    self._next_step(t_ns, position_rad)
                else:
                    self._open_window(0, t_ns, position_rad)
                    self._enter(_Phase.BEFORE, t_ns)
            case _Phase.BEFORE if elapsed_ns >= config.average_ns:
                self._origin_rad = motion.target_rad
                if self._was_still():
                    self._guard.arm()
                    motion.begin(self._step_target_rad())
                    self._enter(_Phase.MOVE, t_ns)
                else:
                    self._fail(t_ns, position_rad)
            case _Phase.MOVE if self._guard.cells.size:
                self._stop(t_ns)
            case _Phase.MOVE if self._has_settled(t_ns):
                self._open_window(1, t_ns, position_rad)
                self._enter(_Phase.AFTER, t_ns)
            case _Phase.MOVE if timed_out:
                self._fail(t_ns, position_rad)
            case _Phase.AFTER if elapsed_ns >= config.average_ns:
                if self._was_still() and motion.state is MotionState.ARRIVED:
                    self._next_step(t_ns, position_rad)
                else:
                    self._fail(t_ns, position_rad)
            case _Phase.LAST if elapsed_ns >= config.settle_ns:
                self._enter(_Phase.DONE, t_ns)
            case _:
                pass

    def _has_settled(self, t_ns: int) -> bool:
        """Return True once all DoFs rest and the settling time is over: half of it at rest.

        28 steps, each 0.5 s of settling and two averages of 1.0 s, are the 70 s of [M14], which leaves no
        extra time for the moves.
        """
        motion, settle_ns = self._motion, self._config.settle_ns
        return (
            motion.state in (MotionState.ARRIVED, MotionState.STUCK)
            and t_ns - self._phase_start_ns >= settle_ns
            and t_ns - motion.last_command_ns >= settle_ns // 2
        )

    def _was_still(self) -> bool:
        """Return True if no DoF has moved since the window was opened."""
        return not self._moving_dofs().size

    def _moving_dofs(self) -> NDArray[np.int64]:
        swing_rad = self._extremes_rad[1] - self._extremes_rad[0]
        return np.flatnonzero(swing_rad > self._config.position_control.tolerance_rad)

    def _step_target_rad(self) -> NDArray[np.float64]:
        assert self._home_rad is not None
        run, dof = divmod(self._step, self._n_dofs)
        target_rad = self._motion.target_rad.copy()
        target_rad[dof] = self._home_rad[dof] + (self._steps_rad[dof][0] if run == 0 else 0.0)
        return target_rad

    def _next_step(self, t_ns: int, position_rad: NDArray[np.float64]) -> None:
        self._step, self._attempt = self._step + 1, 1
        self._skip_lost_steps()
        if self._step >= _RUNS * self._n_dofs:
            self._end(t_ns)
            return
        self._open_window(0, t_ns, position_rad)
        self._enter(_Phase.BEFORE, t_ns)

    def _end(self, t_ns: int) -> None:
        """Rest once more, until the last samples arrive."""
        self._step = _RUNS * self._n_dofs - 1
        self._enter(_Phase.LAST, t_ns)

    def _stop(self, t_ns: int) -> None:
        """Go back from a step that a cell has stopped, and try the other side, if it has room."""
        run, dof = divmod(self._step, self._n_dofs)
        self._motion.begin(self._origin_rad)
        self._enter(_Phase.RETURN, t_ns)
        if run == 0:
            del self._steps_rad[dof][0]
            again = bool(self._steps_rad[dof])
        else:
            again = self._attempt < self._config.max_attempts
            self._attempt += 1
        if not again:
            self._failed_steps.append(
                f"{self._dof_text([dof])} did not complete its step in run {run + 1}: something touched or "
                f"came near {format_members('cell', self._guard.cells, self._cell_names)}"
            )
            self._drop_measurement()
            self._lost[run:, dof] = True

    def _fail(self, t_ns: int, position_rad: NDArray[np.float64]) -> None:
        """Repeat the step from the pose before it; after the last attempt report it and continue."""
        motion = self._motion
        if self._attempt < self._config.max_attempts:
            self._attempt += 1
            motion.begin(self._origin_rad)
            self._enter(_Phase.RETURN, t_ns)
            return
        run, dof = divmod(self._step, self._n_dofs)
        moving, behind = self._moving_dofs(), motion.behind(position_rad)
        if moving.size or self._phase is not _Phase.AFTER:
            moving = moving if moving.size else motion.restless()
            why = f"{self._dof_text(moving)} did not come to rest, so it is not measured"
            self._drop_measurement()
        else:
            error_rad = np.abs(motion.target_rad - position_rad).max()
            why = f"{self._dof_text(behind)} rested up to {error_rad:.3f} rad from the target"
            target_rad = motion.target_rad.copy()
            target_rad[dof] = position_rad[dof]
            motion.retarget(target_rad)
        self._failed_steps.append(
            f"{self._dof_text([dof])} did not complete its step in run {run + 1}: {why}"
        )
        self._next_step(t_ns, position_rad)

    def _dof_text(self, dofs: Sequence[int] | NDArray[np.int64]) -> str:
        return format_members("DoF", dofs, self._dof_names)

    def _drop_measurement(self) -> None:
        """Drop the averages of the present step, and samples of it that are still to come."""
        run, dof = divmod(self._step, self._n_dofs)
        self._count[:, run, dof] = 0
        self._lost[run, dof] = True
        self._windows = [entry for entry in self._windows if entry[1][1:] != (run, dof)]

    def _enter(self, phase: _Phase, t_ns: int) -> None:
        self._phase, self._phase_start_ns = phase, t_ns
        if phase is not _Phase.MOVE:
            self._guard.disarm()
        done = max(0, phase.value) / _Phase.DONE.value
        self._progress = max(self._progress, (self._step + done) / (_RUNS * self._n_dofs))

    def _open_window(self, side: int, t_ns: int, position_rad: NDArray[np.float64]) -> None:
        """Begin the average before (0) or after (1) the present step; all DoFs must be still from here on."""
        run, dof = divmod(self._step, self._n_dofs)
        window = (side, run, dof)
        self._sum_g[window], self._count[window] = 0.0, 0
        self._windows = [*(entry for entry in self._windows[-1:] if entry[1] != window), (t_ns, window)]
        self._extremes_rad[:] = position_rad
        self._guard.rest()
