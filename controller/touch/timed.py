"""What stages have in common that last for a given time."""

from controller.skin_input import SkinRows

__all__ = ["TimedStage"]


class TimedStage:
    """A stage of the controller's program that ends with its time, and learns nothing."""

    label = why = ""
    wants_stream = False

    def __init__(self, duration_s: float, start_ns: int) -> None:
        self._start_ns, self._t_ns = start_ns, start_ns
        self._duration_ns = round(duration_s * 1e9)

    @property
    def done(self) -> bool:
        """The time of the stage is over."""
        return self._t_ns - self._start_ns >= self._duration_ns

    @property
    def progress(self) -> float:
        """Share of the stage's time."""
        return min(1.0, (self._t_ns - self._start_ns) / self._duration_ns)

    def take(self, stream: SkinRows) -> None:
        """The picture has taken them in already."""

    def finish(self, t_ns: int) -> None:
        """Nothing is learnt."""
