"""Scripted presses: stimuli of cells as a pure function of (seed, name of the cell, time).

Nothing is integrated and no random stream is sequential, so the stimulus at any time can be computed alone.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.clock import NS_PER_S
from skinnet.compilation import compiled
from skinnet.deployment.environment.scripted_stimuli import ForceProfile, ScriptedStimuliSpec
from skinnet.deployment.types import ns_of_s
from skinnet.protocol.messages import N_FORCE_CHANNELS, STIMULUS_NAMES
from skinnet.random_streams import StreamName, stream_key, uniform

__all__ = ["PRESS_DTYPE", "PressSchedule", "build_press_schedule", "presses_before", "write_press_stimulus"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

PRESS_DTYPE = np.dtype(
    [
        ("cell", "<i4"),
        ("begin_ns", "<i8"),
        ("contact_ns", "<i8"),
        ("contact_end_ns", "<i8"),
        ("end_ns", "<i8"),
        ("force_n", "<f8"),
    ]
)
"""Press record, ground truth: cell; begin, contact onset, contact end and end [ns]; held force [N]."""

_DISTANCE = STIMULUS_NAMES.index("distance_m")
_TEMPERATURE = STIMULUS_NAMES.index("temperature_c")
_NON_PERIODIC_NS = 2**62
_DRAWS_PER_PRESS = np.uint64(8)
"""Random numbers reserved for one press: force, modulation phase, peak force cell, one per force cell."""


class PressSchedule(NamedTuple):
    """Periodic presses, each on one cell; forces of several presses on a cell add up.

    Attributes:
        cell_row: (m,) rows of the stimulus.
        random_key: (m,) keys of their random numbers.
        first_ns: (m,) begin of the first approach [ns].
        period_ns: (m,) period [ns].
        approach_ns: (m,) duration of the approach, and of the withdrawal [ns].
        rise_ns: (m,) rise time of the force [ns].
        hold_ns: (m,) hold time of the force [ns].
        release_ns: (m,) fall time of the force [ns].
        approach_m: (m,) distance at which the approach begins [m].
        force_n: (m, 2) minimum and maximum force [N].
        modulation_depth: (m,) relative amplitude of the sinusoidal force modulation.
        modulation_rad_s: (m,) angular frequency of the modulation [rad/s].
        force_spread: (m,) largest fraction of the force that a force cell may lack.
        temperature_c: (m,) temperature of the pressing object [°C].
    """

    cell_row: Indices
    random_key: NDArray[np.uint64]
    first_ns: Indices
    period_ns: Indices
    approach_ns: Indices
    rise_ns: Indices
    hold_ns: Indices
    release_ns: Indices
    approach_m: Floats
    force_n: Floats
    modulation_depth: Floats
    modulation_rad_s: Floats
    unevenness: Floats
    temperature_c: Floats


def build_press_schedule(script: ScriptedStimuliSpec, seed: int, sizes: Mapping[str, int]) -> PressSchedule:
    """Build the presses of `script` on patches of `sizes` cells, with consecutive rows.

    Raises:
        DeploymentError: a touch names cells that do not exist.
    """
    names = [(patch, cell) for patch, n in sizes.items() for cell in range(n)]
    row_of = {name: row for row, name in enumerate(names)}
    keys = np.array([stream_key(seed, *name, StreamName.SCRIPTED_STIMULI) for name in names], dtype=np.uint64)
    chosen = np.sort(np.argsort(keys, kind="stable")[: round(script.stimulated_fraction * len(names))])
    parts = [_stimulation(script, chosen, keys[chosen])]
    for index, touch in enumerate(script.presses):
        cells = script.pressed_cells(index, sizes)
        rows = np.array([row_of[cell] for cell in cells], dtype=np.int64)
        own = np.array(
            [stream_key(seed, *cell, StreamName.SCRIPTED_STIMULI, index) for cell in cells], dtype=np.uint64
        )
        every_ns = _NON_PERIODIC_NS if touch.period_s is None else ns_of_s(touch.period_s)
        first_ns = np.full(len(rows), ns_of_s(touch.start_s))
        parts.append(_presses(touch, (touch.force_n, touch.force_n), rows, own, first_ns, every_ns))
    return PressSchedule._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def _stimulation(script: ScriptedStimuliSpec, cell: Indices, key: NDArray[np.uint64]) -> PressSchedule:
    spec = script.random_presses
    stagger_ns = spec.period_ns if spec.onset_spread_s is None else ns_of_s(spec.onset_spread_s)
    late_ns = [int(uniform(k, np.uint64(0)) * stagger_ns) for k in key]
    first_ns = ns_of_s(spec.start_s) + np.array(late_ns, dtype=np.int64)
    period_ns = spec.period_ns if spec.repeat else _NON_PERIODIC_NS
    return _presses(spec, spec.force_n, cell, key, first_ns, period_ns)


def _presses(
    force_profile: ForceProfile,
    force_n: tuple[float, float],
    cell: Indices,
    key: NDArray[np.uint64],
    first_ns: Indices,
    period_ns: int,
) -> PressSchedule:
    def alike(value: Any) -> NDArray[Any]:
        return np.full(len(cell), value)

    return PressSchedule(
        cell_row=cell.astype(np.int64),
        random_key=key,
        first_ns=first_ns,
        period_ns=alike(period_ns),
        approach_ns=alike(ns_of_s(force_profile.approach_s)),
        rise_ns=alike(ns_of_s(force_profile.rise_s)),
        hold_ns=alike(ns_of_s(force_profile.hold_s)),
        release_ns=alike(ns_of_s(force_profile.release_s)),
        approach_m=alike(force_profile.approach_m),
        force_n=np.tile(np.array(force_n), (len(cell), 1)),
        modulation_depth=alike(force_profile.modulation),
        modulation_rad_s=alike(2.0 * math.pi * force_profile.modulation_hz),
        unevenness=alike(force_profile.force_spread),
        temperature_c=alike(force_profile.temperature_c),
    )


@compiled
def _draw(presses: PressSchedule, i: int, number: int, which: int) -> float:
    """Random number `which` in (0, 1) of press `number` of row `i`; distinct from that of `_stimulation`."""
    return uniform(presses.random_key[i], np.uint64(number + 1) * _DRAWS_PER_PRESS + np.uint64(which))


@compiled
def _held_n(presses: PressSchedule, i: int, number: int) -> float:
    """Held force [N] of press `number` of row `i` on the force cell that it presses most."""
    low_n, high_n = presses.force_n[i, 0], presses.force_n[i, 1]
    held_n: float = low_n + (high_n - low_n) * _draw(presses, i, number, 0)
    return held_n


@compiled
def _envelope(presses: PressSchedule, i: int, since_ns: int) -> float:
    """Force envelope in 0…1, `since_ns` [ns] after contact onset: raised-cosine rise and fall."""
    rise_ns, hold_ns, release_ns = presses.rise_ns[i], presses.hold_ns[i], presses.release_ns[i]
    if since_ns < rise_ns:
        return 0.5 - 0.5 * pinned_math.cos(math.pi * since_ns / rise_ns)
    left_ns = rise_ns + hold_ns + release_ns - since_ns
    if left_ns < release_ns:
        return 0.5 - 0.5 * pinned_math.cos(math.pi * max(left_ns, 0) / release_ns)
    return 1.0


@compiled
def write_press_stimulus(
    presses: PressSchedule, t_ns: int, body_temperature_c: Floats, stimulus: Floats
) -> int:
    """Write force, distance and temperature of all cells at `t_ns` [ns] into `stimulus` (n, 8).

    A cell that is not pressed has force 0, distance inf and the temperature `body_temperature_c` (n,) [°C].

    Returns:
        Number of active presses.
    """
    for cell in range(len(stimulus)):
        for element in range(N_FORCE_CHANNELS):
            stimulus[cell, element] = 0.0
        stimulus[cell, _DISTANCE] = math.inf
        stimulus[cell, _TEMPERATURE] = body_temperature_c[cell]
    active = 0
    for i in range(len(presses.cell_row)):
        since_ns = t_ns - presses.first_ns[i]
        if since_ns < 0:
            continue
        number = since_ns // presses.period_ns[i]
        since_ns -= number * presses.period_ns[i]
        approach_ns = presses.approach_ns[i]
        touching_ns = presses.rise_ns[i] + presses.hold_ns[i] + presses.release_ns[i]
        if since_ns >= 2 * approach_ns + touching_ns:
            continue
        active += 1
        cell = presses.cell_row[i]
        since_ns -= approach_ns  # from here on: since contact onset
        away_ns = max(-since_ns, since_ns - touching_ns)
        if away_ns > 0:
            distance_m = presses.approach_m[i] * away_ns / approach_ns
            stimulus[cell, _DISTANCE] = min(stimulus[cell, _DISTANCE], distance_m)
            continue
        stimulus[cell, _DISTANCE] = 0.0
        stimulus[cell, _TEMPERATURE] = presses.temperature_c[i]
        angle_rad = presses.modulation_rad_s[i] * since_ns / NS_PER_S
        swing = pinned_math.sin(angle_rad + 2.0 * math.pi * _draw(presses, i, number, 1))
        force_n = _held_n(presses, i, number) * _envelope(presses, i, since_ns)
        force_n *= 1.0 + presses.modulation_depth[i] * swing
        # one random force cell per press bears the full force
        most = int(_draw(presses, i, number, 2) * N_FORCE_CHANNELS)
        for element in range(N_FORCE_CHANNELS):
            lacking = presses.unevenness[i] * _draw(presses, i, number, 3 + element)
            share = 1.0 if element == most else 1.0 - lacking
            stimulus[cell, element] += share * force_n
    return active


def presses_before(presses: PressSchedule, end_ns: int) -> NDArray[Any]:
    """List presses that began before `end_ns` [ns] as `PRESS_DTYPE`, ordered by begin and cell."""
    elapsed_ns = end_ns - presses.first_ns
    count = np.where(elapsed_ns > 0, -(-elapsed_ns // presses.period_ns), 0)
    row = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    found = np.zeros(len(row), dtype=PRESS_DTYPE)
    found["cell"] = presses.cell_row[row]
    found["begin_ns"] = presses.first_ns[row] + number * presses.period_ns[row]
    found["contact_ns"] = found["begin_ns"] + presses.approach_ns[row]
    touching_ns = presses.rise_ns + presses.hold_ns + presses.release_ns
    found["contact_end_ns"] = found["contact_ns"] + touching_ns[row]
    found["end_ns"] = found["contact_end_ns"] + presses.approach_ns[row]
    found["force_n"] = _all_held_n(presses, row, number)
    return found[np.lexsort((found["cell"], found["begin_ns"]))]


@compiled
def _all_held_n(presses: PressSchedule, row: Indices, number: Indices) -> Floats:
    held_n = np.empty(len(row))
    for j in range(len(row)):
        held_n[j] = _held_n(presses, row[j], number[j])
    return held_n
