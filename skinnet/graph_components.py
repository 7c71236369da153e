"""Connected components of an undirected graph.

As `scipy.sparse.csgraph.connected_components`, whose import takes longer than most commands.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["connected_components"]


def connected_components(n_nodes: int, a: ArrayLike, b: ArrayLike) -> NDArray[np.int64]:
    """Component (n,) of each node of a graph with edges between `a` (m,) and `b` (m,).

    Components are numbered in the order of their first nodes. Each round hooks every tree of nodes to the
    lowest root that an edge leads to, and makes all nodes children of their roots (Shiloach, Vishkin, 1982).
    """
    a, b = np.asarray(a, dtype=np.int64), np.asarray(b, dtype=np.int64)
    root = np.arange(n_nodes)
    while True:
        low = np.minimum(root[a], root[b])
        hooked = root.copy()
        np.minimum.at(hooked, root[a], low)
        np.minimum.at(hooked, root[b], low)
        if (hooked == root).all():
            return np.unique(root, return_inverse=True)[1].astype(np.int64)
        while (hooked[hooked] != hooked).any():
            hooked = hooked[hooked]
        root = hooked
