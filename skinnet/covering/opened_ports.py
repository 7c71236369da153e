"""Free ports amid a patch: cells turned by 60°, so that a gateway can stand where all ports had wires.

The covering joins as many ports as it can. A large patch, or a closed one, then has free ports at its edge
only, and the cells amid it share too few links to the gateways there.
"""

import msgspec
import numpy as np
from scipy.sparse.csgraph import dijkstra

from skinnet.covering.covering_patches import DIGITS_AXIS, rounded_vector
from skinnet.covering.port_turns import turned
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.skin.gateway_placement import free_ports
from skinnet.skin.placement import PlacedPatch, place_patch
from skinnet.skin.wire_graph import wire_components, wire_graph

__all__ = ["open_ports"]

Ports = frozenset[tuple[int, int]]


def open_ports(patch: PatchSpec, cells: CellSpec, n_opened: int, bridged: Ports) -> tuple[PatchSpec, int]:
    """Turn up to `n_opened` cells, those farthest from a free port, so that each gets one; and count them.

    The wiring stays in one component, and cells that bridges end at stay as they are.

    Args:
        patch: A patch whose cells are one component.
        cells: Cells.
        n_opened: Greatest number of cells to turn.
        bridged: Ports (cell, port) that bridges end at.
    """
    count = 0
    while count < n_opened:
        deepest = _deepest(place_patch(patch, cells), frozenset(cell for cell, _ in bridged))
        opened = next(filter(None, (_opened(patch, cells, cell, bridged) for cell in deepest)), None)
        if opened is None:
            break
        patch, count = opened, count + 1
    return patch, count


def _deepest(placed: PlacedPatch, fixed: frozenset[int]) -> list[int]:
    """Cells without a free port that may turn, those first that have most hops to one."""
    hops = dijkstra(
        wire_graph(placed.n_cells, placed.wires),
        directed=False,
        indices=free_ports(placed.n_cells, placed.wires)[:, 0],
        unweighted=True,
        min_only=True,
    )
    order = np.lexsort((np.arange(placed.n_cells), -hops))
    return [cell for cell in order.tolist() if hops[cell] > 0 and cell not in fixed]


def _opened(patch: PatchSpec, cells: CellSpec, cell: int, bridged: Ports) -> PatchSpec | None:
    """The patch with a cell turned so that it has a free port, if its cells then still are one component.

    No wire may take a port of a bridge: a neighbour that turns can come to face it.
    """
    R = place_patch(patch, cells).R_body_cell[[cell]]
    for turn in (1, 2):
        x_axis = rounded_vector(turned(R, np.array([turn]))[0, :, 0], DIGITS_AXIS)
        pose = msgspec.structs.replace(patch.cells[cell], x_axis=x_axis)
        new = msgspec.structs.replace(patch, cells=(*patch.cells[:cell], pose, *patch.cells[cell + 1 :]))
        placed = place_patch(new, cells)
        free = {(at, port) for at, port in free_ports(placed.n_cells, placed.wires).tolist()}
        is_open = cell in {at for at, _ in free}
        if is_open and bridged <= free and len(wire_components(placed.n_cells, placed.wires)) == 1:
            return new
    return None
