"""Transcendental functions whose results do not depend on the CPU: IEEE + − × ÷ √ and nothing else.

The C library chooses its `sin`, `cos`, `exp`, `log` and `atan2` by the instruction set of the CPU (with or
without fused multiply-add), and NumPy's come from it or from kernels of its own: their last bits differ from
computer to computer, and so would the log of a run. These follow fdlibm (Sun Microsystems, 1993: e_log.c,
e_exp.c, k_sin.c, k_cos.c, e_rem_pio2.c), with errors below one unit in the last place unless
stated. Numba contracts no multiply-add, as `fastmath` is off.

Write x * x for a square: Python's x**2 is `pow` of the C library, and its last bit differs in one of 1000.
"""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled

__all__ = [
    "cos",
    "cos_of",
    "cos_of_turns",
    "exp",
    "exp2",
    "expm1",
    "hypot",
    "hypot_of",
    "log",
    "log1p",
    "log2",
    "sin",
    "sin_of",
]

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_LN2, _ONE_OVER_LN2 = 0.6931471805599453, 1.4426950408889634
_SQRT_HALF = 0.7071067811865476
_LOG = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)
_EXP = (
    1.66666666666666019037e-01,
    -2.77777777770155933842e-03,
    6.61375632143793436117e-05,
    -1.65339022054652515390e-06,
    4.13813679705723846039e-08,
)
_SIN = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COS = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
_TWO_OVER_PI = 6.36619772367581382433e-01
_PIO2 = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
"""π/2 in parts: two of 33 bits, whose products with a whole number below 2^20 are exact, and the rest."""
_LARGEST_EXACT_TURN = 1048576.0 * 1.5707963267948966
_OVERFLOW, _UNDERFLOW = 709.782712893383973096, -745.13321910194110842


@compiled
def log(x: float) -> float:
    """Return the natural logarithm of x; −inf at 0, NaN below."""
    if not x > 0.0:
        return -math.inf if x == 0.0 else math.nan
    if x == math.inf:
        return x
    fraction, exponent = math.frexp(x)
    if fraction < _SQRT_HALF:
        fraction *= 2.0
        exponent -= 1
    f = fraction - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (_LOG[1] + w * (_LOG[3] + w * _LOG[5]))
    odd = z * (_LOG[0] + w * (_LOG[2] + w * (_LOG[4] + w * _LOG[6])))
    half_square = 0.5 * f * f
    k = float(exponent)
    return k * _LN2_HIGH - ((half_square - (s * (half_square + (even + odd)) + k * _LN2_LOW)) - f)


@compiled
def log2(x: float) -> float:
    """Return the logarithm of x to base 2, exact at powers of two; error to 2 ulp. As `log` at its ends."""
    if not 0.0 < x < math.inf:
        return log(x)
    fraction, exponent = math.frexp(x)
    if fraction < _SQRT_HALF:
        fraction *= 2.0
        exponent -= 1
    return float(exponent) + log(fraction) * _ONE_OVER_LN2


@compiled
def log1p(x: float) -> float:
    """Return log(1 + x), correct for small x: the rounding of 1 + x is corrected (Kahan; error to 3 ulp)."""
    u = 1.0 + x
    if u == 1.0 or not u > 0.0 or u == math.inf:
        return x if u == 1.0 else log(u)
    return log(u) + (x - (u - 1.0)) / u


@compiled
def exp(x: float) -> float:
    """Return e to the power of x."""
    if math.isnan(x):
        return x
    if x > _OVERFLOW:
        return math.inf
    if x < _UNDERFLOW:
        return 0.0
    k = math.floor(x / (_LN2_HIGH + _LN2_LOW) + 0.5)
    high, low = x - k * _LN2_HIGH, k * _LN2_LOW
    r = high - low
    t = r * r
    c = r - t * (_EXP[0] + t * (_EXP[1] + t * (_EXP[2] + t * (_EXP[3] + t * _EXP[4]))))
    return math.ldexp(1.0 - ((low - (r * c) / (2.0 - c)) - high), int(k))


@compiled
def exp2(x: float) -> float:
    """Return 2 to the power of x, exact at whole numbers; error to 2 ulp."""
    if math.isnan(x):
        return x
    if x >= 1024.0:
        return math.inf
    if x < -1075.0:
        return 0.0
    k = math.floor(x + 0.5)
    return math.ldexp(exp((x - k) * _LN2), int(k))


