"""Event encodings of readings: level crossing with hysteresis, send-on-delta, periodic [M14, V.C; B15].

Each cell has its own encoding. `levels` sends force and proximity when they cross a level of Table I;
`delta` sends every channel that has changed by more than its delta since it was last sent; `clock` sends the
full reading each period, as does a cell of any encoding with `stream` set.

A network may lose an event, and nobody acknowledges one. What confirms a level is the stream that a
controller asks for: its readings tell the level as well (`skinnet.protocol.level_crossing`). A cell whose
level nobody answered repeats it after `repeat_ms`, then at twice the interval each time, up to 16 times: for
as long as the level is not 0, and five times after it returned to 0.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sensing.encoder_settings import (
    DELTA_MODALITIES,
    LEVEL_MODALITIES,
    validated_deltas,
    validated_hysteresis,
    validated_levels,
)
from skinnet.compilation import compiled, compiled_inline
from skinnet.deployment.skin.cells import CellSpec
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.protocol.level_crossing import next_level
from skinnet.protocol.messages import N_FORCE_CHANNELS, READING_NAMES, Config, EventKind, Modality

__all__ = ["CHANNEL_OF", "ENCODINGS", "MODALITY_OF", "Encoder", "EncoderOutput"]

ENCODINGS = ("level_crossing", "send_on_delta", "periodic")
_LEVEL_CROSSING, _SEND_ON_DELTA, _PERIODIC = range(len(ENCODINGS))
_N = len(READING_NAMES)
_CHANNELS_PER_MODALITY = (N_FORCE_CHANNELS, 1, 3, 1)
MODALITY_OF = tuple(int(modality) for modality in Modality for _ in range(_CHANNELS_PER_MODALITY[modality]))
"""Modality of each column of a reading, (8,)."""
CHANNEL_OF = tuple(channel for width in _CHANNELS_PER_MODALITY for channel in range(width))
"""Channel index within its modality of each column of a reading, (8,)."""
_LEVEL_CHANNELS = N_FORCE_CHANNELS + 1
_MAX_DOUBLINGS = 4
"""Doublings of the interval between repeats of a level, and repeats of level 0 less one; an assumption."""
_LEVEL_EVENT, _DELTA_EVENT = int(EventKind.LEVEL_CROSSING), int(EventKind.SEND_ON_DELTA)


class EncoderOutput(NamedTuple):
    """Encoder output of one period, ordered by cell and channel; valid until the next call.

    Event columns of equal length: `cell` int64, `modality`, `channel`, `kind` and `level` uint8, `value`
    float32, as in `skinnet.protocol.messages.Events`. `full_cell` int64: cells that send their full reading.
    """

    cell: NDArray[np.int64]
    modality: NDArray[np.uint8]
    channel: NDArray[np.uint8]
    kind: NDArray[np.uint8]
    level: NDArray[np.uint8]
    value: NDArray[np.float32]
    full_cell: NDArray[np.int64]


class _EncoderState(NamedTuple):
    """Encoder settings and last sent levels and values, one entry per cell in each array.

    `repeat_in` (n, 4): periods until a level is repeated, 0 for never; `n_repeats` (n, 4): its repeats so
    far, counted up to one more than `_MAX_DOUBLINGS`.
    """

    encoding: NDArray[np.uint8]
    stream: NDArray[np.bool_]
    levels: NDArray[np.float32]
    hysteresis: NDArray[np.float64]
    deltas: NDArray[np.float64]
    last_level: NDArray[np.uint8]
    last_sent: NDArray[np.float64]
    repeat_in: NDArray[np.int32]
    n_repeats: NDArray[np.uint8]


class Encoder:
    """Event encoder of a set of cells, with the last sent level and value of each channel.

    A change of encoding keeps the last sent levels, so that the receiver's state stays consistent: changes
    in the meantime are sent with the next sample.
    """

    def __init__(self, spec: CellSpec, n_cells: int) -> None:
        """Initialise all cells from `spec`, at level 0, without streaming.

        Raises:
            DeploymentError: invalid levels, hysteresis or deltas in `spec`.
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
            thresholds = np.array([validated_levels(levels)[m] for m in LEVEL_MODALITIES], dtype=np.float32)
            margins = np.array([validated_hysteresis(hysteresis)[m] for m in LEVEL_MODALITIES])
            steps = np.array([validated_deltas(deltas)[m] for m in DELTA_MODALITIES])
        except ValueError as error:
            raise DeploymentError(f"cells: {error}") from error
        self._initial_state = _EncoderState(
            encoding=np.array([ENCODINGS.index(spec.encoding.kind)], dtype=np.uint8),
            stream=np.zeros(1, dtype=np.bool_),
            levels=thresholds[None],
            hysteresis=margins[None],
            deltas=steps[None],
            last_level=np.zeros((1, _LEVEL_CHANNELS), dtype=np.uint8),
            last_sent=np.full((1, _N), np.nan),
            repeat_in=np.zeros((1, _LEVEL_CHANNELS), dtype=np.int32),
            n_repeats=np.zeros((1, _LEVEL_CHANNELS), dtype=np.uint8),
        )
        self._repeat_periods = spec.repeat_periods
        self.level_repeats = 0
        """Number of levels that were repeated because nobody answered."""
        self._state = _EncoderState._make(
            np.repeat(column, n_cells, axis=0) for column in self._initial_state
        )
        room = n_cells * _N
        self._columns = EncoderOutput(
            cell=np.empty(room, dtype=np.int64),
            modality=np.empty(room, dtype=np.uint8),
            channel=np.empty(room, dtype=np.uint8),
            kind=np.empty(room, dtype=np.uint8),
            level=np.empty(room, dtype=np.uint8),
            value=np.empty(room, dtype=np.float32),
            full_cell=np.empty(n_cells, dtype=np.int64),
        )

    @property
    def last_levels(self) -> NDArray[np.uint8]:
        """Last sent levels (n, 4) of three force sensors and proximity; a read-only view."""
        view = self._state.last_level.view()
        view.flags.writeable = False
        return view

    def encode(self, readings: NDArray[np.float32]) -> EncoderOutput:
        """Encode `readings` (n, 8), the next sample of every cell."""
        assert readings.shape == self._state.last_sent.shape
        events, full, repeats = _encode(readings, self._state, self._repeat_periods, self._columns)
        self.level_repeats += repeats
        columns: tuple[NDArray[Any], ...] = self._columns
        return EncoderOutput._make(
            [*(column[:events] for column in columns[:-1]), self._columns.full_cell[:full]]
        )

    def configure(self, cell: int, config: Config) -> None:
        """Apply the settings of `config` to `cell`; fields that are None keep their value.

        Raises:
            ProtocolError: an invalid setting; then none is changed.
        """
        state = self._state
        if not 0 <= cell < len(state.encoding):
            raise ProtocolError(
                f"config for cell {cell}: the process has cells 0 to {len(state.encoding) - 1}"
            )
        if config.encoding is not None and config.encoding not in ENCODINGS:
            raise ProtocolError(
                f"config of cell {cell}: encoding {config.encoding!r}; use one of {ENCODINGS}"
            )
        try:
            levels = validated_levels(config.levels or {})
            hysteresis = validated_hysteresis(config.hysteresis or {})
            deltas = validated_deltas(config.deltas or {})
        except ValueError as error:
            raise ProtocolError(f"config of cell {cell}: {error}") from error
        for name, thresholds in levels.items():
            state.levels[cell, LEVEL_MODALITIES.index(name)] = thresholds
        for name, margin in hysteresis.items():
            state.hysteresis[cell, LEVEL_MODALITIES.index(name)] = margin
        for name, delta in deltas.items():
            state.deltas[cell, DELTA_MODALITIES.index(name)] = delta
        if config.stream is not None:
            state.stream[cell] = config.stream
        if config.encoding is not None:
            if ENCODINGS.index(config.encoding) != state.encoding[cell]:
                state.last_sent[cell] = np.nan
            state.encoding[cell] = ENCODINGS.index(config.encoding)

    def cancel_repeats(self, cells: NDArray[np.bool_]) -> None:
        """Cancel the repeats of `cells` (n,) outside the network, where receivers assume level 0."""
        self._state.repeat_in[cells] = 0

    def reset(self, cells: NDArray[np.int64]) -> None:
        """Reset `cells` after a power cycle: settings of the deployment, nothing sent yet."""
        columns: tuple[NDArray[Any], ...] = self._state
        for column, fresh in zip(columns, self._initial_state, strict=True):
            column[cells] = fresh


