"""Hierarchy of bounding spheres over the cells of each patch, for the broad phase of contact."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CellTree", "build_cell_tree"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_CELLS_PER_LEAF = 8


class CellTree(NamedTuple):
    """Bounding spheres of groups of cells (q nodes), a binary tree per patch, in preorder.

    The nodes below node i are i + 1 to `after[i]`; so a traversal that finds nothing near a node goes on at
    `after[i]`.

    Attributes:
        root: (p + 1,) first node of each patch, then the number of nodes.
        after: (q,) first node that is not below this one.
        centre_m: (q, 3) centre of each sphere, frame of the patch's body [m].
        radius_m: (q,) radius, around the positions of the cells [m].
        first: (q,) where the cells of a leaf begin in `cell`; of inner nodes the end, so that they have none.
        end: (q,) where the cells of a node end in `cell`.
        cell: (n,) rows of the cells, leaf by leaf.
    """

    root: Indices
    after: Indices
    centre_m: Floats
    radius_m: Floats
    first: Indices
    end: Indices
    cell: Indices


def build_cell_tree(position_m: Sequence[Floats]) -> CellTree:
    """Build the hierarchy over patches with cells at `position_m`, each (n_i, 3) [m] in its body's frame."""
    nodes: list[tuple[int, Floats, float, int, int]] = []
    order: list[int] = []
    root, first_cell = [0], 0
    for positions_m in position_m:
        if len(positions_m):
            _add_node(positions_m, np.arange(len(positions_m)), first_cell, nodes, order)
        first_cell += len(positions_m)
        root.append(len(nodes))
    return CellTree(
        root=np.array(root, dtype=np.int64),
        after=np.array([node[0] for node in nodes], dtype=np.int64),
        centre_m=np.array([node[1] for node in nodes]).reshape(-1, 3),
        radius_m=np.array([node[2] for node in nodes], dtype=np.float64),
        first=np.array([node[3] for node in nodes], dtype=np.int64),
        end=np.array([node[4] for node in nodes], dtype=np.int64),
        cell=np.array(order, dtype=np.int64),
    )


def _add_node(
    position_m: Floats,
    rows: Indices,
    first_cell: int,
    nodes: list[tuple[int, Floats, float, int, int]],
    order: list[int],
) -> None:
    """Append the node of the cells `rows` of one patch, and all below it; halves along its longest side."""
    here_m = position_m[rows]
    low_m, high_m = here_m.min(axis=0), here_m.max(axis=0)
    centre_m = 0.5 * (low_m + high_m)
    radius_m = float(np.linalg.norm(here_m - centre_m, axis=1).max())
    place = len(nodes)
    nodes.append((0, centre_m, radius_m, 0, 0))
    if len(rows) <= _CELLS_PER_LEAF:
        first = len(order)
        order += [first_cell + int(row) for row in rows]
    else:
        along = here_m[:, np.argmax(high_m - low_m)]
        by_place, half = np.argsort(along, kind="stable"), len(rows) // 2
        for part in (by_place[:half], by_place[half:]):
            _add_node(position_m, rows[np.sort(part)], first_cell, nodes, order)
        first = len(order)
    nodes[place] = (len(nodes), centre_m, radius_m, first, len(order))
