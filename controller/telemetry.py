"""Telemetry of the controller: its published state and capabilities, and traces for metrics and plots.

None of it is used for control. State and capabilities go to observers by the wall clock, and to a recording
by simulated time; traces become arrays of the results.
"""

import time
from collections.abc import Callable, Hashable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.cell_input import CellRows
from controller.decision_core import DecisionCore
from controller.grasping import state_machine
from controller.grasping.teach_and_grasp import request_arguments
from controller.nursing import state_machine as nursing
from controller.touch.tactile_state import COLUMNS, TactileState
from skinnet.clock import NS_PER_S
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import ControllerState, Modality, encode
from skinnet.protocol.states import FORMING
from skinnet.protocol.telemetry_messages import StateMachineDescription

__all__ = [
    "REACTION_ROW",
    "PatchTrace",
    "ReactionLog",
    "RunTrace",
    "StatePublisher",
    "describe_nursing",
    "describe_program",
    "simulated_clock_ns",
    "wall_clock_ns",
]

_STATE_PERIOD_NS = 100_000_000
REACTION_ROW = np.dtype(
    [
        ("t_sampled_ns", np.int64),
        ("t_delivered_ns", np.int64),
        ("tick_ns", np.int64),
        ("cell", np.int32),
        ("channel", np.int8),
        ("stage", np.int8),
    ]
)
"""Row of the log: a sample above its channel's threshold (0 to 2 force, 3 proximity), and its tick."""
_FIRST_COLUMN = np.array([COLUMNS[modality].start for modality in Modality])
_FORCE, _PROXIMITY = slice(0, 3), 3


def wall_clock_ns(_t_ns: int) -> int:
    """Return the monotonic wall-clock time [ns], whatever the simulated time."""
    return int(time.monotonic() * NS_PER_S)


def simulated_clock_ns(t_ns: int) -> int:
    """Return the simulated time [ns] itself."""
    return t_ns


class StatePublisher:
    """Publisher of the state and capabilities of a decision core.

    The state is published on change, every 0.1 s of a clock, and at the end; the capabilities at the start
    and on change.

    Args:
        keys: Keys of the robot.
        core: Decision core.
        clock_ns: Returns the time [ns] of the clock at a simulated time [ns].
    """

    def __init__(self, keys: Keys, core: DecisionCore, clock_ns: Callable[[int], int]) -> None:
        self._state_key, self._description_key = keys.of("state"), keys.of("state_machine")
        self._core, self._clock_ns = core, clock_ns
        self._published_state = ""
        self._published_capabilities: Hashable = None
        self._published_ns: int | None = None

    def messages(self, t_ns: int, *, last: bool) -> list[tuple[str, bytes]]:
        """Return keys and messages due at `t_ns`; `last` after the last tick."""
        core = self._core
        due: list[tuple[str, bytes]] = []
        capabilities = core.capabilities_key
        if capabilities != self._published_capabilities:
            self._published_capabilities = capabilities
            due.append((self._description_key, encode(core.describe(t_ns))))
        now_ns, state = self._clock_ns(t_ns), core.state
        if (
            last
            or state != self._published_state
            or self._published_ns is None
            or now_ns - self._published_ns >= _STATE_PERIOD_NS
        ):
            self._published_state, self._published_ns = state, now_ns
            message = ControllerState(t_ns=t_ns, stage=state, progress=core.progress, text=core.reason)
            due.append((self._state_key, encode(message)))
        return due


def describe_program(control: ControllerSpec, poses: Iterable[str], t_ns: int) -> StateMachineDescription:
    """Describe the states and requests of a program of stages, given the known `poses`.

    States of a teach-and-grasp stage are named `<stage>.<state>`, as in commands.
    """
    states: list[str] = [FORMING]
    moves: list[list[str]] = []
    requests: dict[str, list[str]] = {}
    ends = [(FORMING, "network formed")]
    for stage in control.program:
        if control.stages[stage].kind == "teach_and_grasp":
            own, inside, following = _teach_and_grasp_transitions(stage)
            requests = request_arguments(poses)
        else:
            own, inside, following = [stage], [], [(stage, "done")]
        moves += [[state, event, own[0]] for state, event in ends] + inside
        states += own
        ends = following
    return StateMachineDescription(
        t_ns=t_ns, states=list(dict.fromkeys(states)), transitions=moves, requests=requests
    )


def describe_nursing(t_ns: int) -> StateMachineDescription:
    """Describe the states of the nursing program, which takes no requests."""
    moves = [[state.value, event.value, to.value] for (state, event), to in nursing.TRANSITIONS.items()]
    return StateMachineDescription(
        t_ns=t_ns, states=[state.value for state in nursing.State], transitions=moves
    )


