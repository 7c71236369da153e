"""Least squares of small problems whose results do not depend on the CPU, as `skinnet.pinned_linalg`."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.compilation import compiled
from skinnet.pinned_linalg import matmul

__all__ = ["least_squares", "non_negative_least_squares"]

Floats = NDArray[np.float64]

_DEPENDENT = 1e-10
"""Part of a column outside of the span of those before, by its length, below which it depends on them."""


@compiled
def _reduce(a: Floats, b: Floats) -> bool:
    """Solve min |a x − b| in place, x in the first n entries of b; False if a column depends on those before.

    Householder reflections (Golub and van Loan, Matrix Computations, 5.2).
    """
    m, n = a.shape
    for k in range(n):
        whole = rest = 0.0
        for i in range(m):
            whole += a[i, k] * a[i, k]
            if i >= k:
                rest += a[i, k] * a[i, k]
        if not rest > _DEPENDENT * _DEPENDENT * whole:
            return False
        alpha = -math.copysign(math.sqrt(rest), a[k, k])
        head = a[k, k] - alpha
        beta = -alpha * head  # half the square of the reflection's vector (head, a[k + 1:, k])
        for j in range(k + 1, n + 1):
            total = head * (a[k, j] if j < n else b[k])
            for i in range(k + 1, m):
                total += a[i, k] * (a[i, j] if j < n else b[i])
            factor = total / beta
            if j < n:
                a[k, j] -= factor * head
                for i in range(k + 1, m):
                    a[i, j] -= factor * a[i, k]
            else:
                b[k] -= factor * head
                for i in range(k + 1, m):
                    b[i] -= factor * a[i, k]
        a[k, k] = alpha
        for i in range(k + 1, m):
            a[i, k] = 0.0
    for k in range(n - 1, -1, -1):
        for i in range(k + 1, n):
            b[k] -= a[k, i] * b[i]
        b[k] /= a[k, k]
    return True


def least_squares(a: ArrayLike, b: ArrayLike) -> Floats | None:
    """Return x (n,) of least |a x − b| for a (m, n), by Householder's reflections; None if dependent.

    A column is dependent if 10⁻¹⁰ of it or less lies outside of the span of those before.
    """
    matrix, right = np.array(a, dtype=np.float64), np.array(b, dtype=np.float64)
    m, n = matrix.shape
    return right[:n] if n <= m and _reduce(matrix, right) else None


def non_negative_least_squares(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return x (n,) ≥ 0 of least |a x − b| for a (m, n) (Lawson and Hanson, 1974, chapter 23).

    Raises:
        RuntimeError: not solved within 3 n changes of the set of positive entries; a bug of ours.
    """
    matrix, right = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    n = matrix.shape[1]
    x, positive = np.zeros(n), np.zeros(n, dtype=np.bool_)
    tolerance = 1e-14 * float(np.abs(matmul(matrix.T, right)).max(initial=0.0))
    for _ in range(3 * n + 1):
        slope = matmul(matrix.T, right - matmul(matrix, x))
        slope[positive] = -np.inf
        wanted = None
        while wanted is None:
            if slope.max(initial=-np.inf) <= tolerance:
                return x
            entering = int(np.argmax(slope))
            slope[entering] = -np.inf
            wanted = _least_squares_of(matrix, right, positive | (np.arange(n) == entering))
            if wanted is not None and wanted[entering] <= 0.0:
                wanted = None  # it was positive by rounding only
        positive[entering] = True
        while (blocked := positive & (wanted <= 0.0)).any():
            steps = np.full(n, np.inf)
            steps[blocked] = x[blocked] / (x[blocked] - wanted[blocked])
            first = int(np.argmin(steps))
            x = x + steps[first] * (wanted - x)
            positive[first] = False
            positive &= x > 0.0
            x[~positive] = 0.0
            of_these = _least_squares_of(matrix, right, positive)
            if of_these is None:
                break
            wanted = of_these
        x = np.maximum(wanted, 0.0)
    raise RuntimeError("non-negative least squares: no solution within the number of steps")


def _least_squares_of(matrix: Floats, right: Floats, columns: NDArray[np.bool_]) -> Floats | None:
    """Return the least-squares solution (n,) on some columns, zero elsewhere; None if they are dependent."""
    found = least_squares(matrix[:, columns], right)
    if found is None:
        return None
    x = np.zeros(matrix.shape[1])
    x[columns] = found
    return x
