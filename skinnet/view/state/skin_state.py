"""Newest skin readings of every cell and sheet element."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError
from skinnet.protocol.messages import READING_NAMES, STREAM_ROW, Events, Modality, Stream, unpack
from skinnet.protocol.sheet_messages import PATTERN_ROW, REGION_ROW, SCAN_FRAME_ROW, Regions
from skinnet.view.state.skin_layout import SkinLayout

__all__ = ["FIRST_COLUMN", "N_COLUMNS", "SkinState"]

Floats = NDArray[np.float64]

FIRST_COLUMN = (0, 3, 4, 7)
"""First reading column of each modality."""
N_COLUMNS = (3, 1, 3, 1)
"""Number of reading columns of each modality."""
_VECTORISE_ABOVE = 24
"""Number of events above which arrays are faster than a loop."""
_PATTERN_VALIDITY_NS = 500_000_000
"""Time [ns] for which a raw pressure pattern takes precedence over its board's regions."""
_CONTACT_COLUMNS = slice(0, 4)
"""Force and proximity columns, which are 0 while a connected cell is silent."""


class SkinState:
    """Newest skin readings.

    Attributes:
        reading: (cells, 8) in `READING_NAMES` order, NaN where never received.
        sampled_ns: (cells,) sampling time of the newest reading [ns], −1 for never.
    """

    def __init__(self, layout: SkinLayout) -> None:
        self._layout = layout
        self._cells = {patch.name: patch.n_cells for patch in layout.patches}
        self.reading = np.full((layout.n_cells, len(READING_NAMES)), np.nan, dtype=np.float32)
        self.sampled_ns = np.full(layout.n_cells, -1, dtype=np.int64)
        self._regions: list[NDArray[Any]] = [np.empty(0, dtype=REGION_ROW)] * len(layout.sheets)
        self._patterns: list[tuple[int, NDArray[np.float32]] | None] = [None] * len(layout.sheets)
        self._newest_frame_ns = 0

    def require_cell(self, patch: str, cell: int) -> int:
        """Index of the first cell of a patch; checks that the patch has `cell`.

        Raises:
            ProtocolError: there is no such patch, or no such cell of it.
        """
        if patch not in self._cells:
            raise ProtocolError(f"unknown patch {patch!r}")
        if not 0 <= cell < self._cells[patch]:
            raise ProtocolError(f"{patch} has cells 0 to {self._cells[patch] - 1}, not {cell}")
        return self._layout.first_taxel[patch]

    def apply_events(self, events: Events) -> None:
        """Apply events of level-crossing or send-on-delta encoding."""
        start = self.require_cell(events.patch, max(events.cell, default=0))
        if len(events.cell) > _VECTORISE_ABOVE:
            cells = np.array(events.cell) + start
            column = np.array(FIRST_COLUMN)[events.modality] + events.channel
            self.reading[cells, column] = events.value
            self.sampled_ns[cells] = events.t_sampled_ns
            return
        for cell, t_ns, modality, channel, value in zip(
            events.cell, events.t_sampled_ns, events.modality, events.channel, events.value, strict=True
        ):
            self.reading[start + cell, FIRST_COLUMN[modality] + channel] = value
            self.sampled_ns[start + cell] = t_ns

    def apply_stream(self, stream: Stream) -> NDArray[Any]:
        """Apply full readings; return their rows."""
        rows = unpack(stream.rows, STREAM_ROW)
        start = self.require_cell(stream.patch, int(rows["cell"].max(initial=0)))
        cells = start + rows["cell"].astype(np.int64)
        self.reading[cells] = rows["values"]
        self.sampled_ns[cells] = rows["t_sampled_ns"]
        return rows

    def apply_regions(self, regions: Regions) -> list[tuple[int, int, int, float]]:
        """Apply the contact regions and pressure patterns of boards.

        Returns:
            For each scan frame: sampling and delivery time [ns], board, peak pressure of its regions [kPa].

        Raises:
            ProtocolError: rows and frames do not agree, or a board is unknown.
        """
        frames, rows = unpack(regions.frames, SCAN_FRAME_ROW), unpack(regions.rows, REGION_ROW)
        patterns = unpack(regions.patterns, PATTERN_ROW)
        boards = len(self._regions)
        if int(frames["n_regions"].sum()) != len(rows):
            raise ProtocolError("regions: row count differs from the sum over frames")
        if max(frames["board"].max(initial=0), patterns["board"].max(initial=0)) >= max(boards, 1):
            raise ProtocolError(f"regions of an unknown board; boards are 0 to {boards - 1}")
        told, end = [], 0
        peaks_kpa = rows["peak_kpa"].tolist()
        for t_sampled_ns, t_delivered_ns, _, board, count in frames.tolist():
            start, end = end, end + count
            self._regions[board] = rows[start:end]
            self._newest_frame_ns = t_sampled_ns
            told.append((t_sampled_ns, t_delivered_ns, board, max(peaks_kpa[start:end], default=0.0)))
        for pattern in patterns:
            pressure = pattern["pressure_kpa"][: pattern["n_elements"]]
            self._patterns[pattern["board"]] = int(pattern["t_sampled_ns"]), pressure
        return told

    def mark_unknown(self, cells: NDArray[np.int64]) -> None:
        """Set the readings of cells that left the network to unknown."""
        self.reading[cells] = np.nan

    def displayed_values(self, modality: Modality) -> Floats:
        """Displayed values (spots,) of a modality, NaN where unknown.

        Force: the largest of the cell's force readings; for elements, pressure [kPa]. Acceleration: its
        magnitude [g].
        """
        first, width = FIRST_COLUMN[modality], N_COLUMNS[modality]
        columns = self.reading[:, first : first + width].astype(np.float64)
        if modality is Modality.ACCELERATION:
            of_cells = np.sqrt((columns**2).sum(axis=1))
        else:
            of_cells = np.where(np.isnan(columns), -np.inf, columns).max(axis=1)
            of_cells[np.isneginf(of_cells)] = np.nan
        unknown = np.full(self._layout.n_elements, np.nan)
        of_elements = self.pressure_kpa() if modality is Modality.FORCE else unknown
        return np.concatenate([of_cells, of_elements])

    def pressure_kpa(self) -> Floats:
        """Element pressures (elements,) [kPa] from raw patterns, or from regions as discs of mean pressure.

        The element nearest to the centre of a region has its peak.
        """
        if not self._layout.sheets:
            return np.empty(0)
        of_sheets = []
        for board, sheet in enumerate(self._layout.sheets):
            pattern = self._patterns[board]
            if pattern is not None and self._newest_frame_ns - pattern[0] < _PATTERN_VALIDITY_NS:
                of_sheets.append(pattern[1].astype(np.float64))
                continue
            pressure = np.zeros(sheet.n_elements)
            for region in self._regions[board]:
                if not region["n_elements"]:
                    continue
                away_m = np.linalg.norm(sheet.xi_m - [region["xi1_m"], region["xi2_m"]], axis=1)
                inside = np.argsort(away_m, kind="stable")[: region["n_elements"]]
                pressure[inside] = 1e-3 * region["force_n"] / max(float(region["area_m2"]), 1e-9)
                pressure[inside[0]] = region["peak_kpa"]
            of_sheets.append(pressure)
        return np.concatenate(of_sheets)

    def mark_silent_as_zero(self, connected: NDArray[np.bool_]) -> None:
        """Set unknown force and proximity of connected cells to 0, which silence means."""
        silent = connected[:, None] & np.isnan(self.reading[:, _CONTACT_COLUMNS])
        self.reading[:, _CONTACT_COLUMNS][silent] = 0.0
