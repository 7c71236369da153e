"""Pinned functions: accurate, and the same bits whatever the CPU's C library chooses."""

import math
import os
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from skinnet import pinned_arcs, pinned_math
from skinnet.compilation import compiled
from skinnet.run.arithmetic import battery_of_functions

Floats = NDArray[np.float64]
Function = Callable[[float], float]
WITHOUT_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX_Fast_Unaligned_Load"

small, wide = st.floats(-30.0, 30.0), st.floats(-700.0, 700.0)
positive = st.floats(1e-300, 1e300)
angles = st.floats(-1.6e6, 1.6e6)


def ulps(value: float, reference: float) -> float:
    return abs(value - reference) / math.ulp(reference)


@given(small, wide, positive, angles)
def test_values_are_those_of_the_c_library_to_the_last_place(
    x: float, power: float, argument: float, angle: float
) -> None:
    """The C library's own error is below 0.6 units in the last place."""
    assert ulps(pinned_math.log(argument), math.log(argument)) <= 1.0
    assert ulps(pinned_math.exp(power), math.exp(power)) <= 2.0
    assert ulps(pinned_math.sin(angle), math.sin(angle)) <= 2.0
    assert ulps(pinned_math.cos(angle), math.cos(angle)) <= 2.0
    assert ulps(pinned_math.expm1(x), math.expm1(x)) <= 4.0
    assert ulps(pinned_math.hypot(x, power), math.hypot(x, power)) <= 2.0
    assert ulps(pinned_math.log2(argument), math.log2(argument)) <= 2.0
    assert ulps(pinned_math.exp2(power), 2.0**power) <= 2.0
    assert ulps(pinned_arcs.atan2(x, power), math.atan2(x, power)) <= 2.0
    share = math.tanh(x) * 0.999
    assert ulps(pinned_arcs.asin(share), math.asin(share)) <= 1.0
    assert ulps(pinned_arcs.acos(share), math.acos(share)) <= 1.0
    assert ulps(pinned_math.log1p(share), math.log1p(share)) <= 3.0


def test_on_average_the_error_is_that_of_rounding() -> None:
    x = np.random.default_rng(1).uniform(0.0, 2.0 * math.pi, 20_000)
    for mine, theirs in (
        (pinned_math.sin, math.sin),
        (pinned_math.cos, math.cos),
        (pinned_math.log, math.log),
        (lambda v: pinned_arcs.asin(v / 7.0), lambda v: math.asin(v / 7.0)),
        (lambda v: pinned_arcs.acos(v / 7.0), lambda v: math.acos(v / 7.0)),
        (lambda v: pinned_arcs.atan2(v, 1.0), math.atan),
        (lambda v: pinned_math.log2(v), math.log2),
    ):
        assert np.mean([mine(v) != theirs(v) for v in x.tolist()]) < 0.2


@pytest.mark.parametrize(
    ("function", "x", "value"),
    [
        (pinned_math.log, 0.0, -math.inf),
        (pinned_math.log, -1.0, math.nan),
        (pinned_math.log, math.inf, math.inf),
        (pinned_math.log, 1.0, 0.0),
        (pinned_math.log, 5e-324, math.log(5e-324)),
        (pinned_math.exp, -1e4, 0.0),
        (pinned_math.exp, 1e4, math.inf),
        (pinned_math.exp, math.nan, math.nan),
        (pinned_math.expm1, -1e4, -1.0),
        (pinned_math.expm1, 1e-18, 1e-18),
        (pinned_math.log1p, -1.0, -math.inf),
        (pinned_math.log1p, 1e-18, 1e-18),
        (pinned_math.log2, 0.0, -math.inf),
        (pinned_math.log2, -1.0, math.nan),
        (pinned_math.log2, 2.0**40, 40.0),
        (pinned_math.log2, 5e-324, -1074.0),
        (pinned_math.exp2, 2000.0, math.inf),
        (pinned_math.exp2, -2000.0, 0.0),
        (pinned_math.exp2, -1074.0, 5e-324),
        (pinned_math.exp2, math.nan, math.nan),
        (pinned_arcs.asin, 1.0, 0.5 * math.pi),
        (pinned_arcs.asin, -1.0, -0.5 * math.pi),
        (pinned_arcs.asin, 1.0 + 1e-15, math.nan),
        (pinned_arcs.asin, math.nan, math.nan),
        (pinned_arcs.acos, 1.0, 0.0),
        (pinned_arcs.acos, -1.0, math.pi),
        (pinned_arcs.acos, -1.5, math.nan),
        (pinned_math.sin, math.inf, math.nan),
        (pinned_math.cos, 0.0, 1.0),
        (pinned_math.sin, math.pi, math.sin(math.pi)),
    ],
)
def test_ends_of_the_ranges(function: Function, x: float, value: float) -> None:
    assert function(x) == pytest.approx(value, rel=1e-15, abs=0.0, nan_ok=True)


