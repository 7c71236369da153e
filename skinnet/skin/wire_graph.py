"""Graph of cells that wires connect: its components and hops."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.graph_components import connected_components

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["wire_components", "wire_graph"]

Indices = NDArray[np.int64]


def wire_graph(n_cells: int, wires: ArrayLike) -> "csr_array":
    """Adjacency (n, n) of cells that `wires` (m, 4), rows of (cell, port, cell, port), connect."""
    from scipy.sparse import coo_array  # its import takes longer than most commands

    ends = np.asarray(wires, dtype=np.int64).reshape(-1, 4)
    ones = np.ones(len(ends), dtype=np.int8)
    return coo_array((ones, (ends[:, 0], ends[:, 2])), shape=(n_cells, n_cells)).tocsr()


def wire_components(n_cells: int, wires: ArrayLike) -> list[Indices]:
    """Cells of each component of the wiring, ascending, in the order of their first cells."""
    ends = np.asarray(wires, dtype=np.int64).reshape(-1, 4)
    label = connected_components(n_cells, ends[:, 0], ends[:, 2])
    return [np.flatnonzero(label == k) for k in range(int(label.max(initial=-1)) + 1)]
