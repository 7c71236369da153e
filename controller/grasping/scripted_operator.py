"""Scripted operator of a deployment: a sequence of requests with conditions."""

from collections import deque
from collections.abc import Sequence

from controller.grasping.state_machine import RESTING_STATES, State
from skinnet.clock import NS_PER_S
from skinnet.deployment.controller.teach_and_grasp import OperatorRequestSpec

__all__ = ["ScriptedOperator"]


class ScriptedOperator:
    """Scripted operator; a request is due by the stage's state, its duration and the last touch.

    Args:
        script: Requests in their order.
        timeout_ns: Time to wait at rest for a state that does not occur.
        t_ns: Current time.
    """

    def __init__(self, script: Sequence[OperatorRequestSpec], timeout_ns: int, t_ns: int) -> None:
        self._script = deque(script)
        self._scripted = bool(script)
        self._timeout_ns = timeout_ns
        self._state: State | None = None
        self._state_start_ns = self._last_request_ns = self._last_touch_ns = t_ns

    def next_request(self, t_ns: int, state: State, *, touched: bool) -> tuple[str, str] | None:
        """Return the request due at `t_ns` with its argument, or None; `touched`: a reaction is active."""
        if state is not self._state:
            self._state, self._state_start_ns = state, t_ns
            self._last_touch_ns = t_ns
        if touched:
            self._last_touch_ns = t_ns
        if not self._script:
            return None
        step = self._script[0]
        waited_ns = t_ns - max(self._state_start_ns, self._last_request_ns)
        quiet_ns = t_ns - max(self._last_touch_ns, self._last_request_ns)
        if (
            state.value != step.state
            or waited_ns < round(step.delay_s * NS_PER_S)
            or quiet_ns < round(step.contact_free_s * NS_PER_S)
        ):
            return None
        self._script.popleft()
        self._last_request_ns = t_ns
        return step.request, step.argument

    def timed_out(self, t_ns: int, state: State) -> bool:
        """Return True if the script is over or blocked, and the stage at rest beyond the timeout."""
        waits = bool(self._script) and self._script[0].state == state.value
        rested_ns = t_ns - max(self._state_start_ns, self._last_request_ns)
        return self._scripted and not waits and state in RESTING_STATES and rested_ns >= self._timeout_ns
