"""Recorded controller state: as published to observers, but by simulated time and lossless."""

from collections.abc import Iterable

from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import ControllerState, encode
from skinnet.runtime.loop import Put

__all__ = ["StateRecorder"]

_PERIOD_NS = 100_000_000


class StateRecorder:
    """Recorder output of states and answers: a state on change, every 0.1 s, and at the end.

    Args:
        keys: Keys of the robot.
    """

    def __init__(self, keys: Keys) -> None:
        self._state_key = keys.of("state")
        self._last_stage = ""
        self._next_ns = 0

    def tick(
        self, put: Put, state: ControllerState, messages: Iterable[tuple[str, bytes]], *, last: bool
    ) -> None:
        """Send the messages of the tick at `state.t_ns`, before the command that ends it.

        Args:
            put: Adds a message to the period.
            state: Controller state.
            messages: Keys and payloads of answers and capabilities.
            last: True at the last tick.
        """
        for key, payload in messages:
            put(key, payload)
        if state.stage != self._last_stage or state.t_ns >= self._next_ns or last:
            self._last_stage = state.stage
            self._next_ns = state.t_ns + _PERIOD_NS
            put(self._state_key, encode(state))
