"""Arc functions whose results do not depend on the CPU, as those of `skinnet.pinned_math`.

They follow fdlibm (Sun Microsystems, 1993: s_atan.c, e_atan2.c, e_asin.c, e_acos.c), with errors below one
unit in the last place unless stated.
"""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled

__all__ = ["acos", "asin", "asin_of", "atan2", "atan2_of"]

_ATAN = (
    3.33333333333329318027e-01,
    -1.99999999998764832476e-01,
    1.42857142725034663711e-01,
    -1.11111104054623557880e-01,
    9.09088713343650656196e-02,
    -7.69187620504482999495e-02,
    6.66107313738753120669e-02,
    -5.83357013379057348645e-02,
    4.97687799461593236017e-02,
    -3.65315727442169155270e-02,
    1.62858201153657823623e-02,
)
_ATAN_HIGH = (4.63647609000806093515e-01, 7.85398163397448278999e-01, 9.82793723247329054082e-01)
_ATAN_LOW = (2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17)
"""atan of 0.5, 1 and 1.5 in parts."""
_ASIN = (
    1.66666666666666657415e-01,
    -3.25565818622400915405e-01,
    2.01212532134862925881e-01,
    -4.00555345006794114027e-02,
    7.91534994289814532176e-04,
    3.47933107596021167570e-05,
)
_ASIN_BELOW = (
    -2.40339491173441421878e00,
    2.02094576023350569471e00,
    -6.88283971605453293030e-01,
    7.70381505559019352791e-02,
)
_VERTICAL = 2.0**60
"""Slope beyond which an angle is π/2 to rounding."""
_HALF_PI_HIGH, _HALF_PI_LOW = 1.57079632679489655800e00, 6.12323399573676603587e-17


@compiled
def _atan(x: float) -> float:
    """Return the arc tangent of x ≥ 0 [rad]."""
    high = low = 0.0
    if x >= 2.4375:
        high, low, x = _HALF_PI_HIGH, _HALF_PI_LOW, -1.0 / x
    elif x >= 1.1875:
        high, low, x = _ATAN_HIGH[2], _ATAN_LOW[2], (x - 1.5) / (1.0 + 1.5 * x)
    elif x >= 0.6875:
        high, low, x = _ATAN_HIGH[1], _ATAN_LOW[1], (x - 1.0) / (x + 1.0)
    elif x >= 0.4375:
        high, low, x = _ATAN_HIGH[0], _ATAN_LOW[0], (2.0 * x - 1.0) / (2.0 + x)
    z = x * x
    w = z * z
    even = z * (_ATAN[0] + w * (_ATAN[2] + w * (_ATAN[4] + w * (_ATAN[6] + w * (_ATAN[8] + w * _ATAN[10])))))
    odd = w * (_ATAN[1] + w * (_ATAN[3] + w * (_ATAN[5] + w * (_ATAN[7] + w * _ATAN[9]))))
    return x - x * (even + odd) if high == 0.0 else high - ((x * (even + odd) - low) - x)


@compiled
def atan2(y: float, x: float) -> float:
    """Return the angle of the vector (x, y) [rad], with the signs of zero as in C; error to 2 ulp."""
    if math.isnan(x) or math.isnan(y):
        return math.nan
    if y == 0.0 and x == 0.0:
        angle = 0.0
    elif math.isinf(x) and math.isinf(y):
        angle = 0.5 * _HALF_PI_HIGH
    elif x == 0.0 or abs(y / x) > _VERTICAL:
        return math.copysign(_HALF_PI_HIGH, y)
    else:
        angle = _atan(abs(y / x))
    if math.copysign(1.0, x) < 0.0:
        angle = 2.0 * _HALF_PI_HIGH - (angle - 2.0 * _HALF_PI_LOW)
    return math.copysign(angle, y)


@compiled
def _asin_ratio(t: float) -> float:
    below = 1.0 + t * (_ASIN_BELOW[0] + t * (_ASIN_BELOW[1] + t * (_ASIN_BELOW[2] + t * _ASIN_BELOW[3])))
    above = _ASIN[0] + t * (_ASIN[1] + t * (_ASIN[2] + t * (_ASIN[3] + t * (_ASIN[4] + t * _ASIN[5]))))
    return t * above / below


@compiled
def _upper_half(x: float) -> float:
    """Return x to 26 bits, so that its square is exact (Veltkamp, 1968)."""
    wide = 134217729.0 * x
    return wide - (wide - x)


@compiled
def asin(x: float) -> float:
    """Return the arc sine of x [rad]; NaN beyond ±1."""
    size = abs(x)
    if not size < 1.0:
        return x * _HALF_PI_HIGH if size == 1.0 else math.nan
    if size < 0.5:
        return x + x * _asin_ratio(x * x)
    t = 0.5 * (1.0 - size)
    ratio, s = _asin_ratio(t), math.sqrt(t)
    w = _upper_half(s)
    c = (t - w * w) / (s + w)
    low = 2.0 * s * ratio - (_HALF_PI_LOW - 2.0 * c)
    high = 0.5 * _HALF_PI_HIGH - 2.0 * w
    return math.copysign(0.5 * _HALF_PI_HIGH - (low - high), x)


@compiled
def acos(x: float) -> float:
    """Return the arc cosine of x [rad]; NaN beyond ±1."""
    if not abs(x) < 1.0:
        return math.nan if abs(x) != 1.0 else (0.0 if x > 0.0 else 2.0 * _HALF_PI_HIGH)
    if abs(x) < 0.5:
        return _HALF_PI_HIGH - (x - (_HALF_PI_LOW - x * _asin_ratio(x * x)))
    t = 0.5 * (1.0 - abs(x))
    ratio, s = _asin_ratio(t), math.sqrt(t)
    if x < 0.0:
        return 2.0 * _HALF_PI_HIGH - 2.0 * (s + (ratio * s - _HALF_PI_LOW))
    w = _upper_half(s)
    c = (t - w * w) / (s + w)
    return 2.0 * (w + (ratio * s + c))


@compiled
def _asin_into(x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    for i in range(x.size):
        out[i] = asin(x[i])


@compiled
def _atan2_into(y: NDArray[np.float64], x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    for i in range(x.size):
        out[i] = atan2(y[i], x[i])


def asin_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the arc sines of an array of any shape [rad]."""
    flat = np.array(x, dtype=np.float64).ravel()
    out = np.empty_like(flat)
    _asin_into(flat, out)
    return out.reshape(np.shape(x))


def atan2_of(y: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles of vectors (x, y), two arrays of one shape [rad]."""
    flat_y, flat_x = np.array(y, dtype=np.float64).ravel(), np.array(x, dtype=np.float64).ravel()
    out = np.empty_like(flat_x)
    _atan2_into(flat_y, flat_x, out)
    return out.reshape(np.shape(x))
