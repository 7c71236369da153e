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

from cells.sheets.wire import MAX_REGIONS
from skinnet.compiled import compiled

__all__ = ["Followed", "follow"]

_LAST = 65535


class Followed(NamedTuple):
    """Tracked regions of all boards in the last frame.

    Attributes:
        label: (elements,) index of an element's region in its board's list, −1 for none.
        n: (boards,) number of regions.
        number: (boards, 16) region IDs.
        xi_m: (boards, 16, 2) centres of pressure [m].
        last: (boards,) last assigned region ID.
    """

    label: NDArray[np.int64]
    n: NDArray[np.int64]
    number: NDArray[np.uint16]
    xi_m: NDArray[np.float64]
    last: NDArray[np.uint16]


@compiled
def follow(
    b: int,
    begin: int,
    end: int,
    n: int,
    group: NDArray[np.int64],
    follow_m: float,
    followed: Followed,
    overlap: NDArray[np.int64],
    row: Any,
) -> int:
    """Match the regions of board `b` to those of the last frame, and store them for the next.

    Args:
        b: Index of the board.
        begin: First element of the board.
        end: One past its last element.
        n: Number of current regions.
        group: (elements,) index of an element's current region in the board's list, −1 for none.
        follow_m: Maximum displacement of a region without overlap [m].
        followed: Regions of the last frame; updated.
        overlap: (16, 16) working memory.
        row: (32,) `REGION_ROW` of the board with the features of its regions; IDs and ended regions are
            written.

    Returns:
        Number of rows.
    """
    before = followed.n[b]
    overlap[:before, :n] = 0
    for i in range(begin, end):
        if followed.label[i] >= 0 and group[i] >= 0:
            overlap[followed.label[i], group[i]] += 1
    ended = np.ones(MAX_REGIONS, dtype=np.bool_)
    for new in range(n):
        row[new].number = 0
        row[new].kin = 0
    while _pair(b, before, n, True, math.inf, followed, overlap, ended, row):
        pass
    while _pair(b, before, n, False, follow_m, followed, overlap, ended, row):
        pass
    _begin(b, before, n, followed, overlap, row)
    rows = _end(b, before, n, followed, overlap, ended, row)
    for new in range(n):
        followed.number[b, new] = row[new].number
        followed.xi_m[b, new, 0] = row[new].xi1_m
        followed.xi_m[b, new, 1] = row[new].xi2_m
    followed.n[b] = n
    for i in range(begin, end):
        followed.label[i] = group[i]
    return rows


@compiled
def _pair(
    b: int,
    before: int,
    n: int,
    common: bool,
    reach_m: float,
    followed: Followed,
    overlap: NDArray[np.int64],
    ended: NDArray[np.bool_],
    row: Any,
) -> bool:
    """Match the best remaining pair, with overlap or among regions without any; return False if none."""
    best_old, best_new, most, nearest_m = -1, -1, 0, 0.0
    for old in range(before):
        for new in range(n):
            if not ended[old] or row[new].number != 0:
                continue
            shared = overlap[old, new]
            if common:
                if shared == 0:
                    continue
            elif overlap[old, :n].any() or overlap[:before, new].any():
                continue  # one of the two merged or split
            distance_m = math.hypot(
                followed.xi_m[b, old, 0] - row[new].xi1_m, followed.xi_m[b, old, 1] - row[new].xi2_m
            )
            if distance_m > reach_m:
                continue
            if best_old < 0 or shared > most or (shared == most and distance_m < nearest_m):
                best_old, best_new, most, nearest_m = old, new, shared, distance_m
    if best_old < 0:
        return False
    ended[best_old] = False
    row[best_new].number = followed.number[b, best_old]
    return True


@compiled
def _begin(b: int, before: int, n: int, followed: Followed, overlap: NDArray[np.int64], row: Any) -> None:
    """Assign new IDs to unmatched regions; regions that split off name the region they came from."""
    for new in range(n):
        if row[new].number != 0:
            continue
        most = 0
        for old in range(before):
            if overlap[old, new] > most:
                most = overlap[old, new]
                row[new].kin = followed.number[b, old]
        used = True
        while used:
            followed.last[b] = followed.last[b] + 1 if followed.last[b] < _LAST else 1
            used = False
            for old in range(before):
                used |= followed.number[b, old] == followed.last[b]
        row[new].number = followed.last[b]


@compiled
def _end(
    b: int,
    before: int,
    n: int,
    followed: Followed,
    overlap: NDArray[np.int64],
    ended: NDArray[np.bool_],
    row: Any,
) -> int:
    """Write a row for each ended region, with the one it merged into; return the number of rows."""
    rows = n
    for old in range(before):
        if not ended[old]:
            continue
        row[rows].number = followed.number[b, old]
        row[rows].kin = 0
        most = 0
        for new in range(n):
            if overlap[old, new] > most:
                most = overlap[old, new]
                row[rows].kin = row[new].number
        row[rows].xi1_m = followed.xi_m[b, old, 0]
        row[rows].xi2_m = followed.xi_m[b, old, 1]
        row[rows].force_n = 0.0
        row[rows].area_m2 = 0.0
        row[rows].peak_kpa = 0.0
        row[rows].elements = 0
        rows += 1
    return rows
