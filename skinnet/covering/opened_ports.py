"""Free ports amid a patch: cells turned by 60°, so that a gateway can stand where all ports had wires.

The covering joins as many ports as it can. A large patch, or a closed one, then has free ports at its edge
only, and the cells amid it share too few links to the gateways there.
"""

from collections import deque

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.covering.port_turns import turned
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.skin.gateway_placement import free_ports
from skinnet.skin.placement import PlacedPatch, place_patch

__all__ = ["open_ports"]

_DIGITS = 6


def open_ports(
    patch: PatchSpec, cells: CellSpec, n_opened: int, fixed: frozenset[int]
) -> tuple[PatchSpec, int]:
    """Turn up to `n_opened` cells, those farthest from a free port, so that each gets one; and count them.

    All other wires stay, and so does the wiring's one component.

    Args:
        patch: A patch whose cells are one component.
        cells: Cells.
        n_opened: Greatest number of cells to turn.
        fixed: Cells that must not turn, as bridges end at them.
    """
    count = 0
    while count < n_opened:
        placed = place_patch(patch, cells)
        opened = next(filter(None, (_opened(patch, cells, cell) for cell in _deepest(placed, fixed))), None)
        if opened is None:
            break
        patch, count = opened, count + 1
    return patch, count


def _deepest(placed: PlacedPatch, fixed: frozenset[int]) -> list[int]:
    """Cells without a free port that may turn, those first that have most hops to one."""
    hops = _hops(placed.n_cells, placed.wires, free_ports(placed.n_cells, placed.wires)[:, 0])
    order = np.lexsort((np.arange(placed.n_cells), -hops))
    return [cell for cell in order.tolist() if hops[cell] > 0 and cell not in fixed]


def _opened(patch: PatchSpec, cells: CellSpec, cell: int) -> PatchSpec | None:
    """The patch with a cell turned so that it has a free port, if its cells then still are one component."""
    R = place_patch(patch, cells).R_body_cell[[cell]]
    for turn in (1, 2):
        x_axis = tuple(round(float(x), _DIGITS) + 0.0 for x in turned(R, np.array([turn]))[0, :, 0])
        pose = msgspec.structs.replace(patch.cells[cell], x_axis=x_axis)
        new = msgspec.structs.replace(patch, cells=(*patch.cells[:cell], pose, *patch.cells[cell + 1 :]))
        placed = place_patch(new, cells)
        is_open = cell in free_ports(placed.n_cells, placed.wires)[:, 0].tolist()
        if is_open and (_hops(placed.n_cells, placed.wires, np.array([cell])) >= 0).all():
            return new
    return None


def _hops(n_cells: int, wires: NDArray[np.int64], sources: NDArray[np.int64]) -> NDArray[np.int64]:
    """Hops (n,) over wires from each cell to the nearest of `sources`; −1 where none is reached."""
    near: list[list[int]] = [[] for _ in range(n_cells)]
    for one, _, other, _ in wires.tolist():
        near[one].append(other)
        near[other].append(one)
    hops = np.full(n_cells, -1, dtype=np.int64)
    hops[sources] = 0
    waiting = deque(dict.fromkeys(sources.tolist()))
    while waiting:
        cell = waiting.popleft()
        for other in near[cell]:
            if hops[other] < 0:
                hops[other] = hops[cell] + 1
                waiting.append(other)
    return hops