def _teach_and_grasp_transitions(stage: str) -> tuple[list[str], list[list[str]], list[tuple[str, str]]]:
    """States and transitions of a teach-and-grasp stage, and its final states with their event."""
    states = [f"{stage}.{state.value}" for state in state_machine.State]
    moves = [
        [f"{stage}.{state.value}", event.value, f"{stage}.{to.value}"]
        for state, row in state_machine.TRANSITIONS.items()
        for event, to in row.items()
    ]
    return states, moves, [(f"{stage}.{state_machine.State.ENDED.value}", "done")]


class RunTrace:
    """Trace of inputs and commands of every tick, and of tactile input in reacting stages."""

    def __init__(self) -> None:
        self._t_ns: list[int] = []
        self._velocity: list[NDArray[np.float32]] = []
        self._input_counts: list[tuple[int, int]] = []
        self._tactile_input_ns: list[int] = []
        self._tactile_input: list[NDArray[np.float16]] = []

    def add(
        self,
        t_ns: int,
        velocity: NDArray[np.float64],
        tactile_input: NDArray[np.float64] | None,
        input_counts: tuple[int, int],
    ) -> None:
        """Add a tick: velocities (D,) [rad/s], tactile input (S, 4), counts of events and full readings."""
        self._t_ns.append(t_ns)
        self._input_counts.append(input_counts)
        self._velocity.append(velocity.astype(np.float32))
        if tactile_input is not None:
            self._tactile_input_ns.append(t_ns)
            self._tactile_input.append(tactile_input.astype(np.float16))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the trace's arrays by name."""
        return {
            "t_ns": np.array(self._t_ns, dtype=np.int64),
            "velocity_rad_s": np.array(self._velocity, dtype=np.float32),
            # counts of events and of full readings
            "input_counts": np.array(self._input_counts, dtype=np.int64).reshape(-1, 2),
            "tactile_input_t_ns": np.array(self._tactile_input_ns, dtype=np.int64),
            "tactile_input": np.array(self._tactile_input, dtype=np.float16),
        }


class ReactionLog:
    """Log of the event and stream samples that trigger tactile reactions."""

    def __init__(self) -> None:
        self._rows: list[NDArray[Any]] = []

    @property
    def rows(self) -> NDArray[Any]:
        """All logged samples, (n,) `REACTION_ROW`."""
        return np.concatenate(self._rows) if self._rows else np.zeros(0, dtype=REACTION_ROW)

    def add(
        self,
        tick_ns: int,
        stage_index: int,
        events: CellRows,
        stream: CellRows,
        thresholds: NDArray[np.float64],
    ) -> None:
        """Add the samples of a tick above `thresholds` (S, 4), which are inf where the gain is zero."""
        channels = thresholds.shape[1]
        if len(stream.cell):
            above = stream.rows["values"][:, :channels] > thresholds[stream.cell]
            row, channel = np.nonzero(above)
            self._append(tick_ns, stage_index, stream.cell[row], channel, stream.rows[row])
        if len(events.cell):
            column = _FIRST_COLUMN[events.rows["modality"]] + events.rows["channel"]
            index = np.flatnonzero(column < channels)
            cell, column = events.cell[index], column[index]
            driving = events.rows["value"][index] > thresholds[cell, column]
            self._append(tick_ns, stage_index, cell[driving], column[driving], events.rows[index[driving]])

    def _append(
        self, tick_ns: int, stage: int, cell: NDArray[np.int64], channel: NDArray[Any], rows: NDArray[Any]
    ) -> None:
        if not len(cell):
            return
        log = np.empty(len(cell), dtype=REACTION_ROW)
        log["t_sampled_ns"], log["t_delivered_ns"] = rows["t_sampled_ns"], rows["t_delivered_ns"]
        log["tick_ns"], log["stage"], log["cell"], log["channel"] = tick_ns, stage, cell, channel
        self._rows.append(log)


class PatchTrace:
    """Trace of the controller's newest readings, reduced to the maximum of each patch.

    Args:
        cell_counts: Number of cells of each patch, by name, in order.
    """

    def __init__(self, cell_counts: dict[str, int]) -> None:
        self._first_cell = np.cumsum([0, *cell_counts.values()])[:-1]
        self._n_patches = len(cell_counts)
        self._t_ns: list[int] = []
        self._readings: list[NDArray[np.float32]] = []

    def add(self, t_ns: int, tactile_state: TactileState) -> None:
        """Add the readings of a tick."""
        touch = tactile_state.reaction_readings(t_ns)
        felt = np.column_stack([touch[:, _FORCE].max(axis=1), touch[:, _PROXIMITY]])
        self._t_ns.append(t_ns)
        self._readings.append(np.maximum.reduceat(felt, self._first_cell, axis=0).astype(np.float32))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return times (n,) and largest force and proximity readings (n, P, 2)."""
        return {
            "patch_t_ns": np.array(self._t_ns, dtype=np.int64),
            "patch_readings": np.array(self._readings, dtype=np.float32).reshape(-1, self._n_patches, 2),
        }
