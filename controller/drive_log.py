"""Which samples drove a reaction, and when: for those who judge latencies, never used for control."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.skin_input import SkinRows
from controller.touch.fusion import COLUMNS
from skinnet.messages import Modality

__all__ = ["DRIVE", "DriveLog"]

DRIVE = np.dtype(
    [
        ("t_sampled_ns", np.int64),
        ("t_delivered_ns", np.int64),
        ("tick_ns", np.int64),
        ("cell", np.int32),
        ("channel", np.int8),
        ("stage", np.int8),
    ]
)
"""A sample above the threshold of its channel (0 to 2 force, 3 proximity), and the tick that used it."""

_FIRST_COLUMN = np.array([COLUMNS[modality].start for modality in Modality])


class DriveLog:
    """Collects the samples that drive the robot, of events and of streams."""

    def __init__(self) -> None:
        self._rows: list[NDArray[Any]] = []

    @property
    def rows(self) -> NDArray[Any]:
        """All of them, (n,) `DRIVE`."""
        return np.concatenate(self._rows) if self._rows else np.zeros(0, dtype=DRIVE)

    def add(
        self, tick_ns: int, stage: int, events: SkinRows, stream: SkinRows, thresholds: NDArray[np.float64]
    ) -> None:
        """Adds what of a tick's input is above `thresholds` (S, 4), which are inf where there is no gain."""
        channels = thresholds.shape[1]
        if len(stream.cell):
            above = stream.rows["values"][:, :channels] > thresholds[stream.cell]
            row, channel = np.nonzero(above)
            self._append(tick_ns, stage, stream.cell[row], channel, stream.rows[row])
        if len(events.cell):
            column = _FIRST_COLUMN[events.rows["modality"]] + events.rows["channel"]
            index = np.flatnonzero(column < channels)
            cell, column = events.cell[index], column[index]
            driving = events.rows["value"][index] > thresholds[cell, column]
            self._append(tick_ns, stage, cell[driving], column[driving], events.rows[index[driving]])

    def _append(
        self, tick_ns: int, stage: int, cell: NDArray[np.int64], channel: NDArray[Any], rows: NDArray[Any]
    ) -> None:
        if not len(cell):
            return
        log = np.empty(len(cell), dtype=DRIVE)
        log["t_sampled_ns"], log["t_delivered_ns"] = rows["t_sampled_ns"], rows["t_delivered_ns"]
        log["tick_ns"], log["stage"], log["cell"], log["channel"] = tick_ns, stage, cell, channel
        self._rows.append(log)
