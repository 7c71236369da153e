"""References to named tuples: compiled code reads and writes what the tuple holds."""

import copy
import gc
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.compiled_reference import reference


class Weights(NamedTuple):
    factor: float
    offset: int
    is_used: NDArray[np.bool_]
    table: NDArray[np.float64]


class Problem(NamedTuple):
    rows: NDArray[np.int64]
    weights: Weights
    result: NDArray[np.float64]


def problem() -> Problem:
    table = np.arange(6.0).reshape(3, 2)
    weights = Weights(0.5, 7, np.array([True, False, True]), table)
    return Problem(np.array([2, 0], dtype=np.int64), weights, np.zeros(2))


@compiled_without_nrt
def row_sum(weights: Weights, row: int) -> float:
    return weights.table[row, 0] + weights.table[row, 1]


@compiled_without_nrt
def fill(given: Problem) -> int:
    weights, used = given.weights, 0
    for i in range(len(given.rows)):
        row = given.rows[i]
        given.result[i] = weights.factor * row_sum(weights, row) + weights.offset
        used += weights.is_used[row]
    return used


def test_compiled_code_reads_and_writes_the_arrays_of_the_tuple() -> None:
    plain, held = problem(), problem()
    assert fill(reference(held)) == fill(plain) == 2
    assert held.result.tolist() == plain.result.tolist() == [0.5 * 9.0 + 7, 0.5 * 1.0 + 7]


def test_later_changes_of_the_arrays_are_seen() -> None:
    held = problem()
    given = reference(held)
    fill(given)
    held.weights.table[:] = 0.0
    held.rows[:] = 1
    assert fill(given) == 0
    assert given.result.tolist() == [7.0, 7.0]


def test_a_reference_within_a_tuple_reads_alike() -> None:
    class Outer(NamedTuple):
        inner: Problem

    @numba.njit
    def filled(outer: Outer) -> int:
        return fill(outer.inner)

    held = problem()
    assert filled(reference(Outer(reference(held)))) == 2
    assert held.result.tolist() == [11.5, 7.5]


def test_a_reference_keeps_its_arrays() -> None:
    given = reference(problem())
    gc.collect()
    hindrance = [np.full(6, -1.0) for _ in range(1000)]
    assert fill(given) == 2
    assert given.result.tolist() == [11.5, 7.5]
    assert len(hindrance) == 1000


def test_a_copy_is_refused() -> None:
    with pytest.raises(TypeError, match="cannot be copied"):
        copy.deepcopy(reference(problem()))


def test_a_missing_attribute_is_refused_in_compiled_code() -> None:
    @numba.njit
    def wrong(given: Problem) -> float:
        return given.weights.missing

    with pytest.raises(numba.TypingError, match="missing"):
        wrong(reference(problem()))


FOREIGN = """
from typing import NamedTuple
import numpy as np
from skinnet.compiled_reference import reference

class Own(NamedTuple):
    values: np.ndarray

reference(Own(np.zeros(3)))
"""
OURS = """
from skinnet.body.contact.loaded_points import no_loaded_points
from skinnet.compiled_reference import reference

reference(no_loaded_points(3))
"""


def test_classes_of_one_program_do_not_break_the_next(tmp_path: Path) -> None:
    """The on-disk cache is shared, and a class of a script can be imported by that script only."""
    (tmp_path / "foreign.py").write_text(FOREIGN)
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    for code, path in (("import foreign", str(tmp_path)), (OURS, ""), (OURS, "")):
        paths = os.pathsep.join(filter(None, (path, os.environ.get("PYTHONPATH", ""))))
        done = subprocess.run(
            [sys.executable, "-P", "-c", code],
            env=environment | {"PYTHONPATH": paths},
            capture_output=True,
            text=True,
            check=False,
            timeout=100,
        )
        assert done.returncode == 0, done.stderr
