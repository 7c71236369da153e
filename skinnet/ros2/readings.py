"""The newest reading of every cell, from events and streams that come in any order, with gaps.

Cells send by levels: while one is silent, its force and proximity lie below the lowest level and count as 0.
What is sent rarely, acceleration and temperature, is not a number until it was heard.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.messages import FORCE_CHANNELS, READING_NAMES, STREAM_ROW, Events, Stream, Topology, unpack

__all__ = ["PROXIMITY", "TEMPERATURE", "Readings", "Tally"]

PROXIMITY = FORCE_CHANNELS
TEMPERATURE = READING_NAMES.index("temperature_c")
_FIRST = np.array([0, PROXIMITY, PROXIMITY + 1, TEMPERATURE])
"""First column of each modality in a reading."""
_WIDTH = np.diff([*_FIRST, len(READING_NAMES)])


class Tally:
    """What came of one patch: deliveries that were heard, and by their numbers how many were lost."""

    def __init__(self) -> None:
        self.events = 0
        self.rows = 0
        self._first, self._last = 2**62, -1

    @property
    def lost(self) -> int:
        """Deliveries between the first and the last that was heard, and did not come."""
        return max(0, self._last + 1 - self._first - self.events - self.rows)

    def count(self, seq: NDArray[np.int64], *, events: int = 0, rows: int = 0) -> None:
        """Adds deliveries with the numbers `seq`."""
        if len(seq):
            self._first = min(self._first, int(seq.min()))
            self._last = max(self._last, int(seq.max()))
        self.events += events
        self.rows += rows


class Readings:
    """Readings of all cells, patches in the order of `sizes`, the cells of each in turn.

    Args:
        sizes: Number of cells of each patch, by name.

    Attributes:
        values: (S, 8) newest readings in `READING_NAMES` order.
        reached: (S,) whether a cell is in the network.
        tally: What came of each patch.
    """

    def __init__(self, sizes: Mapping[str, int]) -> None:
        n = sum(sizes.values())
        self.values = np.full((n, len(READING_NAMES)), np.nan, dtype=np.float32)
        self.values[:, : PROXIMITY + 1] = 0.0
        self.reached = np.ones(n, dtype=np.bool_)
        self.tally = {patch: Tally() for patch in sizes}
        self._t_ns = np.full(self.values.shape, -1)
        ends = np.cumsum([0, *sizes.values()]).tolist()
        self._rows = {patch: slice(*ends[i : i + 2]) for i, patch in enumerate(sizes)}

    def add_events(self, patch: str, events: Events) -> None:
        """Takes in events.

        Raises:
            ProtocolError: they do not fit the patch.
        """
        rows = self._of(patch)
        cell, modality, channel = (np.array(c) for c in (events.cell, events.modality, events.channel))
        t_ns, value = np.array(events.t_sampled_ns), np.array(events.value)
        if not len(cell) == len(modality) == len(channel) == len(t_ns) == len(value) == len(events.seq):
            raise ProtocolError(f"events of {patch} with columns of unequal length")
        if not len(cell):
            return
        self._check(patch, cell)
        if modality.min() < 0 or modality.max() >= len(_FIRST):
            raise ProtocolError(f"events of {patch} of a modality that no cell has")
        if channel.min() < 0 or (channel >= _WIDTH[modality]).any():
            raise ProtocolError(f"events of {patch} of a channel that no cell has")
        self.tally[patch].count(np.array(events.seq), events=len(cell))
        order = np.argsort(t_ns, kind="stable")  # of several of one channel, the last to be written stays
        row, column = rows.start + cell[order], (_FIRST[modality] + channel)[order]
        newer = t_ns[order] >= self._t_ns[row, column]
        at = row[newer], column[newer]
        self.values[at], self._t_ns[at] = value[order][newer], t_ns[order][newer]

    def add_stream(self, patch: str, stream: Stream) -> None:
        """Takes in full readings.

        Raises:
            ProtocolError: they do not fit the patch.
        """
        rows = self._of(patch)
        readings = np.sort(unpack(stream.rows, STREAM_ROW), order="t_sampled_ns", kind="stable")
        cell = readings["cell"].astype(np.int64)
        self._check(patch, cell)
        self.tally[patch].count(readings["seq"], rows=len(cell))
        cell += rows.start
        t_ns = readings["t_sampled_ns"][:, None]
        newer = t_ns >= self._t_ns[cell]
        self.values[cell] = np.where(newer, readings["values"], self.values[cell])
        self._t_ns[cell] = np.where(newer, t_ns, self._t_ns[cell])

    def see(self, patch: str, topology: Topology) -> None:
        """Takes in which cells the network reaches; the others feel nothing.

        Raises:
            ProtocolError: it does not fit the patch.
        """
        rows = self._of(patch)
        reached = np.array(topology.network_id) > 0
        if reached.shape != self.reached[rows].shape:
            raise ProtocolError(f"topology of {len(reached)} cells of {patch}")
        self.reached[rows] = reached
        self.values[rows][~reached, : PROXIMITY + 1] = 0.0

    def cells(self, patch: str) -> slice:
        """Rows of the cells of a patch."""
        return self._rows[patch]

    def _of(self, patch: str) -> slice:
        rows = self._rows.get(patch)
        if rows is None:
            raise ProtocolError(f"patch {patch}, which is not in this run")
        return rows

    def _check(self, patch: str, cell: NDArray[np.int64]) -> None:
        rows = self._rows[patch]
        if len(cell) and not 0 <= cell.min() <= cell.max() < rows.stop - rows.start:
            raise ProtocolError(f"unknown cell of {patch}: it has cells 0 to {rows.stop - rows.start - 1}")
