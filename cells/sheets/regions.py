"""Contact regions of tactile sheets: segmentation, features, and tracking over frames.

An element (taxel) is active from `activation_kpa` until it falls below `deactivation_kpa` (hysteresis
thresholding). A region is a connected component of active elements. Its rim, inactive neighbours with a
reading above zero, also counts for its force: several per cent for a cylinder. The force is the sum of
pressure times area, the centre of pressure ξ the pressure-weighted mean of coordinates [R11, III]; area, peak
and number of elements are those of the active elements. `matching` keeps the region's ID from frame to frame.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sheets.region_quantisation import MAX_REGIONS, MAX_ROWS
from cells.sheets.region_tracking import TrackedRegions, match_regions
from skinnet.compilation import compiled
from skinnet.deployment.skin.sheets import RegionSpec
from skinnet.errors import DeploymentError
from skinnet.protocol.sheet_messages import REGION_ROW
from skinnet.skin.tactile_sheets import PlacedSheet

__all__ = ["RegionTracker"]

_PA_PER_KPA = 1e3


class _ElementGraph(NamedTuple):
    """Adjacency of the elements of all boards: board b has elements start[b] to start[b + 1].

    Neighbours of element i are neighbour[first[i]] to neighbour[first[i + 1]] (compressed sparse rows).
    """

    start: NDArray[np.int64]
    first: NDArray[np.int64]
    neighbour: NDArray[np.int64]
    xi_m: NDArray[np.float64]
    area_m2: NDArray[np.float64]


class _Thresholds(NamedTuple):
    """Thresholds of regions: pressures [kPa] and association distance [m], as in `RegionSpec`."""

    activation_kpa: float
    deactivation_kpa: float
    association_distance_m: float


class _Workspace(NamedTuple):
    """Scratch arrays: component of each element, also with rims; stack of a search; overlap of regions."""

    component: NDArray[np.int64]
    component_with_rim: NDArray[np.int64]
    stack: NDArray[np.int64]
    overlap: NDArray[np.int64]


class _FrameRegions(NamedTuple):
    """Regions of one frame: rows, number of rows per board, region ID per element; all overwritten."""

    rows: NDArray[Any]
    n_rows: NDArray[np.int64]
    region_id: NDArray[np.uint16]


class RegionTracker:
    """Tracker of the contact regions of boards.

    Attributes:
        rows: (boards, 32) `REGION_ROW` of the last frame: regions in order of their first element, then those
            that ended; times are not set.
        n_rows: (boards,) number of valid rows.
        region_id: (n,) region ID of each element in the last frame, 0 for none.
    """

    def __init__(self, sheets: Sequence[PlacedSheet], spec: RegionSpec) -> None:
        """Create a tracker without regions.

        Raises:
            DeploymentError: `deactivation_kpa` is above `activation_kpa`.
        """
        if spec.deactivation_kpa > spec.activation_kpa:
            raise DeploymentError(
                f"regions.deactivation_kpa = {spec.deactivation_kpa}: may not be above "
                f"activation_kpa = {spec.activation_kpa}"
            )
        boards = len(sheets)
        self._graph = _element_graph(sheets)
        n = len(self._graph.xi_m)
        self._thresholds = _Thresholds(
            float(spec.activation_kpa), float(spec.deactivation_kpa), float(spec.association_distance_m)
        )
        self.region_id = np.zeros(n, dtype=np.uint16)
        self.rows: NDArray[Any] = np.zeros((boards, MAX_ROWS), dtype=REGION_ROW)
        self.rows["board"] = np.arange(boards)[:, None]
        self.n_rows = np.zeros(boards, dtype=np.int64)
        component, component_with_rim = np.full((2, n), -1, dtype=np.int64)
        self._tracked = TrackedRegions(
            first_element=self._graph.start,
            label=np.full(n, -1, dtype=np.int64),
            n_regions=np.zeros(boards, dtype=np.int64),
            region_id=np.zeros((boards, MAX_REGIONS), dtype=np.uint16),
            xi_m=np.zeros((boards, MAX_REGIONS, 2)),
            last_id=np.zeros(boards, dtype=np.uint16),
        )
        self._workspace = _Workspace(
            component,
            component_with_rim,
            stack=np.empty(n, dtype=np.int64),
            overlap=np.zeros((MAX_REGIONS, MAX_REGIONS), dtype=np.int64),
        )
        self._frame = _FrameRegions(self.rows, self.n_rows, self.region_id)

    def update(self, readings_kpa: NDArray[np.float64]) -> None:
        """Update the regions of all boards with the readings (n,) [kPa] of the next frame."""
        assert readings_kpa.shape == self.region_id.shape
        _track(readings_kpa, self._graph, self._thresholds, self._tracked, self._workspace, self._frame)

    def reset(self, board: int) -> None:
        """Reset a board after a power cycle: it has no region; region IDs continue."""
        mine = slice(*self._graph.start[board : board + 2].tolist())
        self._tracked.label[mine] = -1
        self._tracked.n_regions[board] = 0
        self.region_id[mine] = 0


def _element_graph(sheets: Sequence[PlacedSheet]) -> _ElementGraph:
    sizes = [sheet.n_elements for sheet in sheets]
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    pairs = np.vstack([sheet.neighbours + first for sheet, first in zip(sheets, start, strict=False)])
    both = np.vstack([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    first = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=start[-1]))]).astype(np.int64)
    return _ElementGraph(
        start=start,
        first=first,
        neighbour=np.ascontiguousarray(both[:, 1]),
        xi_m=np.vstack([sheet.xi_m for sheet in sheets]),
        area_m2=np.array([sheet.area_m2 for sheet in sheets]),
    )


@compiled
def _track(
    readings_kpa: NDArray[np.float64],
    graph: _ElementGraph,
    thresholds: _Thresholds,
    tracked: TrackedRegions,
    workspace: _Workspace,
    frame: _FrameRegions,
) -> None:
    component, rows, distance_m = workspace.component, frame.rows, thresholds.association_distance_m
    for b in range(frame.n_rows.size):
        n = _label_components(readings_kpa, graph, b, thresholds, tracked.label, workspace)
        if n > 0:
            _add_rims(readings_kpa, graph, b, component, workspace.component_with_rim)
            _write_features(readings_kpa, graph, b, component, workspace.component_with_rim, rows[b], n)
        frame.n_rows[b] = match_regions(b, n, component, distance_m, tracked, workspace.overlap, rows[b])
        for i in range(graph.start[b], graph.start[b + 1]):
            frame.region_id[i] = rows[b, component[i]].region_id if component[i] >= 0 else 0


@compiled
def _label_components(
    readings_kpa: NDArray[np.float64],
    graph: _ElementGraph,
    board: int,
    thresholds: _Thresholds,
    last_component: NDArray[np.int64],
    workspace: _Workspace,
) -> int:
    """Label the connected components of active elements of a board; return their number.

    Elements with `last_component` ≥ 0 were active in the last frame.
    """
    component, stack = workspace.component, workspace.stack
    on_kpa, off_kpa = thresholds.activation_kpa, thresholds.deactivation_kpa
    begin, end = graph.start[board], graph.start[board + 1]
    waits = -2
    for i in range(begin, end):
        active = readings_kpa[i] >= (off_kpa if last_component[i] >= 0 else on_kpa)
        component[i] = waits if active else -1
    n = 0
    for i in range(begin, end):
        if component[i] != waits:
            continue
        component[i] = n
        stack[0], depth = i, 1
        while depth > 0:
            depth -= 1
            at = stack[depth]
            for j in range(graph.first[at], graph.first[at + 1]):
                to = graph.neighbour[j]
                if component[to] == waits:
                    component[to] = n
                    stack[depth] = to
                    depth += 1
        n += 1
    return n


@compiled
def _add_rims(
    readings_kpa: NDArray[np.float64],
    graph: _ElementGraph,
    board: int,
    component: NDArray[np.int64],
    component_with_rim: NDArray[np.int64],
) -> None:
    """Add rims to components: `component_with_rim` is that of the element or of its highest neighbour."""
    for i in range(graph.start[board], graph.start[board + 1]):
        component_with_rim[i] = component[i]
        highest_kpa = 0.0
        if component[i] < 0 and readings_kpa[i] > 0.0:
            for j in range(graph.first[i], graph.first[i + 1]):
                to = graph.neighbour[j]
                if component[to] >= 0 and readings_kpa[to] > highest_kpa:
                    component_with_rim[i], highest_kpa = component[to], readings_kpa[to]


@compiled
def _write_features(
    readings_kpa: NDArray[np.float64],
    graph: _ElementGraph,
    board: int,
    component: NDArray[np.int64],
    component_with_rim: NDArray[np.int64],
    row: Any,
    n: int,
) -> None:
    """Write the features of the `n` regions of board `board` into its rows."""
    for r in range(n):
        total_kpa, moment1, moment2, peak_kpa, elements = 0.0, 0.0, 0.0, 0.0, 0
        for i in range(graph.start[board], graph.start[board + 1]):
            if component_with_rim[i] == r:
                total_kpa += readings_kpa[i]
                moment1 += readings_kpa[i] * graph.xi_m[i, 0]
                moment2 += readings_kpa[i] * graph.xi_m[i, 1]
            if component[i] == r:
                peak_kpa = max(peak_kpa, readings_kpa[i])
                elements += 1
        row[r].force_n = total_kpa * _PA_PER_KPA * graph.area_m2[board]
        row[r].xi1_m = moment1 / total_kpa
        row[r].xi2_m = moment2 / total_kpa
        row[r].area_m2 = elements * graph.area_m2[board]
        row[r].peak_kpa = peak_kpa
        row[r].n_elements = elements
