"""Newest cell readings, from events and streams that arrive in any order and with gaps.

Under level-crossing encoding, a silent cell's force and proximity lie below the lowest level and count as 0.
Acceleration and temperature, which are rarely sent, are NaN until the first reading.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.protocol.messages import (
    N_FORCE_CHANNELS,
    READING_NAMES,
    STREAM_ROW,
    Events,
    Stream,
    Topology,
    unpack,
)

__all__ = ["PROXIMITY", "TEMPERATURE", "CellReadings", "DeliveryCounts"]

PROXIMITY = N_FORCE_CHANNELS
TEMPERATURE = READING_NAMES.index("temperature_c")
_FIRST_COLUMN = np.array([0, PROXIMITY, PROXIMITY + 1, TEMPERATURE])
"""First reading column of each modality."""
_WIDTH = np.diff([*_FIRST_COLUMN, len(READING_NAMES)])


class DeliveryCounts:
    """Delivery counts of one patch: received events and rows, and losses by sequence number."""

    def __init__(self) -> None:
        self.n_events = 0
        self.n_full_readings = 0
        self._first, self._last = 2**62, -1

    @property
    def n_lost(self) -> int:
        """Lost deliveries between the first and the last received one."""
        return max(0, self._last + 1 - self._first - self.n_events - self.n_full_readings)

    def count(self, seq: NDArray[np.int64], *, events: int = 0, rows: int = 0) -> None:
        """Count deliveries with sequence numbers `seq`."""
        if len(seq):
            self._first = min(self._first, int(seq.min()))
            self._last = max(self._last, int(seq.max()))
        self.n_events += events
        self.n_full_readings += rows


class CellReadings:
    """Newest readings of all cells, by patch in the order of `patch_sizes`.

    Args:
        patch_sizes: Number of cells of each patch, by name.

    Attributes:
        values: (S, 8) newest readings in `READING_NAMES` order, NaN if unknown.
        connected: (S,) whether a cell is connected to the network.
        deliveries: Delivery counts of each patch.
    """

    def __init__(self, patch_sizes: Mapping[str, int]) -> None:
        n = sum(patch_sizes.values())
        self.values = np.full((n, len(READING_NAMES)), np.nan, dtype=np.float32)
        self.values[:, : PROXIMITY + 1] = 0.0
        self.connected = np.ones(n, dtype=np.bool_)
        self.deliveries = {patch: DeliveryCounts() for patch in patch_sizes}
        self._t_ns = np.full(self.values.shape, -1)
        ends = np.cumsum([0, *patch_sizes.values()]).tolist()
        self._rows = {patch: slice(*ends[i : i + 2]) for i, patch in enumerate(patch_sizes)}

    def apply_events(self, patch: str, events: Events) -> None:
        """Apply events.

        Raises:
            ProtocolError: they do not fit the patch.
        """
        rows = self._require_patch(patch)
        cell, modality, channel = (np.array(c) for c in (events.cell, events.modality, events.channel))
        t_ns, value = np.array(events.t_sampled_ns), np.array(events.value)
        if not len(cell) == len(modality) == len(channel) == len(t_ns) == len(value) == len(events.seq):
            raise ProtocolError(f"events of patch {patch}: columns differ in length")
        if not len(cell):
            return
        self._check(patch, cell)
        if modality.min() < 0 or modality.max() >= len(_FIRST_COLUMN):
            raise ProtocolError(f"events of {patch}: unknown modality")
        if channel.min() < 0 or (channel >= _WIDTH[modality]).any():
            raise ProtocolError(f"events of {patch}: unknown channel of a modality")
        self.deliveries[patch].count(np.array(events.seq), events=len(cell))
        order = np.argsort(t_ns, kind="stable")  # of several events of one channel, the newest is last
        row, column = rows.start + cell[order], (_FIRST_COLUMN[modality] + channel)[order]
        newer = t_ns[order] >= self._t_ns[row, column]
        at = row[newer], column[newer]
        self.values[at], self._t_ns[at] = value[order][newer], t_ns[order][newer]

    def apply_stream(self, patch: str, stream: Stream) -> None:
        """Apply full readings.

        Raises:
            ProtocolError: they do not fit the patch.
        """
        rows = self._require_patch(patch)
        readings = np.sort(unpack(stream.rows, STREAM_ROW), order="t_sampled_ns", kind="stable")
        cell = readings["cell"].astype(np.int64)
        self._check(patch, cell)
        self.deliveries[patch].count(readings["seq"], rows=len(cell))
        cell += rows.start
        t_ns = readings["t_sampled_ns"][:, None]
        newer = t_ns >= self._t_ns[cell]
        self.values[cell] = np.where(newer, readings["values"], self.values[cell])
        self._t_ns[cell] = np.where(newer, t_ns, self._t_ns[cell])

    def apply_topology(self, patch: str, topology: Topology) -> None:
        """Apply a topology; force and proximity of unreachable cells become 0.

        Raises:
            ProtocolError: it does not fit the patch.
        """
        rows = self._require_patch(patch)
        reached = np.array(topology.network_id) > 0
        if reached.shape != self.connected[rows].shape:
            raise ProtocolError(
                f"topology of {patch}: {len(reached)} cells; the patch has {rows.stop - rows.start}"
            )
        self.connected[rows] = reached
        self.values[rows][~reached, : PROXIMITY + 1] = 0.0

    def rows_of(self, patch: str) -> slice:
        """Row slice of a patch's cells."""
        return self._rows[patch]

    def _require_patch(self, patch: str) -> slice:
        rows = self._rows.get(patch)
        if rows is None:
            raise ProtocolError(f"unknown patch {patch!r}")
        return rows

    def _check(self, patch: str, cell: NDArray[np.int64]) -> None:
        rows = self._rows[patch]
        if len(cell) and not 0 <= cell.min() <= cell.max() < rows.stop - rows.start:
            raise ProtocolError(f"unknown cell of {patch}: it has cells 0 to {rows.stop - rows.start - 1}")
