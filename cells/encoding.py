"""From readings to what is sent: levels with hysteresis, send-on-delta, clock [M14, V.C; B15].

Each cell has an encoding of its own. `levels` tells of force and proximity when they cross a level of
Table I, `delta` of every channel that moved by more than its delta since it was last sent, `clock` sends the
full reading each period, and so does, whatever its encoding, a cell that was asked to `stream`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.settings import DELTAS, LEVELS, MAX_LEVELS, checked_deltas, checked_hysteresis, checked_levels
from skinnet.compiled import compiled
from skinnet.deployment.schema import CellSpec
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.messages import FORCE_CHANNELS, READING_NAMES, Config, EventKind, Modality

__all__ = ["CHANNEL_OF", "ENCODINGS", "MODALITY_OF", "Emission", "Encoder", "EncoderState"]

ENCODINGS = ("levels", "delta", "clock")
_BY_LEVELS, _BY_DELTA, _BY_CLOCK = range(len(ENCODINGS))
_N = len(READING_NAMES)
_WIDTH = (FORCE_CHANNELS, 1, 3, 1)
MODALITY_OF = tuple(int(modality) for modality in Modality for _ in range(_WIDTH[modality]))
"""Modality of each column of a reading."""
CHANNEL_OF = tuple(channel for width in _WIDTH for channel in range(width))
"""Channel within its modality of each column of a reading."""
_LEVEL_CHANNELS = FORCE_CHANNELS + 1
_LEVEL_EVENT, _DELTA_EVENT = int(EventKind.LEVEL), int(EventKind.DELTA)


class Emission(NamedTuple):
    """What the cells of a patch send in one frame, by cell and channel; valid until the next frame.

    Columns of events, all of one length: `cell` int64, `modality`, `channel`, `kind` and `level` uint8,
    `value` float32, as in `skinnet.messages.Events`. `full` int64: cells that send their full reading.
    """

    cell: NDArray[np.int64]
    modality: NDArray[np.uint8]
    channel: NDArray[np.uint8]
    kind: NDArray[np.uint8]
    level: NDArray[np.uint8]
    value: NDArray[np.float32]
    full: NDArray[np.int64]


class EncoderState(NamedTuple):
    """Settings of cells, and what each has last said; opaque, one entry a cell in each array."""

    encoding: NDArray[np.uint8]
    stream: NDArray[np.bool_]
    levels: NDArray[np.float32]
    hysteresis: NDArray[np.float64]
    deltas: NDArray[np.float64]
    level: NDArray[np.uint8]
    sent: NDArray[np.float64]


class Encoder:
    """The encodings of the cells of a patch, and what each cell has last said.

    A change of encoding keeps the levels that were last sent, so that the receiver's picture stays right:
    what has changed meanwhile is sent with the next sample.
    """

    def __init__(self, spec: CellSpec, n_cells: int) -> None:
        """All cells begin as `spec` says, at level 0, not streaming.

        Raises:
            DeploymentError: levels, hysteresis or deltas of `spec` do not hold.
        """
        levels = {"force": list(spec.force.levels), "proximity": list(spec.proximity.levels)}
        hysteresis = {"force": spec.force.hysteresis, "proximity": spec.proximity.hysteresis}
        deltas = {
            "force": spec.force.delta,
            "proximity": spec.proximity.delta,
            "acceleration": spec.accelerometer.delta_g,
            "temperature": spec.temperature.delta_c,
        }
        try:
            # float32, as readings are: a reading that equals a threshold has reached it
            thresholds = np.array([checked_levels(levels)[m] for m in LEVELS], dtype=np.float32)
            margins = np.array([checked_hysteresis(hysteresis)[m] for m in LEVELS])
            steps = np.array([checked_deltas(deltas)[m] for m in DELTAS])
        except ValueError as error:
            raise DeploymentError(f"cells: {error}") from error
        self._fresh = EncoderState(
            encoding=np.array([ENCODINGS.index(spec.encoding.kind)], dtype=np.uint8),
            stream=np.zeros(1, dtype=np.bool_),
            levels=thresholds[None],
            hysteresis=margins[None],
            deltas=steps[None],
            level=np.zeros((1, _LEVEL_CHANNELS), dtype=np.uint8),
            sent=np.full((1, _N), np.nan),
        )
        self._state = EncoderState._make(np.repeat(column, n_cells, axis=0) for column in self._fresh)
        room = n_cells * _N
        self._columns = Emission(
            cell=np.empty(room, dtype=np.int64),
            modality=np.empty(room, dtype=np.uint8),
            channel=np.empty(room, dtype=np.uint8),
            kind=np.empty(room, dtype=np.uint8),
            level=np.empty(room, dtype=np.uint8),
            value=np.empty(room, dtype=np.float32),
            full=np.empty(n_cells, dtype=np.int64),
        )

    @property
    def level(self) -> NDArray[np.uint8]:
        """Levels (n, 4) last sent: three force cells, proximity; a read-only view."""
        view = self._state.level.view()
        view.flags.writeable = False
        return view

    def encode(self, readings: NDArray[np.float32]) -> Emission:
        """What is sent of `readings` (n, 8), the next sample of every cell."""
        assert readings.shape == self._state.sent.shape
        events, full = _encode(readings, *self._state, *self._columns)
        columns: tuple[NDArray[Any], ...] = self._columns
        return Emission._make([*(column[:events] for column in columns[:-1]), self._columns.full[:full]])

    def configure(self, cell: int, config: Config) -> None:
        """Gives `cell` the settings that `config` carries; what is None stays.

        Raises:
            ProtocolError: a setting does not hold; then none has changed.
        """
        state = self._state
        if not 0 <= cell < len(state.encoding):
            raise ProtocolError(f"config of cell {cell}: the patch has cells 0 to {len(state.encoding) - 1}")
        if config.encoding is not None and config.encoding not in ENCODINGS:
            raise ProtocolError(
                f"config of cell {cell}: encoding {config.encoding!r}; use one of {ENCODINGS}"
            )
        try:
            levels = checked_levels(config.levels or {})
            hysteresis = checked_hysteresis(config.hysteresis or {})
            deltas = checked_deltas(config.deltas or {})
        except ValueError as error:
            raise ProtocolError(f"config of cell {cell}: {error}") from error
        for name, thresholds in levels.items():
            state.levels[cell, LEVELS.index(name)] = thresholds
        for name, margin in hysteresis.items():
            state.hysteresis[cell, LEVELS.index(name)] = margin
        for name, delta in deltas.items():
            state.deltas[cell, DELTAS.index(name)] = delta
        if config.stream is not None:
            state.stream[cell] = config.stream
        if config.encoding is not None:
            if ENCODINGS.index(config.encoding) != state.encoding[cell]:
                state.sent[cell] = np.nan
            state.encoding[cell] = ENCODINGS.index(config.encoding)

    def reset(self, cells: NDArray[np.int64]) -> None:
        """`cells` are switched on again: they know the deployment's settings only and have said nothing."""
        columns: tuple[NDArray[Any], ...] = self._state
        for column, fresh in zip(columns, self._fresh, strict=True):
            column[cells] = fresh

    def snapshot(self) -> EncoderState:
        """A copy of all that changes with time."""
        return EncoderState._make(column.copy() for column in self._state)

    def restore(self, state: EncoderState) -> None:
        """Goes back, or forth, to the moment at which an encoder of as many cells gave `state`."""
        self._state = EncoderState._make(column.copy() for column in state)


