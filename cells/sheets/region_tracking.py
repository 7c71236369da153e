"""Region tracking: greedy matching of the contact regions of consecutive frames.

Regions are matched by overlap: most common elements first, then nearest centres of pressure, then list order.
So when regions merge, the one with the largest overlap keeps its ID, and when one splits, its largest part
does. Regions without any overlap are then matched if their centres of pressure are near. Unmatched current
regions get a new ID; unmatched previous regions have ended. IDs of a board count to 65535, then start over,
skipping those in use.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sheets.region_quantisation import MAX_REGIONS
from skinnet import pinned_math
from skinnet.compilation import compiled

__all__ = ["TrackedRegions", "match_regions"]

_MAX_ID = 65535


class TrackedRegions(NamedTuple):
    """Tracked regions of all boards in the last frame.

    Attributes:
        first_element: (boards + 1,) first element of each board, then the number of elements; constant.
        label: (elements,) index of an element's region in its board's list, −1 for none.
        n_regions: (boards,) number of regions.
        region_id: (boards, 16) region IDs.
        xi_m: (boards, 16, 2) centres of pressure [m].
        last_id: (boards,) last assigned region ID.
    """

    first_element: NDArray[np.int64]
    label: NDArray[np.int64]
    n_regions: NDArray[np.int64]
    region_id: NDArray[np.uint16]
    xi_m: NDArray[np.float64]
    last_id: NDArray[np.uint16]


@compiled
def match_regions(
    board: int,
    n: int,
    label: NDArray[np.int64],
    max_displacement_m: float,
    tracked: TrackedRegions,
    overlap: NDArray[np.int64],
    row: Any,
) -> int:
    """Match the regions of board `board` to those of the last frame, and store them for the next.

    Args:
        board: Index of the board.
        n: Number of current regions.
        label: (elements,) index of an element's current region in the board's list, −1 for none.
        max_displacement_m: Maximum displacement of a region without overlap [m].
        tracked: Regions of the last frame; updated.
        overlap: (16, 16) working memory.
        row: (32,) `REGION_ROW` of the board with the features of its regions; IDs and ended regions are
            written.

    Returns:
        Number of rows.
    """
    begin, end = tracked.first_element[board], tracked.first_element[board + 1]
    before = tracked.n_regions[board]
    overlap[:before, :n] = 0
    for i in range(begin, end):
        if tracked.label[i] >= 0 and label[i] >= 0:
            overlap[tracked.label[i], label[i]] += 1
    ended = np.ones(MAX_REGIONS, dtype=np.bool_)
    for new in range(n):
        row[new].region_id = 0
        row[new].lineage_id = 0
    while _match_best_pair(board, n, True, math.inf, tracked, overlap, ended, row):
        pass
    while _match_best_pair(board, n, False, max_displacement_m, tracked, overlap, ended, row):
        pass
    _assign_new_ids(board, before, n, tracked, overlap, row)
    rows = _write_ended(board, before, n, tracked, overlap, ended, row)
    for new in range(n):
        tracked.region_id[board, new] = row[new].region_id
        tracked.xi_m[board, new, 0] = row[new].xi1_m
        tracked.xi_m[board, new, 1] = row[new].xi2_m
    tracked.n_regions[board] = n
    for i in range(begin, end):
        tracked.label[i] = label[i]
    return rows


@compiled
def _match_best_pair(
    board: int,
    n: int,
    with_overlap: bool,
    max_distance_m: float,
    tracked: TrackedRegions,
    overlap: NDArray[np.int64],
    ended: NDArray[np.bool_],
    row: Any,
) -> bool:
    """Match the best remaining pair, with overlap or among regions without any; return False if none."""
    n_previous = tracked.n_regions[board]
    best_old, best_new, most, nearest_m = -1, -1, 0, 0.0
    for old in range(n_previous):
        for new in range(n):
            if not ended[old] or row[new].region_id != 0:
                continue
            shared = overlap[old, new]
            if with_overlap:
                if shared == 0:
                    continue
            elif overlap[old, :n].any() or overlap[:n_previous, new].any():
                continue  # one of the two merged or split
            distance_m = pinned_math.hypot(
                tracked.xi_m[board, old, 0] - row[new].xi1_m, tracked.xi_m[board, old, 1] - row[new].xi2_m
            )
            if distance_m > max_distance_m:
                continue
            if best_old < 0 or shared > most or (shared == most and distance_m < nearest_m):
                best_old, best_new, most, nearest_m = old, new, shared, distance_m
    if best_old < 0:
        return False
    ended[best_old] = False
    row[best_new].region_id = tracked.region_id[board, best_old]
    return True


@compiled
def _assign_new_ids(
    board: int, n_previous: int, n: int, tracked: TrackedRegions, overlap: NDArray[np.int64], row: Any
) -> None:
    """Assign new IDs to unmatched regions; regions that split off name the region they came from."""
    for new in range(n):
        if row[new].region_id != 0:
            continue
        most = 0
        for old in range(n_previous):
            if overlap[old, new] > most:
                most = overlap[old, new]
                row[new].lineage_id = tracked.region_id[board, old]
        used = True
        while used:
            tracked.last_id[board] = tracked.last_id[board] + 1 if tracked.last_id[board] < _MAX_ID else 1
            used = False
            for old in range(n_previous):
                used |= tracked.region_id[board, old] == tracked.last_id[board]
        row[new].region_id = tracked.last_id[board]


@compiled
def _write_ended(
    board: int,
    n_previous: int,
    n: int,
    tracked: TrackedRegions,
    overlap: NDArray[np.int64],
    ended: NDArray[np.bool_],
    row: Any,
) -> int:
    """Write a row for each ended region, with the one it merged into; return the number of rows."""
    rows = n
    for old in range(n_previous):
        if not ended[old]:
            continue
        row[rows].region_id = tracked.region_id[board, old]
        row[rows].lineage_id = 0
        most = 0
        for new in range(n):
            if overlap[old, new] > most:
                most = overlap[old, new]
                row[rows].lineage_id = row[new].region_id
        row[rows].xi1_m = tracked.xi_m[board, old, 0]
        row[rows].xi2_m = tracked.xi_m[board, old, 1]
        row[rows].force_n = 0.0
        row[rows].area_m2 = 0.0
        row[rows].peak_kpa = 0.0
        row[rows].n_elements = 0
        rows += 1
    return rows
