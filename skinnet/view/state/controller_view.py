"""Controller state, recent transitions and state-machine description, from its published messages."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from skinnet.protocol.messages import ControllerState
from skinnet.protocol.telemetry_messages import StateMachineDescription

__all__ = ["ControllerView", "ObservedTransition"]

_HISTORY_LENGTH = 200


class ObservedTransition(NamedTuple):
    """State transition of the controller, with its time [ns] and reason."""

    t_ns: int
    source: str
    target: str
    reason: str


class ControllerView:
    """Controller view: present state and transition history.

    Attributes:
        state: Present state; empty if unknown.
        since_ns: Time at which it was entered [ns].
        progress: Completed fraction of the state.
        reason: Reason for entering the state, as published.
        history: Recent transitions, newest last.
        description: State-machine description, if published.
    """

    def __init__(self, expected_states: Iterable[str] = ()) -> None:
        """Initialise the view.

        Args:
            expected_states: State names to show until the state-machine description is published.
        """
        self._expected_states = tuple(expected_states)
        self.state = ""
        self.since_ns = 0
        self.progress = 0.0
        self.reason = ""
        self.history: deque[ObservedTransition] = deque(maxlen=_HISTORY_LENGTH)
        self.description: StateMachineDescription | None = None

    def apply_state(self, state: ControllerState) -> None:
        """Apply a published controller state."""
        if state.stage != self.state:
            if self.state:
                self.history.append(ObservedTransition(state.t_ns, self.state, state.stage, state.text))
            self.state, self.since_ns = state.stage, state.t_ns
        elif (
            state.text
            and self.history
            and self.history[-1].target == state.stage
            and not self.history[-1].reason
        ):
            self.history[-1] = self.history[-1]._replace(
                reason=state.text
            )  # the command came before the reason
        self.progress = state.progress
        self.reason = state.text

    def apply_stage(self, t_ns: int, stage: str) -> None:
        """Apply the stage named by a command, for recordings without controller states."""
        if stage and stage != self.state:
            self.apply_state(ControllerState(t_ns=t_ns, stage=stage, progress=self.progress))

    @property
    def states(self) -> tuple[str, ...]:
        """Known states, in the controller's order or in order of appearance."""
        known = self._expected_states if self.description is None else self.description.states
        seen = [*(name for move in self.history for name in (move.source, move.target)), self.state]
        return tuple(dict.fromkeys(name for name in (*known, *seen) if name))

    @property
    def transitions(self) -> tuple[tuple[str, str, str], ...]:
        """Transitions (state, event, next state): those described by the controller, or those observed."""
        if self.description is not None and self.description.transitions:
            return tuple(
                (move[0], move[1], move[2]) for move in self.description.transitions if len(move) == 3
            )
        return tuple(dict.fromkeys((move.source, move.reason, move.target) for move in self.history))
