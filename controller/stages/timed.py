"""Base class of stages with a fixed duration."""

from controller.cell_input import CellRows

__all__ = ["TimedStage"]


class TimedStage:
    """Stage of the program with a fixed duration and without a result."""

    state_name = reason = ""
    needs_stream = False

    def __init__(self, duration_s: float, start_ns: int) -> None:
        self._start_ns, self._t_ns = start_ns, start_ns
        self._duration_ns = round(duration_s * 1e9)

    @property
    def done(self) -> bool:
        """True once the duration has elapsed."""
        return self._t_ns - self._start_ns >= self._duration_ns

    @property
    def progress(self) -> float:
        """Elapsed fraction of the duration, 0 to 1."""
        return min(1.0, (self._t_ns - self._start_ns) / self._duration_ns)

    def add_readings(self, stream: CellRows) -> None:
        """Ignore the readings: the tactile state contains them already."""

    def finish(self, t_ns: int) -> None:
        """Store nothing."""
