"""Foam with a curve of compression: pressure over compression from a table, with hysteresis.

A table gives the pressure of loading L and of unloading U, U ≤ L, over the compression x of the foam, linear
between its rows. Between both curves the foam remembers one length y per point, the play operator of x
(Visintin 1994, Differential models of hysteresis): y stays within x - w ≤ y ≤ x, and

    p = U + λ (L - U),    λ = (x - y) / w.

So p follows L while x grows, falls to U within a way back of w, and climbs to L within w again: never beyond
the two, never downwards while x grows. Its free energy per area,

    ψ(x, y) = ∫₀ˣ U ds + ∫_y^x (L - U) (s - y) / w ds,

has ∂ψ/∂x = p and ∂ψ/∂y ≤ 0. So the dissipated power p ẋ - ψ̇ is never negative, and a cycle between contact
and any compression loses what lies between its branches. Out of contact y = -w: every contact begins on L.

An elastic solid is a linear spring in series: x + s p = δ with its softness s and the overlap δ.
Pressures and slopes below are divided by the solid's foam fraction, by which the callers scale all areas.
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.foam import Foam
from skinnet.compilation import compiled_without_nrt

__all__ = ["closing_response", "compressed_state", "stored_energy_j_per_m2"]

Floats = NDArray[np.float64]
_MAX_ITERATIONS = 100
_TOLERANCE = 1e-14
"""Accuracy of the compression in series with a solid, as a fraction of the overlap."""


@compiled_without_nrt
def _row_above(curve: Floats, x_m: float) -> int:
    """Row of the table at the upper end of the piece in which the compression `x_m` [m] lies."""
    row = 1
    while row < len(curve) - 1 and x_m > curve[row, 0]:
        row += 1
    return row


@compiled_without_nrt
def _both_curves(curve: Floats, x_m: float) -> tuple[float, float, float, float]:
    """Pressure of loading and of unloading [Pa] and their slopes [Pa/m] at the compression `x_m` [m].

    Beyond the last row both continue with the last slope of loading.
    """
    row = _row_above(curve, x_m)
    x0, x1 = curve[row - 1, 0], curve[row, 0]
    slope_l = (curve[row, 1] - curve[row - 1, 1]) / (x1 - x0)
    slope_u = (curve[row, 2] - curve[row - 1, 2]) / (x1 - x0)
    if x_m > x1:
        return curve[row, 1] + slope_l * (x_m - x1), curve[row, 2] + slope_l * (x_m - x1), slope_l, slope_l
    return (
        curve[row - 1, 1] + slope_l * (x_m - x0),
        curve[row - 1, 2] + slope_u * (x_m - x0),
        slope_l,
        slope_u,
    )


@compiled_without_nrt
def _pressure(foam: Foam, x_m: float, play_m: float) -> tuple[float, float]:
    """Pressure [Pa] and its slope [Pa/m] at the compression `x_m` ≥ 0 [m] with the memory `play_m` [m]."""
    loading_pa, unloading_pa, slope_l, slope_u = _both_curves(foam.curve, x_m)
    if foam.reversal_m <= 0.0:
        return loading_pa, slope_l
    way = (x_m - play_m) / foam.reversal_m
    if way >= 1.0:
        return loading_pa, slope_l
    if way <= 0.0:
        return unloading_pa, slope_u
    loss_pa = loading_pa - unloading_pa
    return unloading_pa + way * loss_pa, slope_u + way * (slope_l - slope_u) + loss_pa / foam.reversal_m


@compiled_without_nrt
def _softness_m_per_pa(foam: Foam, foam_fraction: float) -> float:
    """Softness [m/Pa] of the solid in series; 0 for a rigid one."""
    return (1.0 / foam_fraction - 1.0) / foam.stiffness_pa_per_m


@compiled_without_nrt
def _compression_m(foam: Foam, overlap_m: float, softness_m_per_pa: float, play_m: float) -> float:
    """Compression x [m] of the foam at an overlap δ ≥ 0 [m]: x + s p(x) = δ, by safeguarded Newton steps."""
    if softness_m_per_pa <= 0.0:
        return overlap_m
    low_m, high_m, x_m, moved_m = 0.0, overlap_m, overlap_m, overlap_m
    for _ in range(_MAX_ITERATIONS):
        pressure_pa, slope = _pressure(foam, x_m, play_m)
        excess_m = x_m + softness_m_per_pa * pressure_pa - overlap_m
        if excess_m > 0.0:
            high_m = x_m
        else:
            low_m = x_m
        next_m = x_m - excess_m / (1.0 + softness_m_per_pa * slope)
        # Newton's steps alone may go to and fro across a kink
        if not low_m < next_m < high_m or abs(next_m - x_m) > 0.5 * moved_m:
            next_m = 0.5 * (low_m + high_m)
        moved_m, x_m = abs(next_m - x_m), next_m
        if moved_m <= _TOLERANCE * overlap_m:
            break
    return x_m


@compiled_without_nrt
def compressed_state(
    foam: Foam, overlap_m: float, foam_fraction: float, play_m: Floats, cell: int, sample: int
) -> tuple[float, float, float]:
    """State of a point in contact: indentation of the solid [m], elastic pressure [Pa], damping [Pa s/m].

    The point's memory in `play_m` (n, s) follows.
    """
    softness = _softness_m_per_pa(foam, foam_fraction)
    play = 0.0
    if foam.reversal_m > 0.0:
        play = play_m[cell, sample]
    x_m = _compression_m(foam, overlap_m, softness, play)
    if foam.reversal_m > 0.0:
        play = min(max(play, x_m - foam.reversal_m), x_m)
        play_m[cell, sample] = play
    pressure_pa, slope = _pressure(foam, x_m, play)
    damping_pa_s_per_m = foam.damping_pa_s_per_m / (1.0 + softness * slope)
    return overlap_m - x_m, pressure_pa / foam_fraction, damping_pa_s_per_m / foam_fraction


@compiled_without_nrt
def closing_response(
    foam: Foam,
    overlap_m: float,
    closing_m_s: float,
    step_s: float,
    foam_fraction: float,
    play_m: Floats,
    cell: int,
    sample: int,
) -> tuple[float, float]:
    """Pressure [Pa] at the end of a step, and its derivative [Pa s/m] with respect to the closing velocity.

    As `foam_response` has it, with the elastic pressure at the end of the step by the curve, and for c' the
    slope of the curve at the start.
    """
    end_m = overlap_m + step_s * closing_m_s
    if end_m <= 0.0:
        return 0.0, 0.0
    softness = _softness_m_per_pa(foam, foam_fraction)
    play = 0.0
    if foam.reversal_m > 0.0:
        play = play_m[cell, sample]
    _, slope = _pressure(foam, _compression_m(foam, max(overlap_m, 0.0), softness, play), play)
    damping = max(0.0, foam.damping_pa_s_per_m - step_s * slope) / (1.0 + softness * slope)
    viscous_pa = damping * (closing_m_s if overlap_m >= 0.0 else end_m / step_s)
    pressure_pa, slope = _pressure(foam, _compression_m(foam, end_m, softness, play), play)
    slope_pa_s_per_m = step_s * slope / (1.0 + softness * slope) + damping
    return (pressure_pa + viscous_pa) / foam_fraction, slope_pa_s_per_m / foam_fraction


@compiled_without_nrt
def stored_energy_j_per_m2(
    foam: Foam, overlap_m: float, foam_fraction: float, play_m: Floats, cell: int, sample: int
) -> float:
    """Energy [J/m²] that a compressed point and the solid on it can give back: ψ + s p² / 2."""
    if overlap_m <= 0.0:
        return 0.0
    softness, play = _softness_m_per_pa(foam, foam_fraction), 0.0
    if foam.reversal_m > 0.0:
        play = play_m[cell, sample]
    x_m = _compression_m(foam, overlap_m, softness, play)
    pressure_pa, _ = _pressure(foam, x_m, play)
    energy, start_m = 0.5 * softness * pressure_pa * pressure_pa, 0.0
    while start_m < x_m:
        row = _row_above(foam.curve, start_m)
        if start_m >= foam.curve[row, 0] and row < len(foam.curve) - 1:
            row += 1
        end_m = x_m
        if start_m < foam.curve[row, 0]:
            end_m = min(end_m, foam.curve[row, 0])
        if start_m < play:  # the memory's own kink
            end_m = min(end_m, play)
        middle_m = 0.5 * (start_m + end_m)
        total = _stored_pa(foam, start_m, play) + 4.0 * _stored_pa(foam, middle_m, play)
        energy += (end_m - start_m) / 6.0 * (total + _stored_pa(foam, end_m, play))
        start_m = end_m
    return energy / foam_fraction


@compiled_without_nrt
def _stored_pa(foam: Foam, s_m: float, play_m: float) -> float:
    """Integrand of ψ [Pa] at the compression `s_m` [m]; quadratic between kinks: Simpson's rule is exact."""
    loading_pa, unloading_pa, _, _ = _both_curves(foam.curve, s_m)
    if foam.reversal_m <= 0.0:
        return loading_pa
    return unloading_pa + max(0.0, s_m - play_m) / foam.reversal_m * (loading_pa - unloading_pa)
