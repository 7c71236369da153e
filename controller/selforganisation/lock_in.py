"""Lock-in: amplitude and phase of a known frequency in samples with their own times."""

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["LockIn"]


class LockIn:
    """Online least squares of offset, cosine and sine at one frequency, for rows of channels.

    The largest sample of a noisy sine is too large by about three standard deviations of the noise; the
    least-squares amplitude has no such bias, and it has a phase. Only sums are kept, never samples.
    """

    def __init__(self, n_rows: int, n_channels: int, frequency_hz: float) -> None:
        """Starts empty; every row (a cell, say) may have sample times of its own."""
        self._frequency_hz = frequency_hz
        self._n_rows, self._n_channels = n_rows, n_channels
        self._gram = np.zeros((n_rows, 3, 3))
        self._moment = np.zeros((n_rows, 3, n_channels))

    def add(self, rows: NDArray[np.int64], t_s: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        """Takes in samples: rows (n,), times (n,) [s], values (n, channels)."""
        phase = 2.0 * math.pi * self._frequency_hz * t_s
        basis = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1)
        self._gram += self._per_row(rows, basis[:, :, None] * basis[:, None, :])
        self._moment += self._per_row(rows, basis[:, :, None] * values[:, None, :])

    def amplitude(self, min_samples: int) -> NDArray[np.complex128]:
        """(rows, channels) complex amplitude c of Re(c·exp(i·2πft)).

        NaN in rows with less than `min_samples` samples, or whose times do not tell sine from cosine.
        """
        # the determinant of a well-sampled row's Gram matrix over n³ is 1/4; 1e-3 is next to a blind one
        count = self._gram[:, 0, 0]
        usable = (count >= max(min_samples, 3)) & (np.linalg.det(self._gram) > 1e-3 * count**3)
        result = np.full((self._n_rows, self._n_channels), np.nan + 0j)
        cosine, sine = np.linalg.solve(self._gram[usable], self._moment[usable])[:, 1:].transpose(1, 0, 2)
        result[usable] = cosine - 1j * sine
        return result

    def _per_row(self, rows: NDArray[np.int64], terms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums terms (n, a, b) into (rows, a, b)."""
        shape = (self._n_rows, *terms.shape[1:])
        width = int(np.prod(terms.shape[1:]))
        slots = rows[:, None] * width + np.arange(width)
        sums = np.bincount(slots.ravel(), weights=terms.ravel(), minlength=self._n_rows * width)
        return sums.reshape(shape)
