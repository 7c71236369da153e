"""Skin input of the controller: buffers gateway deliveries and releases them in a deterministic order.

Cell indices run through all patches in the order of the deployment. A tick takes the rows delivered before
it, sorted by (time of delivery, patch, gateway, sequence number), so the order in which messages arrive does
not matter.
"""

from array import array
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import N_FORCE_CHANNELS, STREAM_ROW, Events, Stream

__all__ = ["EVENT_ROW", "CellInput", "CellRows"]

_EVENT_COLUMNS = ("t_sampled_ns", "t_delivered_ns", "seq", "cell", "modality", "channel", "kind", "level")
_N_COLUMNS = len(_EVENT_COLUMNS)
EVENT_ROW = np.dtype([(name, np.int64) for name in (*_EVENT_COLUMNS, "gateway")] + [("value", np.float64)])
"""Event row, with the cell's index within its patch."""
_CHANNEL_COUNTS = (N_FORCE_CHANNELS, 1, 3, 1)
"""Number of channels of each modality."""
_UINT16_PER_ROW = STREAM_ROW.itemsize // 2
_UINT16_OFFSET_OF_CELL = STREAM_ROW.fields["cell"][1] // 2  # type: ignore[index]


class CellRows(NamedTuple):
    """Events (`EVENT_ROW`) or full readings (`STREAM_ROW`) in the order of delivery.

    `cell` (n,) is the index through all patches; `rows["cell"]` the index within its patch.
    """

    cell: NDArray[np.int64]
    rows: NDArray[Any]


