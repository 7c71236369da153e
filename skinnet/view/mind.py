"""Controller state, recent transitions and state-machine description, from its published messages."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from skinnet.messages import ControllerState
from skinnet.watch_messages import Machine

__all__ = ["Mind", "Move"]

_KEPT = 200


class Move(NamedTuple):
    """State transition of the controller, with its time [ns] and reason."""

    t_ns: int
    state: str
    to: str
    why: str


class Mind:
    """Controller view: present state and transition history.

    Attributes:
        state: Present state; empty if unknown.
        since_ns: Time at which it was entered [ns].
        progress: Completed fraction of the state.
        text: Reason for entering the state, as published.
        moves: Recent transitions, newest last.
        machine: State-machine description, if published.
    """

    def __init__(self, expected: Iterable[str] = ()) -> None:
        """Initialise the view.

        Args:
            expected: State names to show until the state-machine description is published.
        """
        self._expected = tuple(expected)
        self.state = ""
        self.since_ns = 0
        self.progress = 0.0
        self.text = ""
        self.moves: deque[Move] = deque(maxlen=_KEPT)
        self.machine: Machine | None = None

    def take_state(self, said: ControllerState) -> None:
        """Apply a published controller state."""
        if said.stage != self.state:
            if self.state:
                self.moves.append(Move(said.t_ns, self.state, said.stage, said.text))
            self.state, self.since_ns = said.stage, said.t_ns
        elif said.text and self.moves and self.moves[-1].to == said.stage and not self.moves[-1].why:
            self.moves[-1] = self.moves[-1]._replace(why=said.text)  # the command came before the reason
        self.progress = said.progress
        self.text = said.text

    def take_stage(self, t_ns: int, stage: str) -> None:
        """Apply the stage named by a command, for recordings without controller states."""
        if stage and stage != self.state:
            self.take_state(ControllerState(t_ns=t_ns, stage=stage, progress=self.progress))

    @property
    def states(self) -> tuple[str, ...]:
        """Known states, in the controller's order or in order of appearance."""
        known = self._expected if self.machine is None else self.machine.states
        seen = [*(name for move in self.moves for name in (move.state, move.to)), self.state]
        return tuple(dict.fromkeys(name for name in (*known, *seen) if name))

    @property
    def arrows(self) -> tuple[tuple[str, str, str], ...]:
        """Transitions (state, event, next state): those described by the controller, or those observed."""
        if self.machine is not None and self.machine.moves:
            return tuple((move[0], move[1], move[2]) for move in self.machine.moves if len(move) == 3)
        return tuple(dict.fromkeys((move.state, move.why, move.to) for move in self.moves))
