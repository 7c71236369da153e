"""Progress display of a run: controller stage, simulated time, real-time factor."""

import time

from rich.console import Console
from rich.live import Live
from rich.text import Text

from skinnet.errors import ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import ControllerState, decode
from skinnet.transport.interface import PublicSession

__all__ = ["ProgressDisplay"]

_BAR_WIDTH = 24
_PLAIN_PERIOD_S = 10.0


class ProgressDisplay:
    """Progress display of the controller state: a live line on a terminal, otherwise a line every 10 s."""

    def __init__(self, console: Console, quiet: bool = False) -> None:
        self._console = console
        self._quiet = quiet
        self._live: Live | None = None
        self._start_s = time.monotonic()
        self._printed_s = 0.0
        self._stage = ""
        self.t_ns = 0

    def __enter__(self) -> "ProgressDisplay":
        self._start_s = time.monotonic()
        if not self._quiet and self._console.is_terminal:
            self._live = Live(Text("starting processes …"), console=self._console, refresh_per_second=8)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def subscribe(self, session: PublicSession, keys: Keys) -> None:
        """Subscribe to the controller state and show each one."""
        session.declare_subscriber(keys.of("state"), self._on_state)

    def print_line(self, text: str) -> None:
        """Print a line above the live one."""
        if not self._quiet:
            self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def _on_state(self, _key: str, payload: bytes) -> None:
        try:
            state = decode(payload, ControllerState)
        except ProtocolError:
            return
        if self.t_ns == 0:
            self._start_s = time.monotonic()  # measure from the start of the simulation, without the imports
        self.t_ns = max(state.t_ns, 1)
        wall_s = time.monotonic() - self._start_s
        pace = self.t_ns * 1e-9 / wall_s if wall_s > 0.5 else 0.0
        done = round(_BAR_WIDTH * state.progress)
        line = (
            f"{state.stage:<20} {'━' * done}{'╌' * (_BAR_WIDTH - done)} {self.t_ns * 1e-9:7.1f} s simulated"
            f"{f', {pace:.1f} × real time' if pace else ''}  {state.text}"
        )
        if self._live is not None:
            self._live.update(Text(line))
        elif state.stage != self._stage or wall_s - self._printed_s > _PLAIN_PERIOD_S:
            self._printed_s = wall_s
            self.print_line(line)
        self._stage = state.stage
