"""Tactile state of all cells, fused from events and streams: the newest reading of every channel.

Rows are the controller's cells, columns are `READING_NAMES`. The network may deliver out of order: the
sampling time decides which reading is the newest, and the order of delivery between equal times.

A full reading confirms the levels: with the thresholds of the cells it tells the level that each channel has
after it. Without losses that is the level known already, since a cell sends the event of a sample before its
full reading; otherwise an event was lost.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled
from skinnet.deployment.skin.cells import CellSpec
from skinnet.errors import ProtocolError
from skinnet.protocol.level_crossing import MAX_LEVELS, next_level, pad_thresholds
from skinnet.protocol.messages import FOREVER_NS, N_FORCE_CHANNELS, READING_NAMES, EventKind, Modality

__all__ = ["COLUMNS", "REACTION_COLUMNS", "LevelThresholds", "TactileState"]

COLUMNS = {
    Modality.FORCE: slice(0, N_FORCE_CHANNELS),
    Modality.PROXIMITY: slice(3, 4),
    Modality.ACCELERATION: slice(4, 7),
    Modality.TEMPERATURE: slice(7, 8),
}
"""Columns of each modality in a full reading."""
REACTION_COLUMNS = slice(0, 4)
"""Reaction columns, three of force and one of proximity: M = 3 + 1 in equation (4) of [M14]."""
_N_COLUMNS = len(READING_NAMES)
_BOUNDS = np.array([(COLUMNS[modality].start, COLUMNS[modality].stop) for modality in Modality])
_LEVEL, _DELTA = int(EventKind.LEVEL_CROSSING), int(EventKind.SEND_ON_DELTA)


class LevelThresholds(NamedTuple):
    """Thresholds (4, 4) float32 and hysteresis (4,) of the levels of `REACTION_COLUMNS`."""

    thresholds: NDArray[np.float32]
    hysteresis: NDArray[np.float64]

    @classmethod
    def from_spec(cls, spec: CellSpec) -> "LevelThresholds":
        """Return the thresholds with which the cells of `spec` start."""
        sensors = [spec.force] * N_FORCE_CHANNELS + [spec.proximity]
        return cls(
            np.stack([pad_thresholds(sensor.levels) for sensor in sensors]),
            np.array([float(sensor.hysteresis) for sensor in sensors]),
        )


class TactileState:
    """Tactile state of S cells: newest readings, sampling times, event levels and cells to stream.

    A level event sets the level of its channel; the level of a modality is the highest of its channels.
    Readings of an absent cell are zero, and none are accepted until it is present again.
    """

    def __init__(
        self, n_cells: int, hold_ns: int = 500_000_000, level_thresholds: LevelThresholds | None = None
    ) -> None:
        """Start with zero readings of infinite age.

        Args:
            n_cells: S.
            hold_ns: Time for which a cell streams on after its last contact; an assumption.
            level_thresholds: Thresholds of the cells' levels; None if full readings are not to tell levels.
        """
        self._n_cells, self._hold_ns = n_cells, hold_ns
        self._values = np.zeros((n_cells, _N_COLUMNS))
        self._t_value_ns = np.full((n_cells, _N_COLUMNS), -FOREVER_NS)
        self._levels = np.zeros((n_cells, _N_COLUMNS), dtype=np.int64)
        self._t_level_ns = np.full((n_cells, _N_COLUMNS), -FOREVER_NS)
        no_levels = LevelThresholds(np.empty((0, 0), dtype=np.float32), np.empty(0))
        self._level_thresholds = level_thresholds or no_levels
        self._other_thresholds = np.zeros(n_cells, dtype=bool)
        self.missed_level_events = 0
        """Number of levels that full readings told otherwise than the newest event: lost events."""
        self._present = np.ones(n_cells, dtype=bool)
        self._last_contact_ns = np.full(n_cells, -FOREVER_NS)
        self.rejected = 0
        """Number of refused events and stream rows: unknown cell, channel or kind, or not finite."""

    def readings(self, modality: Modality) -> NDArray[np.float64]:
        """Return the readings (S, channels): force and proximity 0…1, acceleration [g], temperature [°C]."""
        return self._values[:, COLUMNS[modality]].copy()

    def reaction_readings(self, t_ns: int, max_age_ns: int = FOREVER_NS) -> NDArray[np.float64]:
        """Return readings (S, 4) of `REACTION_COLUMNS` at `t_ns`; zero where older than `max_age_ns`."""
        fresh = t_ns - self._t_value_ns[:, REACTION_COLUMNS] <= max_age_ns
        return np.where(fresh, self._values[:, REACTION_COLUMNS], 0.0)

    def level(self, modality: Modality) -> NDArray[np.int64]:
        """Return event levels (S,) of a modality, 0 for none."""
        highest: NDArray[np.int64] = self._levels[:, COLUMNS[modality]].max(axis=1)
        return highest

    def age_ns(self, t_ns: int, modality: Modality) -> NDArray[np.int64]:
        """Return the age (S,) [ns] of a modality's newest sample; at least `FOREVER_NS` if never sampled."""
        age: NDArray[np.int64] = t_ns - self._t_value_ns[:, COLUMNS[modality]].max(axis=1)
        return age

    @property
    def present(self) -> NDArray[np.bool_]:
        """Presence (S,) of the cells in the network."""
        return self._present.copy()

    def apply_events(
        self,
        cells: NDArray[np.int64],
        t_sampled_ns: NDArray[np.int64],
        modality: NDArray[np.int64],
        channel: NDArray[np.int64],
        kind: NDArray[np.int64],
        level: NDArray[np.int64],
        value: NDArray[np.float64],
    ) -> None:
        """Apply events, columns of equal length in the order of their delivery.

        Raises:
            ProtocolError: the columns differ in length.
        """
        integers = (cells, t_sampled_ns, modality, channel, kind, level)
        _check_lengths(*integers, value)
        self.rejected += _fuse_events(
            np.stack([np.asarray(column, dtype=np.int64) for column in integers]),
            np.array(value, dtype=np.float64),
            self._present,
            self._values,
            self._t_value_ns,
            self._levels,
            self._t_level_ns,
            _BOUNDS,
            self._level_thresholds,
            self._other_thresholds,
        )

    def apply_stream(
        self,
        cells: NDArray[np.int64],
        t_sampled_ns: NDArray[np.int64],
        values: NDArray[np.float32] | NDArray[np.float64],
    ) -> None:
        """Apply full readings in the order of delivery: cells (n,), times (n,), values (n, 8).

        Raises:
            ProtocolError: the columns differ in length, or the values are not 8 a row.
        """
        _check_lengths(cells, t_sampled_ns, values)
        if values.shape[1:] != (_N_COLUMNS,):
            raise ProtocolError(f"stream values have shape {values.shape}; expected (n, {_N_COLUMNS})")
        rejected, missed = _fuse_rows(
            np.stack([np.asarray(column, dtype=np.int64) for column in (cells, t_sampled_ns)]),
            np.array(values, dtype=np.float64),
            self._present,
            self._values,
            self._t_value_ns,
            self._levels,
            self._t_level_ns,
            self._level_thresholds,
            self._other_thresholds,
        )
        self.rejected += rejected
        self.missed_level_events += missed

    def set_present(self, cells: NDArray[np.int64], present: bool) -> None:
        """Mark cells (n,) as present, or as absent, which clears their readings and levels."""
        self._present[cells] = present
        if not present:
            self._values[cells] = 0.0
            self._levels[cells] = 0

    def cells_to_stream(self, t_ns: int, gains: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the cells (S,) whose full stream a reaction needs: in contact, or within the hold time.

        A cell is in contact if a touch channel with a gain is at its lowest event level or above [M14, V.C].

        Args:
            t_ns: Current time, not before that of the last call.
            gains: (S, 4) gains of `REACTION_COLUMNS`.
        """
        contact = self._present & ((self._levels[:, REACTION_COLUMNS] > 0) & (gains != 0.0)).any(axis=1)
        self._last_contact_ns[contact] = t_ns
        wanted: NDArray[np.bool_] = self._present & (t_ns - self._last_contact_ns <= self._hold_ns)
        return wanted


def _check_lengths(*columns: NDArray[np.generic]) -> None:
    lengths = [len(column) for column in columns]
    if len(set(lengths)) > 1:
        raise ProtocolError(f"columns differ in length {lengths}; each must have one entry per event or row")


@compiled
def _fuse_events(
    integers: NDArray[np.int64],
    value: NDArray[np.float64],
    present: NDArray[np.bool_],
    values: NDArray[np.float64],
    t_value_ns: NDArray[np.int64],
    levels: NDArray[np.int64],
    t_level_ns: NDArray[np.int64],
    bounds: NDArray[np.int64],
    level_thresholds: LevelThresholds,
    other_thresholds: NDArray[np.bool_],
) -> int:
    """Update value and level of each channel in place; return the number of refused events.

    A cell whose event has a level that the known thresholds do not give was configured by another client:
    its full readings no longer tell its levels.
    """
    thresholds, hysteresis = level_thresholds
    rejected = 0
    for i in range(len(value)):
        cell, t_ns, modality, channel, kind, level = integers[:, i]
        if not (0 <= cell < len(present) and 0 <= modality < len(bounds) and np.isfinite(value[i])):
            rejected += 1
            continue
        column = bounds[modality, 0] + channel
        level_is_new = kind == _LEVEL
        if channel < 0 or column >= bounds[modality, 1] or not (level_is_new or kind == _DELTA) or level < 0:
            rejected += 1
            continue
        if not present[cell]:
            continue
        if t_ns >= t_value_ns[cell, column]:
            values[cell, column] = value[i]
            t_value_ns[cell, column] = t_ns
        if level_is_new and t_ns >= t_level_ns[cell, column]:
            levels[cell, column] = level
            t_level_ns[cell, column] = t_ns
        if level_is_new and column < len(thresholds):
            stays = next_level(value[i], min(level, MAX_LEVELS), thresholds[column], hysteresis[column])
            other_thresholds[cell] |= stays != level
    return rejected


@compiled
def _fuse_rows(
    integers: NDArray[np.int64],
    rows: NDArray[np.float64],
    present: NDArray[np.bool_],
    values: NDArray[np.float64],
    t_value_ns: NDArray[np.int64],
    levels: NDArray[np.int64],
    t_level_ns: NDArray[np.int64],
    level_thresholds: LevelThresholds,
    other_thresholds: NDArray[np.bool_],
) -> tuple[int, int]:
    """Update value and level of each channel in place; return the numbers of refused rows, missed events."""
    thresholds, hysteresis = level_thresholds
    rejected = missed = 0
    for i in range(len(rows)):
        cell, t_ns = integers[:, i]
        if not (0 <= cell < len(present) and np.all(np.isfinite(rows[i]))):
            rejected += 1
            continue
        if not present[cell]:
            continue
        for column in range(rows.shape[1]):
            if t_ns >= t_value_ns[cell, column]:
                values[cell, column] = rows[i, column]
                t_value_ns[cell, column] = t_ns
        if other_thresholds[cell]:
            continue
        for column in range(len(thresholds)):
            if t_ns >= t_level_ns[cell, column]:
                known = levels[cell, column]
                level = next_level(rows[i, column], known, thresholds[column], hysteresis[column])
                missed += level != known
                levels[cell, column] = level
                t_level_ns[cell, column] = t_ns
    return rejected, missed
