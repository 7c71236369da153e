"""What the controller does, for a recording: as for watchers, but by simulated time and never lost."""

from collections.abc import Iterable

from skinnet.channels import Keys
from skinnet.loop import Put
from skinnet.messages import ControllerState, encode

__all__ = ["StateRecord"]

_EVERY_NS = 100_000_000


class StateRecord:
    """Puts states and answers into the loop: a state when it changes, every 0.1 s, and at the end.

    Args:
        keys: Keys of the robot.
    """

    def __init__(self, keys: Keys) -> None:
        self._state_key = keys.of("state")
        self._told = ""
        self._next_ns = 0

    def tick(
        self, put: Put, state: ControllerState, news: Iterable[tuple[str, bytes]], *, last: bool
    ) -> None:
        """Sends what there is to say of the tick at `state.t_ns`, before the command that closes it.

        Args:
            put: Sends.
            state: What the controller does.
            news: Keys and payloads of what else is new: answers, states and requests that there are.
            last: Whether it is the last tick.
        """
        for key, payload in news:
            put(key, payload)
        if state.stage != self._told or state.t_ns >= self._next_ns or last:
            self._told = state.stage
            self._next_ns = state.t_ns + _EVERY_NS
            put(self._state_key, encode(state))
