"""Contact onset ground truth: threshold crossings and peak forces, hidden from the controller."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt
from skinnet.deployment.controller.stages import StageSpec
from skinnet.deployment.skin.cells import CellSpec, ForceSpec, ProximitySpec
from skinnet.protocol.messages import N_FORCE_CHANNELS, STIMULUS_NAMES, Modality

__all__ = [
    "Crossing",
    "CrossingDetector",
    "PeakForceTrace",
    "distance_thresholds_m",
    "force_thresholds_n",
    "reaction_crossing_detector",
]

Floats = NDArray[np.float64]

_DISTANCE = STIMULUS_NAMES.index("distance_m")
_FIRST_CHANNEL = {Modality.FORCE: 0, Modality.PROXIMITY: N_FORCE_CHANNELS}


class Crossing(NamedTuple):
    """Threshold crossing towards more contact.

    Attributes:
        t_ns: Time [ns], interpolated between two physics steps (force) or stimulus samples (proximity).
        cell: Row of the cell.
        modality: FORCE or PROXIMITY.
        channel: Force cell, or 0.
        level: Number of the threshold, from 1 for the least contact.
    """

    t_ns: int
    cell: int
    modality: Modality
    channel: int
    level: int


@dataclass
class CrossingDetector:
    """Detector of threshold crossings of force and distance, for all cells.

    Attributes:
        force_thresholds_n: (l,) ascending thresholds of the normal force of a force cell [N].
        distance_thresholds_m: (m,) descending thresholds of the distance [m]; an approach crosses them.
        threshold_readings: Noise-free sensor readings at the thresholds, by modality; indexed by level − 1.
        crossings: Crossings so far, in the order of detection.
    """

    force_thresholds_n: Floats
    distance_thresholds_m: Floats
    threshold_readings: Mapping[Modality, Sequence[float]] = field(default_factory=dict)
    crossings: list[Crossing] = field(default_factory=list)
    _force_before: Floats | None = None
    _distance_before: Floats | None = None
    _distance_ns: int = 0
    _was_without_contact: bool = True
    _was_out_of_range: bool = False

    def __post_init__(self) -> None:
        _any_rises(np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1))  # compiles

    def observe_forces(self, t_ns: int, step_ns: int, force_n: Floats, in_contact: bool) -> None:
        """Observe forces (n, 3) [N] at `t_ns` [ns], a step after the last; `in_contact`: any in contact."""
        if not len(self.force_thresholds_n) or (self._was_without_contact and not in_contact):
            return
        if self._force_before is None:
            self._force_before = np.zeros_like(force_n)
        self._find(t_ns, step_ns, self._force_before, force_n, self.force_thresholds_n, Modality.FORCE)
        self._force_before[:] = force_n
        self._was_without_contact = not in_contact

    def observe_stimulus(self, t_ns: int, stimulus: Floats) -> None:
        """Observe distances of the stimulus (n, 8) at `t_ns` [ns], later than the last one."""
        if not len(self.distance_thresholds_m):
            return
        nearness = -stimulus[:, _DISTANCE : _DISTANCE + 1]
        nothing_near = not np.isfinite(nearness).any()
        if nothing_near and self._was_out_of_range:
            self._distance_before, self._distance_ns = nearness, t_ns
            return
        self._was_out_of_range = nothing_near
        if self._distance_before is not None:
            step_ns = t_ns - self._distance_ns
            self._find(
                t_ns,
                step_ns,
                self._distance_before,
                nearness,
                -self.distance_thresholds_m,
                Modality.PROXIMITY,
            )
        self._distance_before, self._distance_ns = nearness, t_ns

    def facts(self) -> list[tuple[int, int, int, float]]:
        """Crossings as facts: time [ns], cell, touch channel (0–2 force, 3 proximity), reading."""
        return [
            (
                c.t_ns,
                c.cell,
                _FIRST_CHANNEL[c.modality] + c.channel,
                self.threshold_readings[c.modality][c.level - 1],
            )
            for c in self.crossings
        ]

    def _find(
        self, t_ns: int, step_ns: int, before: Floats, now: Floats, thresholds: Floats, modality: Modality
    ) -> None:
        if not _any_rises(before, np.ascontiguousarray(now), thresholds):  # mostly
            return
        rises = (before[:, :, None] < thresholds) & (now[:, :, None] >= thresholds)
        for cell, channel, index in np.argwhere(rises).tolist():
            low, high = before[cell, channel], now[cell, channel]
            share = (thresholds[index] - low) / (high - low) if math.isfinite(low) else 1.0
            start_ns = t_ns - step_ns
            self.crossings.append(
                Crossing(start_ns + round(share * step_ns), cell, modality, channel, index + 1)
            )


@compiled_without_nrt
def _any_rises(before: Floats, now: Floats, thresholds: Floats) -> bool:
    """True if any of the values `now` (n, c) reaches one of the `thresholds` (l,); `before` it was below."""
    for i in range(now.shape[0]):
        for j in range(now.shape[1]):
            low, high = before[i, j], now[i, j]
            if high > low:
                for k in range(len(thresholds)):
                    if low < thresholds[k] <= high:
                        return True
    return False


class PeakForceTrace:
    """Peak force trace of all force cells: over time, and by stage of the controller's program.

    Attributes:
        by_stage_n: Peak force of each stage with a force above 0, by name [N].
    """

    def __init__(self, period_ns: int) -> None:
        """Initialise an empty trace of period `period_ns` [ns]."""
        self.by_stage_n: dict[str, float] = {}
        self._period_ns, self._stage = period_ns, ""
        self._peak_n = 0.0
        self._t_ns: list[int] = []
        self._trace_n: list[float] = []

    def begin_stage(self, name: str) -> None:
        """Begin stage `name` of the controller's program."""
        self._stage = name

    def observe(self, t_ns: int, peak_n: float) -> None:
        """Observe the largest force now [N] at `t_ns` [ns], one physics step after the last call."""
        if peak_n > 0.0:
            self._peak_n = max(self._peak_n, peak_n)
            self.by_stage_n[self._stage] = max(self.by_stage_n.get(self._stage, 0.0), peak_n)
        if t_ns % self._period_ns == 0:
            self._t_ns.append(t_ns)
            self._trace_n.append(self._peak_n)
            self._peak_n = 0.0

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Peak force time series: the largest force [N] in the period that ends at each time."""
        return {
            "peak_force_t_ns": np.array(self._t_ns, dtype=np.int64),
            "peak_force_n": np.array(self._trace_n, dtype=np.float32),
        }


def reaction_crossing_detector(stages: Iterable[StageSpec], cells: CellSpec) -> CrossingDetector:
    """Build the crossing detector for the reaction thresholds of all guide stages."""
    guides = [stage for stage in stages if stage.kind == "guide"]
    force = sorted({stage.force_threshold for stage in guides})
    proximity = sorted({stage.proximity_threshold for stage in guides})
    return CrossingDetector(
        force_thresholds_n(cells.force, force),
        distance_thresholds_m(cells.proximity, proximity),
        {Modality.FORCE: force, Modality.PROXIMITY: proximity},
    )


def force_thresholds_n(spec: ForceSpec, readings: Sequence[float] | None = None) -> Floats:
    """Force thresholds (l,) [N] at which a noise-free force cell reads `readings`; default: Table I [M14]."""
    wanted = spec.levels if readings is None else readings
    thresholds: Floats = np.interp(wanted, spec.calibration_reading, spec.calibration_n)
    return thresholds


def distance_thresholds_m(spec: ProximitySpec, readings: Sequence[float] | None = None) -> Floats:
    """Distance thresholds (m,) [m] at noise-free proximity `readings`; default: Table I [M14].

    Inverse of the sensor law (d0 / (d0 + distance))² of `ProximitySpec`.
    """
    root_at_reach = math.sqrt(spec.reading_at_range)
    d0_m = spec.range_m * root_at_reach / (1.0 - root_at_reach)
    thresholds: Floats = d0_m * (1.0 / np.sqrt(np.array(spec.levels if readings is None else readings)) - 1.0)
    return thresholds
