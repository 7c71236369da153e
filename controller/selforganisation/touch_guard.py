"""Touch guard of the explorations: notices contact, and what comes nearer, during a motion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["TouchGuard", "TouchLimits"]

_FORCE = slice(0, 3)
_PROXIMITY = 3


@dataclass(frozen=True)
class TouchLimits:
    """Readings that stop a motion, compared with the largest before it; all numbers are assumptions."""

    force_rise: float = 0.05
    """Rise of a force reading: 0.6 N, twelve standard deviations of its noise."""
    proximity: float = 0.02
    """Proximity reading below which nothing is near: medium proximity of Table I [M14], 34 mm."""
    proximity_ratio: float = 1.5
    """Ratio to the reading before, for what is near already, such as the next link: a third less distance."""


class TouchGuard:
    """Guard of a motion: compares force and proximity of all cells with those at rest before it."""

    def __init__(self, n_cells: int, limits: TouchLimits) -> None:
        """Start at rest, without readings."""
        self._limits = limits
        self._at_rest = np.zeros((n_cells, 4))
        self._tripped = np.zeros(n_cells, dtype=np.bool_)
        self._armed = False

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cells (n,) that have noticed something since the motion began."""
        return np.flatnonzero(self._tripped)

    def rest(self) -> None:
        """Begin a rest: its readings are those to compare with."""
        self._at_rest[:] = 0.0
        self._armed = False

    def arm(self) -> None:
        """Begin a motion."""
        self._tripped[:] = False
        self._armed = True

    def disarm(self) -> None:
        """End the motion; the readings until the next rest count for nothing."""
        self._armed = False

    def add(self, cells: NDArray[np.int64], touch: NDArray[np.float64]) -> None:
        """Add readings (n, 4) of cells (n,): three of force and one of proximity."""
        if not self._armed:
            np.maximum.at(self._at_rest, cells, touch)
            return
        limits, at_rest = self._limits, self._at_rest[cells]
        pressed = (touch[:, _FORCE] > at_rest[:, _FORCE] + limits.force_rise).any(axis=1)
        near = np.maximum(limits.proximity, limits.proximity_ratio * at_rest[:, _PROXIMITY])
        self._tripped[cells[pressed | (touch[:, _PROXIMITY] > near)]] = True
