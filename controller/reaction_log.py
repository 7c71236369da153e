"""Log of the samples that triggered a reaction, for latency metrics; never used for control."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.cell_input import CellRows
from controller.touch.tactile_state import COLUMNS
from skinnet.protocol.messages import Modality

__all__ = ["REACTION_ROW", "ReactionLog"]

REACTION_ROW = np.dtype(
    [
        ("t_sampled_ns", np.int64),
        ("t_delivered_ns", np.int64),
        ("tick_ns", np.int64),
        ("cell", np.int32),
        ("channel", np.int8),
        ("stage", np.int8),
    ]
)
"""Row of the log: a sample above its channel's threshold (0 to 2 force, 3 proximity), and its tick."""

_FIRST_COLUMN = np.array([COLUMNS[modality].start for modality in Modality])


class ReactionLog:
    """Log of the event and stream samples that trigger tactile reactions."""

    def __init__(self) -> None:
        self._rows: list[NDArray[Any]] = []

    @property
    def rows(self) -> NDArray[Any]:
        """All logged samples, (n,) `REACTION_ROW`."""
        return np.concatenate(self._rows) if self._rows else np.zeros(0, dtype=REACTION_ROW)

    def add(
        self,
        tick_ns: int,
        stage_index: int,
        events: CellRows,
        stream: CellRows,
        thresholds: NDArray[np.float64],
    ) -> None:
        """Add the samples of a tick above `thresholds` (S, 4), which are inf where the gain is zero."""
        channels = thresholds.shape[1]
        if len(stream.cell):
            above = stream.rows["values"][:, :channels] > thresholds[stream.cell]
            row, channel = np.nonzero(above)
            self._append(tick_ns, stage_index, stream.cell[row], channel, stream.rows[row])
        if len(events.cell):
            column = _FIRST_COLUMN[events.rows["modality"]] + events.rows["channel"]
            index = np.flatnonzero(column < channels)
            cell, column = events.cell[index], column[index]
            driving = events.rows["value"][index] > thresholds[cell, column]
            self._append(tick_ns, stage_index, cell[driving], column[driving], events.rows[index[driving]])

    def _append(
        self, tick_ns: int, stage: int, cell: NDArray[np.int64], channel: NDArray[Any], rows: NDArray[Any]
    ) -> None:
        if not len(cell):
            return
        log = np.empty(len(cell), dtype=REACTION_ROW)
        log["t_sampled_ns"], log["t_delivered_ns"] = rows["t_sampled_ns"], rows["t_delivered_ns"]
        log["tick_ns"], log["stage"], log["cell"], log["channel"] = tick_ns, stage, cell, channel
        self._rows.append(log)
