"""What the controller does, how it got there, and what can be asked of it."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from skinnet.messages import ControllerState
from skinnet.watch_messages import Machine

__all__ = ["Mind", "Move"]

_KEPT = 200


class Move(NamedTuple):
    """The controller went from one state to another."""

    t_ns: int
    state: str
    to: str
    why: str


class Mind:
    """The controller's states.

    Attributes:
        state: The present one; empty if nothing was heard.
        since_ns: When it began [ns].
        progress: Share of it that is done.
        text: What the controller says of it: why it went there.
        moves: The last moves, newest last.
        machine: States and requests, if the controller told them.
    """

    def __init__(self, expected: Iterable[str] = ()) -> None:
        """Knows nothing yet but the states that are `expected`, for want of a machine."""
        self._expected = tuple(expected)
        self.state = ""
        self.since_ns = 0
        self.progress = 0.0
        self.text = ""
        self.moves: deque[Move] = deque(maxlen=_KEPT)
        self.machine: Machine | None = None

    def take_state(self, said: ControllerState) -> None:
        """The controller says what it does."""
        if said.stage != self.state:
            if self.state:
                self.moves.append(Move(said.t_ns, self.state, said.stage, said.text))
            self.state, self.since_ns = said.stage, said.t_ns
        elif said.text and self.moves and self.moves[-1].to == said.stage and not self.moves[-1].why:
            self.moves[-1] = self.moves[-1]._replace(why=said.text)  # a command was faster than the reason
        self.progress = said.progress
        self.text = said.text

    def take_stage(self, t_ns: int, stage: str) -> None:
        """A command names the stage that sends it: all that a recording of the loop has."""
        if stage and stage != self.state:
            self.take_state(ControllerState(t_ns=t_ns, stage=stage, progress=self.progress))

    @property
    def states(self) -> tuple[str, ...]:
        """All states that are known, in the controller's order or in that of their appearance."""
        known = self._expected if self.machine is None else self.machine.states
        seen = [*(name for move in self.moves for name in (move.state, move.to)), self.state]
        return tuple(dict.fromkeys(name for name in (*known, *seen) if name))

    @property
    def arrows(self) -> tuple[tuple[str, str, str], ...]:
        """(state, event, next state): those that the controller told, or those that were seen."""
        if self.machine is not None and self.machine.moves:
            return tuple((move[0], move[1], move[2]) for move in self.machine.moves if len(move) == 3)
        return tuple(dict.fromkeys((move.state, move.why, move.to) for move in self.moves))