@compiled
def _encode(
    readings: NDArray[np.float32], state: _EncoderState, repeat_periods: int, output: EncoderOutput
) -> tuple[int, int, int]:
    """Write the events and the cells that send a full reading into `output`.

    Returns:
        The number of events, of full readings, and of the events that repeat a level.
    """
    encoding, last_level, last_sent = state.encoding, state.last_level, state.last_sent
    events = 0
    full = 0
    repeats = 0
    for cell in range(readings.shape[0]):
        if state.stream[cell] or encoding[cell] == _PERIODIC:
            output.full_cell[full] = cell
            full += 1
        channels = 0
        if encoding[cell] == _LEVEL_CROSSING:
            channels = _LEVEL_CHANNELS
        elif encoding[cell] == _SEND_ON_DELTA:
            channels = _N
        for channel in range(channels):
            reading = float(readings[cell, channel])
            modality = MODALITY_OF[channel]
            level = 0
            if encoding[cell] == _LEVEL_CROSSING:
                kind = _LEVEL_EVENT
                old = int(last_level[cell, channel])
                level = next_level(
                    reading, old, state.levels[cell, modality], state.hysteresis[cell, modality]
                )
                changed = level != old
                last_level[cell, channel] = level
                repeated = _is_repeat_due(
                    state.repeat_in[cell],
                    state.n_repeats[cell],
                    channel,
                    level,
                    changed,
                    state.stream[cell],
                    repeat_periods,
                )
                if repeated:
                    repeats += 1
                elif not changed:
                    continue
            else:
                kind = _DELTA_EVENT
                if abs(reading - last_sent[cell, channel]) <= state.deltas[cell, modality]:
                    continue  # never for the first sample: the last sent value is NaN
                last_sent[cell, channel] = reading
            output.cell[events] = cell
            output.modality[events] = modality
            output.channel[events] = CHANNEL_OF[channel]
            output.kind[events] = kind
            output.level[events] = level
            output.value[events] = readings[cell, channel]
            events += 1
    return events, full, repeats


@compiled_inline
def _is_repeat_due(
    repeat_in: NDArray[np.int32],
    n_repeats: NDArray[np.uint8],
    channel: int,
    level: int,
    changed: bool,
    streaming: bool,
    repeat_periods: int,
) -> bool:
    """Advance the timer of a channel by one period; return True if its level is repeated now.

    A stream confirms the level; after it a level above 0 is repeated at the longest interval.
    """
    due = False
    if streaming:
        n_repeats[channel] = _MAX_DOUBLINGS
    elif changed:
        n_repeats[channel] = 0
    elif repeat_in[channel] == 0:
        return False
    elif repeat_in[channel] > 1:
        repeat_in[channel] -= 1
        return False
    else:
        due = True
        n_repeats[channel] = min(n_repeats[channel] + 1, _MAX_DOUBLINGS + 1)
    ended = level == 0 and (streaming or n_repeats[channel] > _MAX_DOUBLINGS)
    repeat_in[channel] = 0 if ended else repeat_periods << min(n_repeats[channel], _MAX_DOUBLINGS)
    return due
