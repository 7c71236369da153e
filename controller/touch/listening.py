"""The stage of listening."""

import numpy as np
from numpy.typing import NDArray

from controller.skin_input import SkinRows
from controller.touch.fusion import TactilePicture

__all__ = ["Listen"]


class Listen:
    """Takes in whatever the skin says, and holds still."""

    gains = None
    thresholds = None
    felt = None
    label = ""
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

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], picture: TactilePicture
    ) -> NDArray[np.float64]:
        """No motion."""
        self._t_ns = t_ns
        return np.zeros(len(position_rad))

    def finish(self, t_ns: int) -> None:
        """Nothing is learnt."""
