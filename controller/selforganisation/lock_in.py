"""Lock-in detection: amplitude and phase at a known frequency, from non-uniform samples."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.pinned_linalg import determinant, solve

__all__ = ["LockIn"]


class LockIn:
    """Lock-in detector: online least squares of offset, cosine and sine at one frequency.

    The largest sample of a noisy sine overestimates it by about three standard deviations of the noise; the
    least-squares amplitude has no such bias, and it has a phase. Only sums are stored, never samples.
    """

    def __init__(self, n_rows: int, n_channels: int, frequency_hz: float) -> None:
        """Start empty; every row, such as a cell, may have its own sampling times."""
        self._frequency_hz = frequency_hz
        self._n_rows, self._n_channels = n_rows, n_channels
        self._gram = np.zeros((n_rows, 3, 3))
        self._moment = np.zeros((n_rows, 3, n_channels))

    def add(self, rows: NDArray[np.int64], t_s: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        """Add samples: rows (n,), times (n,) [s], values (n, channels)."""
        phase = 2.0 * math.pi * self._frequency_hz * t_s
        basis = np.stack([np.ones_like(phase), pinned_math.cos_of(phase), pinned_math.sin_of(phase)], axis=1)
        self._gram += self._per_row(rows, basis[:, :, None] * basis[:, None, :])
        self._moment += self._per_row(rows, basis[:, :, None] * values[:, None, :])

    def amplitude(self, min_samples: int) -> NDArray[np.complex128]:
        """Return complex amplitudes (rows, channels), c of Re(c·exp(i·2πft)).

        NaN in rows with fewer than `min_samples` samples, or an ill-conditioned Gram matrix.
        """
        # the determinant of a well-sampled row's Gram matrix over n³ is 1/4; at 1e-3 it is nearly singular
        count = self._gram[:, 0, 0]
        usable = (count >= max(min_samples, 3)) & (determinant(self._gram) > 1e-3 * count * count * count)
        result = np.full((self._n_rows, self._n_channels), np.nan + 0j)
        cosine, sine = solve(self._gram[usable], self._moment[usable])[:, 1:].transpose(1, 0, 2)
        result.real[usable], result.imag[usable] = cosine, -sine
        return result

    def _per_row(self, rows: NDArray[np.int64], terms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum terms (n, a, b) by row into (rows, a, b)."""
        shape = (self._n_rows, *terms.shape[1:])
        width = int(np.prod(terms.shape[1:]))
        slots = rows[:, None] * width + np.arange(width)
        sums = np.bincount(slots.ravel(), weights=terms.ravel(), minlength=self._n_rows * width)
        return sums.reshape(shape)
