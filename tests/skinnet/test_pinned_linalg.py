"""Pinned linear algebra: the results of NumPy and SciPy to rounding, and the same bits on any CPU."""

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from skinnet import pinned_linalg
from skinnet.pinned_least_squares import least_squares, non_negative_least_squares
from skinnet.pinned_rotations import mean_rotation, rotation_matrices, rotation_vectors

Floats = NDArray[np.float64]
SIZES = (1, 2, 3, 6, 13)


def drawn(*shape: int) -> Floats:
    return np.random.default_rng(sum(shape)).normal(size=shape)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ((3, 3), (3,)),
        ((3,), (3, 4)),
        ((4, 3), (3, 2)),
        ((5, 3, 3), (3, 3)),
        ((3, 3), (5, 3, 3)),
        ((5, 3, 3), (5, 3, 2)),
        ((5, 3, 3), (3,)),
        ((2, 5, 3, 3), (5, 3, 3)),
        ((0, 3, 3), (3, 3)),
        ((4, 0), (0, 2)),
    ],
)
def test_products_are_those_of_numpy(left: tuple[int, ...], right: tuple[int, ...]) -> None:
    a, b = drawn(*left), drawn(*right)
    product = pinned_linalg.matmul(a, b)
    assert product.shape == (a @ b).shape
    np.testing.assert_allclose(product, a @ b, rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(product, pinned_linalg.matmul(np.asfortranarray(a), b[...]))


def test_sums_are_taken_in_order() -> None:
    """1 + 2⁻⁵³ + 2⁻⁵³ is 1 from the left and 1 + 2⁻⁵² from the right; fused, the last sum would not be 0."""
    tiny = 2.0**-53
    assert pinned_linalg.dot([1.0, tiny, tiny], [1.0, 1.0, 1.0]) == 1.0
    assert pinned_linalg.dot([tiny, tiny, 1.0], [1.0, 1.0, 1.0]) == 1.0 + 2.0**-52
    x = 1.0 + 2.0**-30
    assert pinned_linalg.dot([1.0 + 2.0**-29, x], [-1.0, x]) == 0.0
    assert pinned_linalg.matmul([[1.0 + 2.0**-29, x]], [[-1.0], [x]]) == 0.0


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"product of \(3, 3\) and \(2,\): inner sizes must be equal"):
        pinned_linalg.matmul(np.eye(3), np.ones(2))
    with pytest.raises(ValueError, match="two vectors of one length"):
        pinned_linalg.dot(np.ones(3), np.ones(2))


@pytest.mark.parametrize("n", SIZES)
def test_solutions_determinants_and_eigenvalues(n: int) -> None:
    a, vector, several = drawn(n, n), drawn(n), drawn(n, 4)
    symmetric = a + a.T
    values, vectors = pinned_linalg.symmetric_eigen(symmetric)
    np.testing.assert_allclose(pinned_linalg.solve(a, vector), np.linalg.solve(a, vector), rtol=1e-9)
    np.testing.assert_allclose(pinned_linalg.solve(a, several), np.linalg.solve(a, several), rtol=1e-9)
    np.testing.assert_allclose(pinned_linalg.determinant(a), np.linalg.det(a), rtol=1e-10)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(symmetric), atol=1e-12)
    np.testing.assert_allclose(symmetric @ vectors, vectors * values, atol=1e-12)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(n), atol=1e-13)
    assert pinned_linalg.smallest_eigenvalue(symmetric) == values[0]
    np.testing.assert_allclose(pinned_linalg.norm(a), np.linalg.norm(a), rtol=1e-14)


def test_stacks_are_solved_one_by_one() -> None:
    a, b = drawn(5, 3, 3), drawn(5, 3, 2)
    np.testing.assert_allclose(pinned_linalg.solve(a, b), np.linalg.solve(a, b), rtol=1e-10)
    np.testing.assert_allclose(pinned_linalg.determinant(a), np.linalg.det(a), rtol=1e-12)
    assert pinned_linalg.solve(a[:0], b[:0]).shape == (0, 3, 2)


def test_singular_matrices_are_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        pinned_linalg.solve(np.ones((2, 2)), np.ones(2))
    assert pinned_linalg.determinant(np.ones((2, 2))) == 0.0


@pytest.mark.parametrize("size", [1e-6, 0.3, 4.0, 30.0])
def test_exponential_is_that_of_scipy(size: float) -> None:
    a = size * drawn(4, 4) / 4.0
    np.testing.assert_allclose(pinned_linalg.exponential(a), scipy.linalg.expm(a), rtol=1e-11)


def test_least_squares_are_those_of_numpy_unless_columns_depend() -> None:
    a, b = drawn(7, 4), drawn(7)
    np.testing.assert_allclose(least_squares(a, b), np.linalg.lstsq(a, b)[0], rtol=1e-12)
    assert least_squares(np.column_stack([a, a[:, 0] + a[:, 1]]), b) is None
    assert least_squares(a[:3], b[:3]) is None


@pytest.mark.parametrize("seed", range(20))
def test_non_negative_least_squares_are_as_good_as_those_of_scipy(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, columns = int(random.integers(2, 10)), int(random.integers(3, 30))
    a, b = random.normal(size=(rows, columns)), random.normal(size=rows)
    a[:, 1], a[:, 2] = a[:, 0], a[:, 0] * (1.0 + 1e-9)  # cells that do the same
    x = non_negative_least_squares(a, b)
    assert (x >= 0.0).all()
    assert np.linalg.norm(a @ x - b) == pytest.approx(nnls(a, b)[1], abs=1e-9)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-12, 1e-5, 1.1e-3, 1.0, 3.0, np.pi - 1e-9])
def test_rotations_are_those_of_scipy(angle_rad: float) -> None:
    axes = drawn(20, 3)
    vectors = angle_rad * axes / np.linalg.norm(axes, axis=1)[:, None]
    matrices = rotation_matrices(vectors)
    np.testing.assert_allclose(matrices, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(rotation_vectors(matrices), vectors, atol=1e-14, rtol=2e-15)


def test_half_turns_keep_their_axis() -> None:
    vectors = np.pi * np.eye(3)
    found = rotation_vectors(rotation_matrices(vectors))
    np.testing.assert_allclose(np.abs(found), vectors, atol=1e-15)


def test_mean_rotation_is_that_of_scipy() -> None:
    matrices = Rotation.from_rotvec(drawn(9, 3)).as_matrix()
    weights = np.abs(drawn(9))
    expected = Rotation.from_matrix(matrices).mean(weights).as_matrix()
    np.testing.assert_allclose(mean_rotation(matrices, weights), expected, atol=1e-13)
