"""The controller's ear: what the gateways deliver, held back until its time and put into the one true order.

Rows are the controller's cells: patches in the order of the deployment, the cells of each in turn. What was
delivered before a tick is handed out at that tick, ordered by (time of delivery, patch, gateway, sequence
number), so the order in which messages arrive does not matter.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.messages import FORCE_CHANNELS, STREAM_ROW, Events, Modality, Stream, unpack

__all__ = ["EVENT_ROW", "SkinInput", "SkinRows"]

_EVENT_COLUMNS = ("t_sampled_ns", "t_delivered_ns", "seq", "cell", "modality", "channel", "kind", "level")
EVENT_ROW = np.dtype([(name, np.int64) for name in (*_EVENT_COLUMNS, "gateway")] + [("value", np.float64)])
"""One event, with the cell's number in its patch."""
_CHANNELS = np.array([FORCE_CHANNELS, 1, 3, 1])
"""Channels of each modality."""


class SkinRows(NamedTuple):
    """Events (`EVENT_ROW`) or full readings (`STREAM_ROW`) in the order of delivery.

    `cell` (n,) numbers the cells through all patches; `rows["cell"]` within each.
    """

    cell: NDArray[np.int64]
    rows: NDArray[Any]


class SkinInput:
    """Collects events and streams of all patches.

    Args:
        sizes: Number of cells of each patch, by name, in order.
    """

    def __init__(self, sizes: dict[str, int]) -> None:
        self._first = np.cumsum([0, *sizes.values()])
        self._sizes = sizes
        self._patch = {patch: i for i, patch in enumerate(sizes)}
        self._events = _Waiting(EVENT_ROW)
        self._stream = _Waiting(STREAM_ROW)

    def cells(self, patch: str) -> NDArray[np.int64]:
        """Numbers of the cells of `patch`, through all patches; none if it is not in the run."""
        index = self._patch.get(patch)
        return np.arange(0) if index is None else np.arange(self._first[index], self._first[index + 1])

    def add_events(self, patch: str, events: Events) -> int:
        """Takes in events of a patch; returns how many.

        Raises:
            ProtocolError: columns of different lengths, another patch, or a cell, a modality or a channel
                that it does not have.
        """
        columns = [getattr(events, name) for name in (*_EVENT_COLUMNS, "value")]
        if len({len(column) for column in columns}) != 1:
            raise ProtocolError(f"events of {patch} with columns of unequal length")
        rows = np.zeros(len(events.cell), dtype=EVENT_ROW)
        try:
            for name, column in zip((*_EVENT_COLUMNS, "value"), columns, strict=True):
                rows[name] = column
            rows["gateway"] = events.gateway
        except OverflowError as error:
            raise ProtocolError(f"events of {patch} with a number beyond 64 bits") from error
        modality, channel = rows["modality"], rows["channel"]
        known = (modality >= 0) & (modality < len(Modality))
        if not known.all() or (channel < 0).any() or (channel >= _CHANNELS[modality]).any():
            raise ProtocolError(f"events of {patch} of a modality or a channel that no cell has")
        return self._add(self._events, patch, events.patch, rows)

    def add_stream(self, patch: str, stream: Stream) -> int:
        """Takes in full readings of a patch; returns how many.

        Raises:
            ProtocolError: no whole rows, another patch, or a cell that it does not have.
        """
        return self._add(self._stream, patch, stream.patch, unpack(stream.rows, STREAM_ROW))

    def _add(self, waiting: "_Waiting", patch: str, named: str, rows: NDArray[Any]) -> int:
        if named != patch:
            raise ProtocolError(f"a message of {named} under a key of {patch}")
        cell = rows["cell"].astype(np.uint64)  # a negative number becomes a very large one
        if len(rows) and cell.max() >= self._sizes[patch]:
            raise ProtocolError(f"unknown cell of {patch}: it has cells 0 to {self._sizes[patch] - 1}")
        waiting.add(self._patch[patch], rows)
        return len(rows)

    def take(self, before_ns: int) -> tuple[SkinRows, SkinRows]:
        """Events and full readings that were delivered before `before_ns` and not taken yet, in order."""
        return self._numbered(*self._events.take(before_ns)), self._numbered(*self._stream.take(before_ns))

    def _numbered(self, patch: NDArray[np.int64], rows: NDArray[Any]) -> SkinRows:
        return SkinRows(self._first[patch] + rows["cell"], rows)


class _Waiting:
    """Rows of one kind that have arrived, with the patch of each."""

    def __init__(self, kind: np.dtype[Any]) -> None:
        self._kind = kind
        self._none = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=kind)
        self._patch: list[NDArray[np.int64]] = []
        self._rows: list[NDArray[Any]] = []

    def add(self, patch: int, rows: NDArray[Any]) -> None:
        self._patch.append(np.full(len(rows), patch))
        self._rows.append(rows)

    def take(self, before_ns: int) -> tuple[NDArray[np.int64], NDArray[Any]]:
        if not self._rows:
            return self._none
        patch = np.concatenate(self._patch)
        rows = np.concatenate(self._rows, dtype=self._kind)
        due = rows["t_delivered_ns"] < before_ns
        if due.all():
            self._patch, self._rows = [], []
        else:
            later = ~due
            self._patch, self._rows = [patch[later]], [rows[later]]
            patch, rows = patch[due], rows[due]
        order = np.lexsort((rows["seq"], rows["gateway"], patch, rows["t_delivered_ns"]))
        return patch[order], rows[order]
