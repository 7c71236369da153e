"""Which region of a frame is which of the frame before.

Two regions that have elements in common may be the same. Pairs are made one after the other: most common
elements first, then nearest centres of pressure, then the order of the board's lists. So of regions that
merge, the one that brings most elements keeps its number, and of the parts of one that splits, the largest
does. Then regions without anything in common, before or after, are paired if their centres are near. What
is left over of now begins with a new number; what is left over of before has ended. Numbers of a board
count up to 65535 before they begin anew, past those in use.
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
    """The regions of all boards in the last frame.

    Attributes:
        label: (elements,) place of an element's region in its board's list, −1 for none.
        n: (boards,) number of regions.
        number: (boards, 16) their numbers.
        xi_m: (boards, 16, 2) their centres of pressure [m].
        last: (boards,) the number that was given last.
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
    """Numbers the regions of board `b`, and keeps them for the next frame.

    Args:
        b: The board.
        begin: Its first element.
        end: After its last.
        n: How many regions it has now.
        group: (elements,) place of an element's region in the list of now, −1 for none.
        follow_m: How far a region without common elements may have moved [m].
        followed: The regions of the last frame; updated.
        overlap: (16, 16) working memory.
        row: (32,) `REGION_ROW` of the board: features of its regions; numbers and ended regions are written.

    Returns:
        How many rows there are.
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
    """Makes the best of the pairs that are left: with elements in common, or among regions without any."""
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
                continue  # it merged, or split off
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
    """Regions without a number get a new one; those that split off say from which."""
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
    """Writes a row for each region that ended, with the one that took it over; returns the number of rows."""
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