@compiled
def _next_level(reading: float, level: int, levels: NDArray[np.float32], hysteresis: float) -> int:
    """Rises at a threshold, falls only below it by more than the hysteresis; inf stands for no threshold."""
    while level < MAX_LEVELS and reading >= levels[level]:
        level += 1
    while level > 0 and reading < levels[level - 1] - hysteresis:
        level -= 1
    return level


@compiled
def _encode(
    readings: NDArray[np.float32],
    encoding: NDArray[np.uint8],
    stream: NDArray[np.bool_],
    levels: NDArray[np.float32],
    hysteresis: NDArray[np.float64],
    deltas: NDArray[np.float64],
    last_level: NDArray[np.uint8],
    sent: NDArray[np.float64],
    event_cell: NDArray[np.int64],
    event_modality: NDArray[np.uint8],
    event_channel: NDArray[np.uint8],
    event_kind: NDArray[np.uint8],
    event_level: NDArray[np.uint8],
    event_value: NDArray[np.float32],
    full_cell: NDArray[np.int64],
) -> tuple[int, int]:
    """Writes the events and the cells that send a full reading; returns how many there are of each."""
    events = 0
    full = 0
    for cell in range(readings.shape[0]):
        if stream[cell] or encoding[cell] == _BY_CLOCK:
            full_cell[full] = cell
            full += 1
        channels = 0
        if encoding[cell] == _BY_LEVELS:
            channels = _LEVEL_CHANNELS
        elif encoding[cell] == _BY_DELTA:
            channels = _N
        for channel in range(channels):
            reading = float(readings[cell, channel])
            modality = MODALITY_OF[channel]
            level = 0
            if encoding[cell] == _BY_LEVELS:
                kind = _LEVEL_EVENT
                old = int(last_level[cell, channel])
                level = _next_level(reading, old, levels[cell, modality], hysteresis[cell, modality])
                if level == old:
                    continue
                last_level[cell, channel] = level
            else:
                kind = _DELTA_EVENT
                if abs(reading - sent[cell, channel]) <= deltas[cell, modality]:
                    continue  # not so for the first sample: nothing was sent, which is not a number
                sent[cell, channel] = reading
            event_cell[events] = cell
            event_modality[events] = modality
            event_channel[events] = CHANNEL_OF[channel]
            event_kind[events] = kind
            event_level[events] = level
            event_value[events] = readings[cell, channel]
            events += 1
    return events, full
