"""Contact regions of tactile sheets: segmentation, features, and tracking over frames.

An element (taxel) is active from `on_kpa` until it falls below `off_kpa` (hysteresis thresholding). A region
is a connected component of active elements. Its rim, inactive neighbours with a reading above zero, also
counts for its force: several per cent for a cylinder. The force is the sum of pressure times area, the
centre of pressure ξ the pressure-weighted mean of coordinates [R11, III]; area, peak and number of elements
are those of the active elements. `matching` keeps the region's ID from frame to frame.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sheets.matching import Followed, follow
from cells.sheets.wire import MAX_REGIONS, MAX_ROWS
from skinnet.compiled import compiled
from skinnet.deployment.sheets import RegionSpec
from skinnet.errors import DeploymentError
from skinnet.sheet_messages import REGION_ROW
from skinnet.skin.sheet import PlacedSheet

__all__ = ["RegionTracker"]

_PA_PER_KPA = 1e3


class _Layout(NamedTuple):
    """Adjacency of the elements of all boards: board b has elements start[b] to start[b + 1].

    Neighbours of element i are neighbour[first[i]] to neighbour[first[i + 1]] (compressed sparse rows).
    """

    start: NDArray[np.int64]
    first: NDArray[np.int64]
    neighbour: NDArray[np.int64]
    xi_m: NDArray[np.float64]
    area_m2: NDArray[np.float64]


class RegionTracker:
    """Tracker of the contact regions of boards.

    Attributes:
        rows: (boards, 32) `REGION_ROW` of the last frame: regions in order of their first element, then those
            that ended; times are not set.
        n_rows: (boards,) number of valid rows.
        number: (n,) region ID of each element in the last frame, 0 for none.
    """

    def __init__(self, sheets: Sequence[PlacedSheet], spec: RegionSpec) -> None:
        """Create a tracker without regions.

        Raises:
            DeploymentError: `off_kpa` is above `on_kpa`.
        """
        if spec.off_kpa > spec.on_kpa:
            raise DeploymentError(
                f"regions.off_kpa = {spec.off_kpa}: may not be above on_kpa = {spec.on_kpa}"
            )
        boards = len(sheets)
        self._layout = _lay_out(sheets)
        n = len(self._layout.xi_m)
        self._spec = spec
        self.number = np.zeros(n, dtype=np.uint16)
        self.rows: NDArray[Any] = np.zeros((boards, MAX_ROWS), dtype=REGION_ROW)
        self.rows["board"] = np.arange(boards)[:, None]
        self.n_rows = np.zeros(boards, dtype=np.int64)
        self._group, self._member = np.full((2, n), -1, dtype=np.int64)
        self._followed = Followed(
            label=np.full(n, -1, dtype=np.int64),
            n=np.zeros(boards, dtype=np.int64),
            number=np.zeros((boards, MAX_REGIONS), dtype=np.uint16),
            xi_m=np.zeros((boards, MAX_REGIONS, 2)),
            last=np.zeros(boards, dtype=np.uint16),
        )
        self._stack = np.empty(n, dtype=np.int64)
        self._overlap = np.zeros((MAX_REGIONS, MAX_REGIONS), dtype=np.int64)

    def track(self, readings_kpa: NDArray[np.float64]) -> None:
        """Update the regions of all boards with the readings (n,) [kPa] of the next frame."""
        assert readings_kpa.shape == self.number.shape
        _track(
            readings_kpa,
            self._layout,
            self._spec.on_kpa,
            self._spec.off_kpa,
            self._spec.follow_m,
            self._followed,
            self._group,
            self._member,
            self._stack,
            self._overlap,
            self.rows,
            self.n_rows,
            self.number,
        )

    def reset(self, board: int) -> None:
        """Reset a board after a power cycle: it has no region; region IDs continue."""
        mine = slice(*self._layout.start[board : board + 2].tolist())
        self._followed.label[mine] = -1
        self._followed.n[board] = 0
        self.number[mine] = 0


def _lay_out(sheets: Sequence[PlacedSheet]) -> _Layout:
    sizes = [sheet.n_elements for sheet in sheets]
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    pairs = np.vstack([sheet.neighbours + first for sheet, first in zip(sheets, start, strict=False)])
    both = np.vstack([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    first = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=start[-1]))]).astype(np.int64)
    return _Layout(
        start=start,
        first=first,
        neighbour=np.ascontiguousarray(both[:, 1]),
        xi_m=np.vstack([sheet.xi_m for sheet in sheets]),
        area_m2=np.array([sheet.area_m2 for sheet in sheets]),
    )


@compiled
def _track(
    readings_kpa: NDArray[np.float64],
    layout: _Layout,
    on_kpa: float,
    off_kpa: float,
    follow_m: float,
    followed: Followed,
    group: NDArray[np.int64],
    member: NDArray[np.int64],
    stack: NDArray[np.int64],
    overlap: NDArray[np.int64],
    rows: Any,
    n_rows: NDArray[np.int64],
    number: NDArray[np.uint16],
) -> None:
    for b in range(n_rows.size):
        begin, end = layout.start[b], layout.start[b + 1]
        n = _group(readings_kpa, layout, begin, end, on_kpa, off_kpa, followed.label, group, stack)
        if n > 0:
            _add_rims(readings_kpa, layout, begin, end, group, member)
            _describe(readings_kpa, layout, b, group, member, rows[b], n)
        n_rows[b] = follow(b, begin, end, n, group, follow_m, followed, overlap, rows[b])
        for i in range(begin, end):
            number[i] = rows[b, group[i]].number if group[i] >= 0 else 0


@compiled
def _group(
    readings_kpa: NDArray[np.float64],
    layout: _Layout,
    begin: int,
    end: int,
    on_kpa: float,
    off_kpa: float,
    label: NDArray[np.int64],
    group: NDArray[np.int64],
    stack: NDArray[np.int64],
) -> int:
    """Label the connected components of active elements in [begin, end); return their number.

    Elements with `label` ≥ 0 were active in the last frame.
    """
    waits = -2
    for i in range(begin, end):
        active = readings_kpa[i] >= (off_kpa if label[i] >= 0 else on_kpa)
        group[i] = waits if active else -1
    n = 0
    for i in range(begin, end):
        if group[i] != waits:
            continue
        group[i] = n
        stack[0], depth = i, 1
        while depth > 0:
            depth -= 1
            at = stack[depth]
            for j in range(layout.first[at], layout.first[at + 1]):
                to = layout.neighbour[j]
                if group[to] == waits:
                    group[to] = n
                    stack[depth] = to
                    depth += 1
        n += 1
    return n


@compiled
def _add_rims(
    readings_kpa: NDArray[np.float64],
    layout: _Layout,
    begin: int,
    end: int,
    group: NDArray[np.int64],
    member: NDArray[np.int64],
) -> None:
    """Add rims to components: write `member`, the component of each element or of its highest neighbour."""
    for i in range(begin, end):
        member[i] = group[i]
        highest_kpa = 0.0
        if group[i] < 0 and readings_kpa[i] > 0.0:
            for j in range(layout.first[i], layout.first[i + 1]):
                to = layout.neighbour[j]
                if group[to] >= 0 and readings_kpa[to] > highest_kpa:
                    member[i], highest_kpa = group[to], readings_kpa[to]


@compiled
def _describe(
    readings_kpa: NDArray[np.float64],
    layout: _Layout,
    b: int,
    group: NDArray[np.int64],
    member: NDArray[np.int64],
    row: Any,
    n: int,
) -> None:
    """Write the features of the `n` regions of board `b` into its rows."""
    for r in range(n):
        total_kpa, moment1, moment2, peak_kpa, elements = 0.0, 0.0, 0.0, 0.0, 0
        for i in range(layout.start[b], layout.start[b + 1]):
            if member[i] == r:
                total_kpa += readings_kpa[i]
                moment1 += readings_kpa[i] * layout.xi_m[i, 0]
                moment2 += readings_kpa[i] * layout.xi_m[i, 1]
            if group[i] == r:
                peak_kpa = max(peak_kpa, readings_kpa[i])
                elements += 1
        row[r].force_n = total_kpa * _PA_PER_KPA * layout.area_m2[b]
        row[r].xi1_m = moment1 / total_kpa
        row[r].xi2_m = moment2 / total_kpa
        row[r].area_m2 = elements * layout.area_m2[b]
        row[r].peak_kpa = peak_kpa
        row[r].elements = elements