@compiled
def expm1(x: float) -> float:
    """Return exp(x) − 1, correct for small x (Kahan's ratio with the logarithm; error to 3 ulp)."""
    if abs(x) < 1e-5:
        return x + 0.5 * x * x + x * x * x / 6.0
    u = exp(x)
    if u == 1.0 or u == math.inf or u - 1.0 == -1.0:
        return x if u == 1.0 else u - 1.0
    return (u - 1.0) * x / log(u) if abs(x) < 1.0 else u - 1.0


@compiled
def _quadrant_and_rest(x: float) -> tuple[int, float, float]:
    """Return the quadrant of x, and the rest in ±π/4 as a sum of two.

    Beyond 1.6 × 10⁶ the rest is off by less than x itself is by its rounding.
    """
    if abs(x) > _LARGEST_EXACT_TURN:
        x = np.fmod(x, 2.0 * math.pi)  # an exact operation
    n = math.floor(x * _TWO_OVER_PI + 0.5)
    first = x - n * _PIO2[0]
    w = n * _PIO2[1]
    rest = first - w
    w = n * _PIO2[2] - ((first - rest) - w)
    y = rest - w
    return int(n) & 3, y, (rest - y) - w


@compiled
def _sin_of_rest(y: float, tail: float) -> float:
    z = y * y
    v = z * y
    r = _SIN[1] + z * (_SIN[2] + z * (_SIN[3] + z * (_SIN[4] + z * _SIN[5])))
    return y - ((z * (0.5 * tail - v * r) - tail) - v * _SIN[0])


@compiled
def _cos_of_rest(y: float, tail: float) -> float:
    z = y * y
    r = z * (_COS[0] + z * (_COS[1] + z * (_COS[2] + z * (_COS[3] + z * (_COS[4] + z * _COS[5])))))
    half = 0.5 * z
    w = 1.0 - half
    return w + (((1.0 - w) - half) + (z * r - y * tail))


@compiled
def sin(x: float) -> float:
    """Return the sine of x [rad]; NaN unless x is finite."""
    if not math.isfinite(x):
        return math.nan
    quadrant, y, tail = _quadrant_and_rest(x)
    value = _cos_of_rest(y, tail) if quadrant & 1 else _sin_of_rest(y, tail)
    return -value if quadrant & 2 else value


@compiled
def cos(x: float) -> float:
    """Return the cosine of x [rad]; NaN unless x is finite."""
    if not math.isfinite(x):
        return math.nan
    quadrant, y, tail = _quadrant_and_rest(x)
    value = _sin_of_rest(y, tail) if quadrant & 1 else _cos_of_rest(y, tail)
    return -value if (quadrant + 1) & 2 else value


@compiled
def cos_of_turns(turns: float) -> float:
    """Return cos(2π · turns) of 0 to 1 turns; the reduction is exact, the error below 2 ulp."""
    quadrant = int(4.0 * turns + 0.5)
    y = 2.0 * math.pi * (turns - 0.25 * quadrant)
    value = _sin_of_rest(y, 0.0) if quadrant & 1 else _cos_of_rest(y, 0.0)
    return -value if (quadrant + 1) & 2 else value


@compiled
def hypot(x: float, y: float) -> float:
    """Return √(x² + y²) without overflow; error to 2 ulp."""
    larger, smaller = max(abs(x), abs(y)), min(abs(x), abs(y))
    if not 1e-140 < larger < 1e140:
        if larger == 0.0 or not math.isfinite(larger):
            return abs(x) + abs(y)  # of which one may be NaN
        ratio = smaller / larger
        return larger * math.sqrt(1.0 + ratio * ratio)
    return math.sqrt(x * x + y * y)


@compiled
def _sin_into(x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    for i in range(x.size):
        out[i] = sin(x[i])


@compiled
def _cos_into(x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    for i in range(x.size):
        out[i] = cos(x[i])


def sin_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sines of an array of any shape [rad]."""
    flat = np.array(x, dtype=np.float64).ravel()
    out = np.empty_like(flat)
    _sin_into(flat, out)
    return out.reshape(np.shape(x))


def cos_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cosines of an array of any shape [rad]."""
    flat = np.array(x, dtype=np.float64).ravel()
    out = np.empty_like(flat)
    _cos_into(flat, out)
    return out.reshape(np.shape(x))


@compiled
def _hypot_into(x: NDArray[np.float64], y: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    for i in range(x.size):
        out[i] = hypot(x[i], y[i])


def hypot_of(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of vectors (x, y), two arrays of one shape."""
    flat_x, flat_y = np.array(x, dtype=np.float64).ravel(), np.array(y, dtype=np.float64).ravel()
    out = np.empty_like(flat_x)
    _hypot_into(flat_x, flat_y, out)
    return out.reshape(np.shape(x))
