"""Gateway placement on a patch: free ports, and k of them near to every cell (k-centre problem).

Cells use the route of fewest hops to any gateway. The objective is lexicographic: hops of the deepest cells,
their number, cells of the largest tree, sum of hops. The k-centre problem is NP-hard; the search is greedy
insertion followed by local search over single moves, from several first gateways. It is deterministic: the
same patch always gets the same placement.
"""

from collections.abc import Iterable

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path

from skinnet.deployment.schema import CellSpec, InterfaceSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import N_PORTS
from skinnet.skin.placement import PlacedPatch, place

__all__ = ["free_ports", "spread", "spread_over", "with_gateways"]

_Key = tuple[int, int, float, int]

_STARTS = 6
_FEW, _MANY = 10**6, 10**9
"""Search sizes, gateways² × cells × candidates, up to which multi-start and local search run."""


def free_ports(n_cells: int, wires: ArrayLike, taken: Iterable[tuple[int, int]] = ()) -> NDArray[np.int64]:
    """Return the free ports (f, 2) of cells 0 to `n_cells` − 1: used by no wire (m, 4) and not in `taken`.

    Ports of present interfaces count as free, since the interfaces are to be chosen. Rows are in order.
    """
    ends = np.asarray(wires, dtype=np.int64).reshape(-1, 2)
    free = np.ones((n_cells, N_PORTS), dtype=np.bool_)
    free[ends[:, 0], ends[:, 1]] = False
    for cell, port in taken:
        free[cell, port] = False
    return np.argwhere(free)


def spread(patch: PlacedPatch, k: int, taken: Iterable[tuple[int, int]] = ()) -> NDArray[np.int64]:
    """Place k gateways on one patch; return their (cell, port), (k, 2), in the order of cells.

    Args:
        patch: The patch; its present interfaces are ignored.
        k: Number of gateways.
        taken: Ports (cell, port) in other use, such as ends of bridges.

    Raises:
        DeploymentError: fewer than k cells have a free port, or the patch has more than k components.
    """
    try:
        return spread_over(patch.n_cells, patch.wires, free_ports(patch.n_cells, patch.wires, taken), k)
    except DeploymentError as error:
        raise DeploymentError(f"patches.{patch.name}: {error}") from None


def with_gateways(
    patch: PatchSpec, cells: CellSpec, k: int, taken: Iterable[tuple[int, int]] = ()
) -> PatchSpec:
    """Return `patch` with its gateways replaced by k placed ones; errors as `spread`."""
    places = spread(place(patch, cells), k, taken).tolist()
    interfaces = tuple(InterfaceSpec(cell=cell, port=port) for cell, port in places)
    return msgspec.structs.replace(patch, interfaces=interfaces)


def spread_over(n_cells: int, wires: ArrayLike, ports: NDArray[np.int64], k: int) -> NDArray[np.int64]:
    """Place k gateways (k, 2) among `ports` (f, 2) of cells that `wires` (m, 4) connect.

    A cell has one route to the computer, so that a second gateway at one cell would be idle: each cell gets
    at most one, on its lowest free port.

    Raises:
        DeploymentError: fewer than k cells have a port, or the wires leave more than k components.
    """
    cells, first = np.unique(ports[:, 0], return_index=True)
    if not 1 <= k <= len(cells):
        raise DeploymentError(
            f"{k} gateways: allowed are 1 to {len(cells)}, as many as cells have a free port"
        )
    hops = _hops(n_cells, wires, cells)
    chosen = list(range(k)) if k == len(cells) else _search(hops, k)
    if (hops[chosen].min(axis=0) == n_cells).any():
        raise DeploymentError(
            f"{k} gateways: the cells are in more pieces than that; give each piece its own"
        )
    places: NDArray[np.int64] = ports[first[chosen]]
    return places


def _hops(n_cells: int, wires: ArrayLike, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return hop counts (c, n) from each of `cells` to all n cells; n where there is no path."""
    ends = np.asarray(wires, dtype=np.int64).reshape(-1, 4)
    ones = np.ones(len(ends), dtype=np.int8)
    graph = coo_array((ones, (ends[:, 0], ends[:, 2])), shape=(n_cells, n_cells)).tocsr()
    hops = shortest_path(graph, directed=False, unweighted=True, indices=cells)
    return np.where(np.isfinite(hops), hops, n_cells).astype(np.int64)


def _search(hops: NDArray[np.int64], k: int) -> list[int]:
    """Search from several first gateways, the best single one and some candidates spaced evenly."""
    size = k * k * hops.size
    more = np.linspace(0, len(hops) - 1, _STARTS if size <= _FEW else 0).astype(np.int64).tolist()
    firsts = [_best(hops, [])[0], *more]
    return min(_choose(hops, [one], k, move=size <= _MANY) for one in firsts)[1]


def _choose(hops: NDArray[np.int64], chosen: list[int], k: int, *, move: bool) -> tuple[_Key, list[int]]:
    """Insert greedily up to k, then move single gateways while that helps; return key and choice."""
    while len(chosen) < k:
        chosen.append(_best(hops, chosen)[0])
    moved = move
    while moved:
        moved = False
        for i in range(len(chosen)):
            others = chosen[:i] + chosen[i + 1 :]
            best, keys = _best(hops, others)
            if keys[best] < keys[chosen[i]]:
                chosen[i], moved = best, True
    chosen.sort()
    return _best(hops, chosen[1:])[1][chosen[0]], chosen


def _best(hops: NDArray[np.int64], others: list[int]) -> tuple[int, list[_Key]]:
    """Return the best candidate beside `others`, the first of equals, and the key of every candidate.

    A key is: hops of the deepest cells, their number, cells of the largest tree, sum of hops. A cell at equal
    distance from several gateways counts for each in equal fractions.
    """
    n_cells = hops.shape[1]
    nearest = hops[others].min(axis=0) if others else np.full(n_cells, n_cells + 1)
    owners = (hops[others] == nearest).astype(np.float64)
    rivals = np.maximum(owners.sum(axis=0), 1.0)
    closer, tie = hops < nearest, hops == nearest
    mine = closer + tie / (rivals + 1.0)
    theirs = np.where(closer, 0.0, np.where(tie, 1.0 / (rivals + 1.0), 1.0 / rivals)) @ owners.T
    largest = np.maximum(mine.sum(axis=1), theirs.max(axis=1, initial=0.0)).round(6)  # for any BLAS order
    ways = np.minimum(hops, nearest)
    depth = ways.max(axis=1)
    deepest = (ways == depth[:, None]).sum(axis=1)
    columns = (depth, deepest, largest, ways.sum(axis=1))
    keys = list(zip(*(column.tolist() for column in columns), strict=True))
    taken = set(others)
    return min((i for i in range(len(keys)) if i not in taken), key=keys.__getitem__), keys