class CellInput:
    """Input buffer of the events and streams of all patches.

    A message is checked and buffered on arrival, as there are tens of thousands a second; rows are unpacked
    and sorted once a tick.

    Args:
        cell_counts: Number of cells of each patch, by name, in order.
    """

    def __init__(self, cell_counts: dict[str, int]) -> None:
        self._first_cell = np.cumsum([0, *cell_counts.values()])
        self._cell_counts = cell_counts
        self._patch_index = {patch: i for i, patch in enumerate(cell_counts)}
        self._events = _DeliveryBuffer(EVENT_ROW)
        self._stream = _DeliveryBuffer(STREAM_ROW)
        self._received_counts = np.zeros(len(cell_counts), dtype=np.int64)
        self._newest_seq = np.full(len(cell_counts), -1)
        self._clear()

    def _clear(self) -> None:
        self._integers, self._values = array("q"), array("d")
        self._streams: list[bytes] = []
        self._stream_patch: list[int] = []

    @property
    def received(self) -> int:
        """Number of events and full readings received until the last `take_due`."""
        return int(self._received_counts.sum())

    @property
    def missing(self) -> int:
        """Number of missing events and readings, by gaps in the sequence numbers."""
        return int((self._newest_seq + 1 - self._received_counts).sum())

    def cells(self, patch: str) -> NDArray[np.int64]:
        """Return the cell indices of `patch` through all patches; none if it is not in the run."""
        index = self._patch_index.get(patch)
        return (
            np.arange(0) if index is None else np.arange(self._first_cell[index], self._first_cell[index + 1])
        )

    def add_events(self, patch: str, events: Events) -> int:
        """Add events of a patch; return their number.

        Raises:
            ProtocolError: columns of different lengths, another patch, or an unknown cell, modality or
                channel.
        """
        cell, modality, channel = events.cell, events.modality, events.channel
        columns = (events.t_sampled_ns, events.t_delivered_ns, events.seq, cell)
        more = (modality, channel, events.kind, events.level)
        n = len(cell)
        for column in (*columns, *more, events.value):
            if len(column) != n:
                raise ProtocolError(f"events of patch {patch}: columns differ in length")
        for kind, number in zip(modality, channel, strict=True):
            if not (0 <= kind < len(_CHANNEL_COUNTS) and 0 <= number < _CHANNEL_COUNTS[kind]):
                raise ProtocolError(f"events of patch {patch}: unknown modality or channel")
        self._check(patch, events.patch, cell)
        integers = [self._patch_index[patch], events.gateway, n]
        for column in (*columns, *more):
            integers += column
        try:
            self._integers.extend(array("q", integers))
        except OverflowError as error:
            raise ProtocolError(f"events of patch {patch}: an integer exceeds 64 bits") from error
        self._values.extend(events.value)
        return n

    def add_stream(self, patch: str, stream: Stream) -> int:
        """Add full readings of a patch; return their number.

        Raises:
            ProtocolError: incomplete rows, another patch, or an unknown cell.
        """
        n, rest = divmod(len(stream.rows), STREAM_ROW.itemsize)
        if rest:
            raise ProtocolError(
                f"stream of patch {patch}: {len(stream.rows)} bytes are not a multiple of the row size "
                f"{STREAM_ROW.itemsize}"
            )
        cell = np.frombuffer(stream.rows, dtype="<u2")[_UINT16_OFFSET_OF_CELL::_UINT16_PER_ROW]
        self._check(patch, stream.patch, (np.maximum.reduce(cell),) if n else ())
        self._streams.append(stream.rows)
        self._stream_patch.append(self._patch_index[patch])
        return n

    def _check(self, patch: str, named_patch: str, cells: Sequence[int]) -> None:
        if named_patch != patch:
            raise ProtocolError(f"a message of {named_patch} under a key of {patch}")
        if cells and not 0 <= min(cells) <= max(cells) < self._cell_counts[patch]:
            raise ProtocolError(f"unknown cell of {patch}: it has cells 0 to {self._cell_counts[patch] - 1}")

    def take_delivered(self, before_ns: int) -> tuple[CellRows, CellRows]:
        """Remove and return the events and full readings delivered before `before_ns`, in order."""
        n_events = len(self._values)
        event_patch, events = np.empty(n_events, dtype=np.int64), np.empty(n_events, dtype=EVENT_ROW)
        if n_events:
            values = np.frombuffer(self._values, dtype=np.int64)
            table = events.view(np.int64).reshape(n_events, -1)
            _unpack_events(np.frombuffer(self._integers, dtype=np.int64), values, event_patch, table)
        stream = np.frombuffer(b"".join(self._streams), dtype=STREAM_ROW)
        sizes = [len(payload) // STREAM_ROW.itemsize for payload in self._streams]
        stream_patch = np.repeat(np.array(self._stream_patch, dtype=np.int64), sizes)
        self._clear()
        for patch, rows in ((event_patch, events), (stream_patch, stream)):
            self._received_counts += np.bincount(patch, minlength=len(self._received_counts))
            np.maximum.at(self._newest_seq, patch, rows["seq"])
        return (
            self._with_cell_index(*self._events.take_due(event_patch, events, before_ns)),
            self._with_cell_index(*self._stream.take_due(stream_patch, stream, before_ns)),
        )

    def _with_cell_index(self, patch: NDArray[np.int64], rows: NDArray[Any]) -> CellRows:
        return CellRows(self._first_cell[patch] + rows["cell"], rows)


class _DeliveryBuffer:
    """Sorted buffer of rows of one type, which keeps the rows that are not due."""

    def __init__(self, kind: np.dtype[Any]) -> None:
        self._patch = np.zeros(0, dtype=np.int64)
        self._rows = np.zeros(0, dtype=kind)

    def take_due(
        self, patch: NDArray[np.int64], rows: NDArray[Any], before_ns: int
    ) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Return patch and rows delivered before `before_ns`, buffered and new ones; buffer the others."""
        if not len(rows) and not len(self._rows):
            return patch, rows
        if len(self._rows):
            patch, rows = np.concatenate([self._patch, patch]), np.concatenate([self._rows, rows])
        order = _delivery_order(patch, rows)
        n_due = int(np.searchsorted(rows["t_delivered_ns"][order], before_ns))
        due, later = order[:n_due], order[n_due:]
        self._patch, self._rows = patch[later], rows[later]
        return patch[due], rows[due]


def _delivery_order(patch: NDArray[np.int64], rows: NDArray[Any]) -> NDArray[np.int64]:
    """Sort indices by time of delivery, patch, gateway, sequence number, then arrival."""
    t_ns = rows["t_delivered_ns"]
    order = np.argsort(t_ns, kind="stable")  # timsort merges the sorted runs of the patches
    t_ns = t_ns[order]
    same = t_ns[1:] == t_ns[:-1]
    if same.any():  # few rows share a delivery time
        tied = np.flatnonzero(np.append(same, False) | np.append(False, same))
        index = order[tied]
        ties = rows[index]
        order[tied] = index[np.lexsort((ties["seq"], ties["gateway"], patch[index], t_ns[tied]))]
    return order


@compiled
def _unpack_events(
    integers: NDArray[np.int64],
    value_bits: NDArray[np.int64],
    patch: NDArray[np.int64],
    rows: NDArray[np.int64],
) -> None:
    """Unpack column-wise messages (patch, gateway, count, columns) into rows.

    Args:
        integers: All messages, concatenated.
        value_bits: (n,) bit patterns of their readings.
        patch: (n,) output, patch index of each row.
        rows: (n, 10) output, the 64-bit fields of `EVENT_ROW`.
    """
    at, row = 0, 0
    while at < integers.size:
        n = integers[at + 2]
        for i in range(n):
            patch[row] = integers[at]
            for column in range(_N_COLUMNS):
                rows[row, column] = integers[at + 3 + column * n + i]
            rows[row, _N_COLUMNS] = integers[at + 1]
            rows[row, _N_COLUMNS + 1] = value_bits[row]
            row += 1
        at += 3 + n * _N_COLUMNS
