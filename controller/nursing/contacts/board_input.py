"""Tactile input from the boards: contact regions per surface, in the order of delivery."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts.contact_frames import Region, Sheet, TactileInput
from skinnet import pinned_math
from skinnet.errors import ProtocolError
from skinnet.pinned_linalg import matmul
from skinnet.protocol.messages import unpack
from skinnet.protocol.sheet_messages import REGION_ROW, SCAN_FRAME_ROW, Regions
from skinnet.skin.tactile_sheets import PlacedSheet

__all__ = ["BoardInput", "sheet_surfaces"]

_IDS_PER_BOARD = 2**16
"""Region ids per board: `_PER_BOARD * board + number` is unique over all boards."""


def sheet_surfaces(placed: Sequence[PlacedSheet], height_m: float) -> dict[str, Sheet]:
    """Return the sheets known to the controller, one per surface, whatever its number of boards.

    Args:
        placed: All sheets.
        height_m: Height of the sensing face above the rigid surface [m].
    """
    surfaces = {sheet.surface.name: sheet.surface for sheet in placed}
    known = {}
    for name, surface in surfaces.items():
        mine = [sheet for sheet in placed if sheet.surface.name == name]
        xi_m = np.vstack([sheet.xi_m for sheet in mine])
        position_m, rotation = surface.frame_at(xi_m, height_m)
        pitch_m = float(np.sqrt(mine[0].area_m2))
        known[name] = Sheet(surface.body, xi_m, position_m, rotation, pitch_m)
    return known


class BoardInput:
    """Board input buffer that releases contact regions at their delivery time.

    Args:
        placed: Sheets in the order of the boards.
        merge_distance_m: Distance up to which regions of one surface are merged into one contact [m].
    """

    def __init__(self, placed: Sequence[PlacedSheet], merge_distance_m: float) -> None:
        self._surface = [sheet.surface.name for sheet in placed]
        self._merge_distance_m = merge_distance_m
        self._queue: deque[tuple[NDArray[Any], NDArray[Any]]] = deque()
        self._sampled_ns = np.full(len(placed), -1, dtype=np.int64)
        self._rows: list[NDArray[Any]] = [np.zeros(0, dtype=REGION_ROW)] * len(placed)
        self.received_frames = 0

    def add(self, regions: Regions) -> None:
        """Queue a `Regions` message.

        Raises:
            ProtocolError: incomplete records, or an unknown board.
        """
        frames, rows = unpack(regions.frames, SCAN_FRAME_ROW), unpack(regions.rows, REGION_ROW)
        if len(frames) and frames["board"].max() >= len(self._surface):
            raise ProtocolError(f"regions of board {frames['board'].max()}; there are {len(self._surface)}")
        if int(frames["n_regions"].sum()) != len(rows):
            raise ProtocolError(
                f"{len(rows)} region records, but the frame records count {int(frames['n_regions'].sum())}"
            )
        self._queue.append((frames, rows))

    def latest_input(self, before_ns: int) -> TactileInput | None:
        """Return the tactile input delivered before `before_ns`; None until every board has delivered.

        Its time is the sampling time of the oldest among the latest frames of all boards.
        """
        while self._queue:
            frames, rows = self._queue[0]
            due = int(np.searchsorted(frames["t_delivered_ns"], before_ns))
            ends = np.cumsum(frames["n_regions"], dtype=np.int64)
            for i in range(due):
                board = int(frames["board"][i])
                if frames["t_sampled_ns"][i] >= self._sampled_ns[board]:
                    self._sampled_ns[board] = frames["t_sampled_ns"][i]
                    mine = rows[ends[i] - frames["n_regions"][i] : ends[i]]
                    self._rows[board] = mine[mine["n_elements"] > 0]
            self.received_frames += due
            if due < len(frames):
                done = int(ends[due - 1]) if due else 0
                self._queue[0] = (frames[due:], rows[done:])
                break
            self._queue.popleft()
        heard_ns = int(self._sampled_ns.min())
        return None if heard_ns < 0 else TactileInput(heard_ns, self._contacts())

    def _contacts(self) -> tuple[Region, ...]:
        found: dict[str, list[Region]] = {}
        for board, rows in enumerate(self._rows):
            for row in rows:
                region = Region(
                    sheet=self._surface[board],
                    region_id=_IDS_PER_BOARD * board + int(row["region_id"]),
                    xi_m=(float(row["xi1_m"]), float(row["xi2_m"])),
                    force_n=float(row["force_n"]),
                    peak_kpa=float(row["peak_kpa"]),
                )
                found.setdefault(region.sheet, []).append(region)
        return tuple(
            region for name in sorted(found) for region in _merge_regions(found[name], self._merge_distance_m)
        )


def _merge_regions(regions: list[Region], merge_distance_m: float) -> list[Region]:
    """Merge nearby regions of one surface, under the id of the strongest.

    A contact across the boundary of two boards is one contact, though each board reports only its part.
    """
    left = sorted(regions, key=lambda region: (-region.force_n, region.region_id))
    result = []
    while left:
        group, left = [left[0]], left[1:]
        for region in tuple(left):
            if pinned_math.hypot(*np.subtract(region.xi_m, group[0].xi_m)) <= merge_distance_m:
                group.append(region)
                left.remove(region)
        weight = np.array([max(region.force_n, 1e-9) for region in group])
        first, second = (matmul(weight, np.array([region.xi_m for region in group])) / weight.sum()).tolist()
        result.append(
            group[0]._replace(
                xi_m=(first, second),
                force_n=sum(region.force_n for region in group),
                peak_kpa=max(region.peak_kpa for region in group),
            )
        )
    return result
