"""Tactile reactions: joint velocities from cell readings, equation (4) of [M14, V.A]."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.touch.tactile_state import COLUMNS, REACTION_COLUMNS
from skinnet.protocol.messages import Modality

__all__ = ["TactileReaction"]


class TactileReaction:
    """Proportional controllers of all cells and touch channels, superposed by the sensory-motor map.

    Thresholds and gains are set per cell and modality and may change at any tick; a gain of zero inhibits.
    """

    def __init__(self, n_cells: int) -> None:
        """Start with all gains zero."""
        channels = REACTION_COLUMNS.stop - REACTION_COLUMNS.start
        self._thresholds = np.zeros((n_cells, channels))
        self._gains = np.zeros((n_cells, channels))

    @property
    def gains(self) -> NDArray[np.float64]:
        """Copy of the gains (S, 4) of `REACTION_COLUMNS` [rad/s per reading]."""
        return self._gains.copy()

    def tune(
        self,
        modality: Modality,
        *,
        threshold: float,
        gain: float,
        cells: Sequence[int] | NDArray[np.int64] | None = None,
    ) -> None:
        """Set threshold and gain of a modality, for all cells or those of an area.

        Args:
            modality: Force or proximity.
            threshold: Reading above which there is a reaction, not negative.
            gain: [rad/s per reading above the threshold] for a map vector of norm one; positive evades, zero
                inhibits.
            cells: Cell indices of the area; all if None.

        Raises:
            ValueError: another modality, a negative threshold, or a number that is not finite.
        """
        if modality not in (Modality.FORCE, Modality.PROXIMITY):
            raise ValueError(f"no reaction to {modality.name}; tune FORCE or PROXIMITY")
        if not (0.0 <= threshold < np.inf and np.isfinite(gain)):
            raise ValueError(
                f"threshold {threshold} and gain {gain} must be finite, the threshold not negative"
            )
        rows: Any = slice(None) if cells is None else np.asarray(cells, dtype=np.int64)
        self._thresholds[rows, COLUMNS[modality]] = threshold
        self._gains[rows, COLUMNS[modality]] = gain

    def inhibit(self) -> None:
        """Set all gains to zero."""
        self._gains[:] = 0.0

    @property
    def thresholds(self) -> NDArray[np.float64]:
        """Reaction thresholds (S, 4) of `REACTION_COLUMNS`; inf where the gain is zero."""
        return np.where(self._gains != 0.0, self._thresholds, np.inf)

    def activation(self, touch: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the activation (S,) [rad/s]: sum over channels of (ρ > t)·(ρ − t)·P, for readings (S, 4)."""
        drive = np.where(touch > self.thresholds, (touch - self._thresholds) * self._gains, 0.0)
        total: NDArray[np.float64] = drive.sum(axis=1)
        return total

    def velocity(self, touch: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute the joint velocities (D,) [rad/s] superposed of all cells: equation (4) of [M14].

        Args:
            touch: (S, 4) readings of `REACTION_COLUMNS`.
            weights: (S, D) sensory-motor map of the closest pose.
        """
        activation = self.activation(touch)
        # sums touched cells only, and plainly, as the summation order of a BLAS product may depend on threads
        touched = np.flatnonzero(activation)
        total: NDArray[np.float64] = (activation[touched, None] * weights[touched]).sum(axis=0)
        return total
