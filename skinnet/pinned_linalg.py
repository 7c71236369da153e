"""Linear algebra of small matrices whose results do not depend on the CPU: sums in one order, in loops.

NumPy's `@`, `dot`, `linalg` and SciPy's `linalg` call a BLAS that chooses its kernel, and so the order of its
sums and its use of fused multiply-add, by the CPU. Below some ten rows these loops are as fast. Of NumPy's
own functions `einsum` without `optimize`, `cross`, and `linalg.norm` with an axis call no BLAS.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.compilation import compiled

__all__ = [
    "determinant",
    "dot",
    "exponential",
    "matmul",
    "norm",
    "smallest_eigenvalue",
    "solve",
    "symmetric_eigen",
]

Floats = NDArray[np.float64]

_MAX_SWEEPS = 60
"""Sweeps of Jacobi's method; some six to eight make a small matrix diagonal."""
_TERMS = 20
"""Terms of the exponential series: at a norm of ½ the rest is below 10⁻²⁵."""


@compiled
def _dot(a: Floats, b: Floats) -> float:
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@compiled
def _product(a: Floats, b: Floats) -> Floats:
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@compiled
def _image(a: Floats, b: Floats) -> Floats:
    out = np.empty(len(a))
    for i in range(len(a)):
        total = 0.0
        for k in range(b.size):
            total += a[i, k] * b[k]
        out[i] = total
    return out


@compiled
def _products(a: Floats, b: Floats, n_products: int) -> Floats:
    """Return the products of a (s, m, k) and b (s, k, n); one of them may have s = 1."""
    out = np.zeros((n_products, a.shape[1], b.shape[2]))
    for s in range(n_products):
        left, right = a[s if len(a) > 1 else 0], b[s if len(b) > 1 else 0]
        for i in range(out.shape[1]):
            for k in range(left.shape[1]):
                for j in range(out.shape[2]):
                    out[s, i, j] += left[i, k] * right[k, j]
    return out


@compiled
def _eliminate(a: Floats, b: Floats) -> float:
    """Solve a x = b in place, x in b (n, m), by elimination with partial pivoting; return det a."""
    n = len(a)
    determinant: float = 1.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        determinant *= a[pivot, k]
        if a[pivot, k] == 0.0:
            return determinant
        if pivot != k:
            determinant = -determinant
            for j in range(n):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            for j in range(b.shape[1]):
                b[k, j], b[pivot, j] = b[pivot, j], b[k, j]
        for i in range(k + 1, n):
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, n):
                a[i, j] -= factor * a[k, j]
            for j in range(b.shape[1]):
                b[i, j] -= factor * b[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(b.shape[1]):
            for i in range(k + 1, n):
                b[k, j] -= a[k, i] * b[i, j]
            b[k, j] /= a[k, k]
    return determinant


@compiled
def _solve_all(a: Floats, b: Floats, determinants: Floats) -> None:
    for s in range(len(a)):
        determinants[s] = _eliminate(a[s], b[s])


@compiled
def _diagonalise(a: Floats, vectors: Floats) -> None:
    """Make a symmetric `a` (n, n) diagonal by Jacobi's rotations, which are applied to `vectors` as well."""
    n = len(a)
    for _ in range(_MAX_SWEEPS):
        off = 0.0
        for p in range(n):
            for q in range(p + 1, n):
                off += abs(a[p, q])
        if not off > 0.0:
            return
        for p in range(n):
            for q in range(p + 1, n):
                size = abs(a[p, q])
                if abs(a[p, p]) + size == abs(a[p, p]) and abs(a[q, q]) + size == abs(a[q, q]):
                    a[p, q] = a[q, p] = 0.0
                    continue
                theta = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
                t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(1.0 + theta * theta))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(n):
                    a[k, p], a[k, q] = c * a[k, p] - s * a[k, q], s * a[k, p] + c * a[k, q]
                for k in range(n):
                    a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
                    vectors[k, p], vectors[k, q] = (
                        c * vectors[k, p] - s * vectors[k, q],
                        s * vectors[k, p] + c * vectors[k, q],
                    )


def _array(values: ArrayLike) -> Floats:
    return _writable(np.ascontiguousarray(values, dtype=np.float64))


def _writable(values: Floats) -> Floats:
    """Return a copy of read-only values: to Numba they are another type, for which it compiles again."""
    return values if values.flags.writeable else values.copy()


