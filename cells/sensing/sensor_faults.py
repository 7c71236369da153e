"""Sensor faults of a process, applied between transducers and encoder: stuck-at and drift.

Readings of sensors without a fault are not modified.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sensing.babbling_idiots import BabblingIdiots, BabblingIdiotState, SpuriousEvents
from cells.sensing.fault_intervals import FaultIntervals
from cells.sensing.transducers import ChannelScales, channel_scales
from skinnet.compilation import compiled
from skinnet.deployment.experiment.faults import Drift, StuckAt
from skinnet.deployment.skin.cells import CellSpec
from skinnet.network.faults.fault_schedule import FaultSpan
from skinnet.protocol.messages import READING_NAMES

__all__ = ["SensorFaultState", "SensorFaults"]


class SensorFaultState(NamedTuple):
    """Snapshot of the time-varying state of sensor faults; opaque."""

    stuck_value: NDArray[np.float64]
    babbling_idiots: BabblingIdiotState


class _ChannelFaults(NamedTuple):
    """Faults of single channels: cell, begin and end [ns], column of the reading, drift, stuck value.

    A stuck value is NaN until the first reading during the fault; `drift_per_s` is 0 for stuck-at faults.
    """

    cell: NDArray[np.int64]
    begin_ns: NDArray[np.int64]
    end_ns: NDArray[np.int64]
    column: NDArray[np.int64]
    drift_per_s: NDArray[np.float64]
    stuck_value: NDArray[np.float64]


class SensorFaults:
    """Sensor faults of the cells of a process.

    A drifting sensor adds an offset that grows linearly with time, quantised and clipped to its range. A
    stuck sensor repeats its first reading during the fault, or the value of its rule; stuck-at overrides
    drift. A babbling-idiot cell sends spurious events. Dead cells are handled elsewhere.
    """

    def __init__(
        self, spans: Iterable[FaultSpan], first_cell: Mapping[str, int], spec: CellSpec, seed: int
    ) -> None:
        """Select the sensor faults of the patches in `first_cell`, which maps each to its first cell."""
        mine = [span for span in spans if span.location.patch in first_cell]
        drifting = [(span, span.rule) for span in mine if isinstance(span.rule, Drift)]
        sticking = [(span, span.rule) for span in mine if isinstance(span.rule, StuckAt)]
        drift = [(span, rule.channel, rule.rate_per_s, math.nan) for span, rule in drifting]
        stuck = [
            (span, name, 0.0, math.nan if rule.value is None else rule.value)
            for span, rule in sticking
            for name in (READING_NAMES if rule.channel == "all" else (rule.channel,))
        ]
        broken = [*drift, *stuck]  # in this order: stuck-at overrides drift
        self._scales = channel_scales(spec)
        self._period_ns = spec.period_ns
        self._intervals = FaultIntervals([span for span, *_ in broken], first_cell)
        self._faults = _ChannelFaults(
            cell=self._intervals.cell,
            begin_ns=self._intervals.begin_ns,
            end_ns=self._intervals.end_ns,
            column=np.array([READING_NAMES.index(name) for _, name, _, _ in broken], dtype=np.int64),
            drift_per_s=np.array([per_s for _, _, per_s, _ in broken], dtype=np.float64),
            stuck_value=np.array([value for *_, value in broken], dtype=np.float64),
        )
        self._babbling_idiots = BabblingIdiots(mine, first_cell, self._scales, seed)

    def apply(self, start_ns: int, t_sampled_ns: NDArray[np.int64], readings: NDArray[np.float32]) -> None:
        """Apply the faults to `readings` (cells, 8) of one period in place.

        Periods come in order: a stuck channel keeps the first reading that it is given.

        Args:
            start_ns: Begin of the period [ns].
            t_sampled_ns: (cells,) sampling times [ns].
            readings: (cells, 8) in `READING_NAMES` order.
        """
        active = self._intervals.overlapping(start_ns, start_ns + self._period_ns)
        if active.size:
            _apply(active, self._faults, self._scales, t_sampled_ns, readings)

    def spurious_events(self, start_ns: int, end_ns: int) -> SpuriousEvents:
        """Generate the spurious events in [start_ns, end_ns), the same however time is split into calls."""
        return self._babbling_idiots.generate(start_ns, end_ns)

    def snapshot(self) -> SensorFaultState:
        """Return a copy of the time-varying state."""
        return SensorFaultState(self._faults.stuck_value.copy(), self._babbling_idiots.snapshot())

    def restore(self, state: SensorFaultState) -> None:
        """Restore a snapshot that was taken with the same cells and faults."""
        np.copyto(self._faults.stuck_value, state.stuck_value)
        self._babbling_idiots.restore(state.babbling_idiots)


@compiled
def _quantise(value: float, lsb: float, lowest: float, highest: float) -> float:
    """Quantise a value to the nearest step of `lsb` within the sensor's range."""
    steps = np.floor(value / lsb + 0.5)
    nearest: float = lsb * min(max(steps, lowest), highest)
    return nearest


@compiled
def _apply(
    active: NDArray[np.int64],
    faults: _ChannelFaults,
    scales: ChannelScales,
    t_sampled_ns: NDArray[np.int64],
    readings: NDArray[np.float32],
) -> None:
    _, lsb, lowest, highest = scales
    for i in active:
        who, what, begin_ns = faults.cell[i], faults.column[i], faults.begin_ns[i]
        if not begin_ns <= t_sampled_ns[who] < faults.end_ns[i]:
            continue
        if faults.drift_per_s[i] != 0.0:
            value = readings[who, what] + faults.drift_per_s[i] * ((t_sampled_ns[who] - begin_ns) * 1e-9)
        else:
            if math.isnan(faults.stuck_value[i]):
                faults.stuck_value[i] = readings[who, what]
            value = faults.stuck_value[i]
        readings[who, what] = _quantise(value, lsb[what], lowest[what], highest[what])
