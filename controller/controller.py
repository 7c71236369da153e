"""Controller core without I/O: runs a program of stages and maps tactile input to joint velocities.

Each tick fuses the delivered skin data, computes the velocity of the current stage, and clamps it. Cells are
configured to stream full readings only while a stage needs them: all cells to explore, cells in contact to
react.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.cell_input import CellInput, CellRows
from controller.grasping.long_term_memory import LongTermMemory
from controller.grasping.teach_and_grasp import TeachAndGrasp
from controller.request_queue import Reply, RequestHandler
from controller.self_model import SelfModel
from controller.stages.stages import Stage, make_stage
from controller.telemetry import ReactionLog
from controller.touch.safety_clamp import SafetyClamp, SafetyLimits
from controller.touch.tactile_state import LevelThresholds, TactileState
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.protocol.messages import FOREVER_NS
from skinnet.protocol.states import FORMING

__all__ = ["Controller", "TickOutput"]

_STREAM_TIMEOUT_NS = 100_000_000
"""Simulated time [ns] after which an ineffective stream request is repeated; an assumption."""
_STOP_REPEAT_WINDOW_NS = 1_000_000_000
"""Simulated time [ns] after a stop request beyond which a stream counts as requested by another client."""
_EVENT_FIELDS = ("t_sampled_ns", "modality", "channel", "kind", "level", "value")


class TickOutput(NamedTuple):
    """Output of a tick: joint velocities (D,) [rad/s], and the cells whose stream is switched on or off."""

    velocity_rad_s: NDArray[np.float64]
    streams_on: NDArray[np.int64]
    streams_off: NDArray[np.int64]


class Controller:
    """Controller core: tactile state, stage program and safety clamp.

    Args:
        spec: Program, stages and limits.
        cell_input: Input of the events and streams of all patches.
        n_cells: S, over all patches.
        level_thresholds: Thresholds with which the cells start; None if full readings are not to tell levels.
        dof_names: (D,) names of the DoFs for messages; their numbers unless given.
        cell_names: (S,) names of the cells likewise.
    """

    def __init__(
        self,
        spec: ControllerSpec,
        cell_input: CellInput,
        n_cells: int,
        level_thresholds: LevelThresholds | None = None,
        *,
        dof_names: Sequence[str] = (),
        cell_names: Sequence[str] = (),
    ) -> None:
        self.cell_input = cell_input
        self.self_model = SelfModel(
            min_row_norm=spec.map.min_row_norm,
            min_lever_m=spec.map.min_lever_m,
            dof_names=dof_names,
            cell_names=cell_names,
        )
        self.memory = LongTermMemory(None, self.self_model)
        """Long-term memory; the default has no store."""
        self.tactile_state = TactileState(n_cells, level_thresholds=level_thresholds)
        self.teach_and_grasp_stages: list[TeachAndGrasp] = []
        self.stage_log: list[tuple[str, int]] = []
        self.reaction_log = ReactionLog()
        self.range_rad: NDArray[np.float64] | None = None
        """Position limits (D, 2) of the joints, for explorations; None if they are not known."""
        self._spec = spec
        self._n_cells = n_cells
        self._clamp: SafetyClamp | None = None
        self._home_rad = np.zeros(0)
        self._program = list(spec.program)
        self._stage_name = ""
        self._stage: Stage | None = None
        self._streaming = np.zeros(n_cells, dtype=np.bool_)
        self._last_stream_request_ns = np.full(n_cells, -FOREVER_NS)
        self._last_stream_ns = np.full(n_cells, -FOREVER_NS)
        self.repeated_stream_requests = 0
        """Number of stream requests that were repeated because they had no effect."""

    @property
    def done(self) -> bool:
        """True once the program of stages is complete."""
        return not self._program and self._stage is None

    @property
    def stage(self) -> str:
        """Name of the current stage, followed by a dot and its state if the stage has states."""
        label = self._stage.state_name if self._stage is not None else ""
        return f"{self._stage_name}.{label}" if label else self._stage_name

    @property
    def state(self) -> str:
        """Controller state as published: the current stage, or `FORMING` before the first."""
        return self.stage or FORMING

    @property
    def reason(self) -> str:
        """Event that led to the state of the current stage; empty without one."""
        return self._stage.reason if self._stage is not None else ""

    @property
    def progress(self) -> float:
        """Completed fraction of the current stage, 0 to 1."""
        return self._stage.progress if self._stage is not None else float(self.done)

    @property
    def tactile_input(self) -> NDArray[np.float64] | None:
        """Tactile input (S, 4) of the last tick's reaction; None without reactions."""
        return self._stage.tactile_input if self._stage is not None else None

    @property
    def safety_clamp(self) -> SafetyClamp | None:
        """Safety clamp; None before the first tick."""
        return self._clamp

    def update_presence(self, cells: NDArray[np.int64], present: NDArray[np.bool_]) -> None:
        """Update the network membership of cells (n,); absent cells read zero until they rejoin.

        Args:
            cells: (n,) cell indices through all patches.
            present: (n,) membership of each.
        """
        gone, back = cells[~present], cells[present & ~self.tactile_state.present[cells]]
        self.tactile_state.set_present(gone, False)
        self.tactile_state.set_present(back, True)
        self._streaming[gone] = False

    def handle_request(self, t_ns: int, name: str, argument: str) -> Reply:
        """Pass a request to the current stage, or refuse it, before the tick at `t_ns`."""
        stage = self._stage
        if stage is not None:
            if isinstance(stage, RequestHandler):
                reply = stage.handle_request(t_ns, name, argument)
                return reply._replace(state=self.state)
            why = f"stage {self._stage_name!r} takes no requests"
        elif self.done:
            why = "the program is complete"
        else:
            why = "the program has not started: the network of the skin is still forming"
        return Reply(False, self.state, why)

    def tick(
        self,
        t_ns: int,
        position_rad: NDArray[np.float64],
        t_joints_ns: int,
        t_skin_ns: int,
        *,
        ready: bool,
        external_rad_s: NDArray[np.float64] | None = None,
    ) -> tuple[TickOutput, CellRows, CellRows]:
        """Compute one control period.

        Args:
            t_ns: Time of the tick.
            position_rad: (D,) measured joint positions.
            t_joints_ns: Time at which they were measured.
            t_skin_ns: Lowest watermark of all patches.
            ready: True once the skin's network is formed and the program may begin.
            external_rad_s: (D,) finite velocities that an external client adds to a running program; if any.

        Returns:
            The tick's output, and the events and full readings of this tick in the order of delivery.
        """
        if self._clamp is None:
            self._home_rad = position_rad.copy()
            limits = SafetyLimits.from_spec(self._spec.safety)
            self._clamp = SafetyClamp(limits, len(position_rad), self._spec.period_ns)
        events, stream = self.cell_input.take_delivered(t_ns)
        self._fuse_input(events, stream)
        if ready:
            self._advance_program(t_ns)
        wanted = np.zeros(len(position_rad))
        if ready and self._stage is not None:
            wanted = self._stage.step(t_ns, position_rad, self.tactile_state)
            if (thresholds := self._stage.thresholds) is not None:
                self.reaction_log.add(t_ns, len(self.stage_log) - 1, events, stream, thresholds)
            if external_rad_s is not None:
                wanted = wanted + external_rad_s
        velocity = self._clamp.clamp(t_ns, wanted, position_rad, t_joints_ns, t_skin_ns)
        return TickOutput(velocity, *self._switch_streams(t_ns)), events, stream

    def _fuse_input(self, events: CellRows, stream: CellRows) -> None:
        cell, rows = events
        if len(cell):
            self.tactile_state.apply_events(cell, *(rows[name] for name in _EVENT_FIELDS))
        cell, rows = stream
        if len(cell):
            self.tactile_state.apply_stream(cell, rows["t_sampled_ns"], rows["values"])
            self._last_stream_ns[cell] = rows["t_delivered_ns"]
            if self._stage is not None:
                self._stage.add_readings(stream)

    def _advance_program(self, t_ns: int) -> None:
        """Finish the current stage if it is done, and start the next."""
        if self._stage is not None and self._stage.done:
            self._stage.finish(t_ns)
            self._stage = None
        if self._stage is None and self._program:
            self._stage_name = self._program.pop(0)
            self.stage_log.append((self._stage_name, t_ns))
            self._stage = make_stage(
                self._spec.stages[self._stage_name],
                self._spec,
                self.self_model,
                self.memory,
                self.tactile_state,
                t_ns=t_ns,
                n_cells=self._n_cells,
                home_rad=self._home_rad,
                range_rad=self.range_rad,
            )
            if isinstance(self._stage, TeachAndGrasp):
                self.teach_and_grasp_stages.append(self._stage)

    def _switch_streams(self, t_ns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        stage = self._stage
        wanted = np.zeros(self._n_cells, dtype=np.bool_)
        if stage is not None and stage.needs_stream:
            wanted[:] = True
        elif stage is not None and stage.gains is not None:
            wanted = self.tactile_state.cells_to_stream(t_ns, stage.gains)
        wanted &= self.tactile_state.present
        on, off = wanted & ~self._streaming, self._streaming & ~wanted
        since_ns = self._last_stream_ns - self._last_stream_request_ns
        overdue = t_ns - np.maximum(self._last_stream_request_ns, self._last_stream_ns) > _STREAM_TIMEOUT_NS
        silent = wanted & self._streaming & overdue
        talking = (
            ~wanted & ~self._streaming & (since_ns > _STREAM_TIMEOUT_NS) & (since_ns < _STOP_REPEAT_WINDOW_NS)
        )
        self.repeated_stream_requests += int(silent.sum() + talking.sum())
        on, off = on | silent, off | talking
        self._streaming = wanted
        self._last_stream_request_ns[on | off] = t_ns
        return np.flatnonzero(on), np.flatnonzero(off)