def dot(a: ArrayLike, b: ArrayLike) -> float:
    """Return the scalar product of two vectors (n,)."""
    one, other = _array(a), _array(b)
    if one.ndim != 1 or one.shape != other.shape:
        raise ValueError(
            f"scalar product of {one.shape} and {other.shape}: two vectors of one length are due"
        )
    return float(_dot(one, other))


def norm(vector: ArrayLike) -> float:
    """Return the Euclidean norm of a vector (n,), or of all entries of an array."""
    flat = _array(vector).ravel()
    return math.sqrt(_dot(flat, flat))


def matmul(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return a @ b, of vectors, matrices or stacks of matrices (…, m, k) and (…, k, n) as in NumPy.

    For two vectors use `dot`.
    """
    left, right = _array(a), _array(b)
    if left.shape[-1] != right.shape[max(right.ndim - 2, 0)]:
        raise ValueError(f"product of {left.shape} and {right.shape}: inner sizes must be equal")
    if left.ndim == 2 and right.ndim <= 2:
        image: Floats = _image(left, right) if right.ndim == 1 else _product(left, right)
        return image
    if left.ndim == 1:
        row: Floats = matmul(left[None], right)[..., 0, :]
        return row
    if right.ndim == 1:
        column: Floats = matmul(left, right[:, None])[..., 0]
        return column
    stack = np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
    products = _products(_one_stack(left, stack), _one_stack(right, stack), math.prod(stack))
    result: Floats = products.reshape(*stack, left.shape[-2], right.shape[-1])
    return result


def _one_stack(matrices: Floats, stack: tuple[int, ...]) -> Floats:
    """Return matrices (…, m, n) as one stack (s, m, n), of one only if they have no stack, else of all."""
    if matrices.ndim > 2:
        matrices = _array(np.broadcast_to(matrices, (*stack, *matrices.shape[-2:])))
    return matrices.reshape(math.prod(matrices.shape[:-2]), *matrices.shape[-2:])


def solve(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return x of a x = b for a (…, n, n) and b (…, n, m), or b (n,) with one matrix.

    Raises:
        numpy.linalg.LinAlgError: a matrix is singular.
    """
    matrix, x = np.array(a, dtype=np.float64, order="C"), np.array(b, dtype=np.float64, order="C")
    n = matrix.shape[-1]
    matrices, columns = matrix.reshape(-1, n, n), 1 if x.ndim == 1 else x.shape[-1]
    right = x.reshape(len(matrices), n, columns)
    determinants = np.empty(len(matrices))
    _solve_all(matrices, right, determinants)
    if not np.all(determinants != 0.0):
        raise np.linalg.LinAlgError("singular matrix")
    return right.reshape(x.shape)


def determinant(a: ArrayLike) -> Floats:
    """Return the determinants (…) of matrices (…, n, n)."""
    matrix = np.array(a, dtype=np.float64, order="C")
    n, stack = matrix.shape[-1], matrix.shape[:-2]
    determinants = np.empty(math.prod(stack))
    _solve_all(matrix.reshape(-1, n, n), np.empty((len(determinants), n, 0)), determinants)
    return determinants.reshape(stack)


def symmetric_eigen(a: ArrayLike) -> tuple[Floats, Floats]:
    """Return eigenvalues (n,), ascending, and eigenvectors, the columns (n, n), of a symmetric matrix.

    By Jacobi's method (Golub and van Loan, Matrix Computations, 8.5).
    """
    matrix = np.array(a, dtype=np.float64, order="C")
    vectors = np.eye(len(matrix))
    _diagonalise(matrix, vectors)
    values = np.diagonal(matrix)
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order]


def smallest_eigenvalue(a: ArrayLike) -> float:
    """Return the smallest eigenvalue of a symmetric matrix (n, n)."""
    return float(symmetric_eigen(a)[0][0])


def exponential(a: ArrayLike) -> Floats:
    """Return the exponential of a matrix (n, n): its series at a norm below ½, squared again and again."""
    matrix = _array(a)
    _, exponent = math.frexp(float(np.abs(matrix).sum(axis=1).max()))
    squarings = max(exponent + 1, 0)
    small = matrix * math.ldexp(1.0, -squarings)
    result = np.eye(len(matrix))
    for term in range(_TERMS, 0, -1):
        result = np.eye(len(matrix)) + matmul(small, result) / term
    for _ in range(squarings):
        result = matmul(result, result)
    return result