@pytest.mark.parametrize("y", [0.0, -0.0, 2.0, -2.0, math.inf, -math.inf])
@pytest.mark.parametrize("x", [0.0, -0.0, 3.0, -3.0, math.inf, -math.inf, 1e-300])
def test_angles_of_vectors_have_the_signs_of_c(y: float, x: float) -> None:
    found = pinned_arcs.atan2(y, x)
    assert (found, math.copysign(1.0, found)) == (math.atan2(y, x), math.copysign(1.0, y))
    assert math.isnan(pinned_arcs.atan2(math.nan, x))


def test_lengths_of_what_is_not_finite() -> None:
    assert pinned_math.hypot(-math.inf, 1.0) == math.inf
    assert all(math.isnan(pinned_math.hypot(*v)) for v in ((math.nan, 0.0), (0.0, math.nan), (math.nan, 2.0)))
    assert pinned_math.hypot(3e200, 4e200) == pytest.approx(5e200, rel=1e-15)


def test_no_multiply_add_is_fused() -> None:
    """x² − (1 + 2⁻²⁹) for x = 1 + 2⁻³⁰ is 2⁻⁶⁰, which the rounding of x² loses unless it is fused."""

    @compiled
    def both(x: Floats, y: Floats, z: Floats) -> Floats:
        return x * y + z

    @compiled
    def each(x: Floats, y: Floats, z: Floats) -> float:
        total = 0.0
        for i in range(x.size):
            total += abs(x[i] * y[i] + z[i])
        return total

    x, z = np.full(64, 1.0 + 2.0**-30), np.full(64, -1.0 - 2.0**-29)
    assert not both(x, x, z).any()
    assert each(x, x, z) == 0.0


def test_angles_beyond_the_exact_reduction_are_as_good_as_they_are_known() -> None:
    for x in (3e6, 1e9, -7e12):
        assert pinned_math.sin(x) == pytest.approx(math.sin(x), abs=abs(x) * 2.0**-53)


def test_the_parts_of_a_quarter_turn_are_exact_to_a_hundred_bits() -> None:
    quarter = Fraction(31415926535897932384626433832795028841971, 2 * 10**40)
    for x in (1.0, 7.5, 1.5e6):
        n = math.floor(x / (math.pi / 2) + 0.5)
        rest = float(Fraction(x) - n * quarter)
        found = (pinned_math.sin, pinned_math.cos)[n & 1](x)
        assert abs(found) == pytest.approx(abs(math.sin(rest)), rel=4e-16)


@given(st.floats(0.0, 1.0))
def test_the_cosine_of_turns_is_that_of_the_angle(turns: float) -> None:
    """To the rounding of the angle, of up to 2π, that the C library is given."""
    expected = math.cos(2.0 * math.pi * turns)
    assert pinned_math.cos_of_turns(turns) == pytest.approx(expected, rel=0.0, abs=1.2e-15)


def test_arrays_keep_their_shape() -> None:
    x = np.linspace(-9.0, 9.0, 12).reshape(3, 4)
    assert pinned_math.sin_of(x).tolist() == [[pinned_math.sin(v) for v in row] for row in x.tolist()]
    y = x[::-1] / 9.0
    rows = list(zip(x.tolist(), y.tolist(), strict=True))
    assert pinned_math.hypot_of(x, y).tolist() == [
        [pinned_math.hypot(a, b) for a, b in zip(*row, strict=True)] for row in rows
    ]
    assert pinned_arcs.atan2_of(y, x).tolist() == [
        [pinned_arcs.atan2(b, a) for a, b in zip(*row, strict=True)] for row in rows
    ]
    assert pinned_arcs.asin_of(y).tolist() == [[pinned_arcs.asin(v) for v in row] for row in y.tolist()]
    assert pinned_math.cos_of(x.T).tolist() == [[pinned_math.cos(v) for v in row] for row in x.T.tolist()]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="tunables are those of glibc")
def test_the_bits_are_the_same_without_fused_multiply_add_in_the_c_library() -> None:
    program = "from skinnet.run.arithmetic import battery_of_functions as f; print(f())"
    environment = os.environ | {"GLIBC_TUNABLES": WITHOUT_FMA, "OPENBLAS_CORETYPE": "Nehalem"}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.strip() == battery_of_functions()
