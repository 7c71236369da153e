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

from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import InterfaceSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import N_PORTS
from skinnet.skin.placement import PlacedPatch, place_patch
from skinnet.skin.wire_graph import wire_graph

__all__ = [
    "MAX_GATEWAY_PORTS",
    "choose_gateway_ports",
    "free_ports",
    "place_gateways",
    "with_placed_gateways",
]

_Key = tuple[int, int, float, int]

MAX_GATEWAY_PORTS = 16
"""Greatest number of ports of one gateway, and so of interfaces of a group: packets name them by 4 bits."""

_N_STARTS = 6
_MULTI_START_LIMIT, _LOCAL_SEARCH_LIMIT = 10**6, 10**9
"""Search sizes, gateways² × cells × candidates, up to which multi-start and local search run."""


def free_ports(n_cells: int, wires: ArrayLike, used: Iterable[tuple[int, int]] = ()) -> NDArray[np.int64]:
    """Return the free ports (f, 2) of cells 0 to `n_cells` − 1: used by no wire (m, 4) and not in `used`.

    Ports of present interfaces count as free, since the interfaces are to be chosen. Rows are in order.
    """
    ends = np.asarray(wires, dtype=np.int64).reshape(-1, 2)
    free = np.ones((n_cells, N_PORTS), dtype=np.bool_)
    free[ends[:, 0], ends[:, 1]] = False
    for cell, port in used:
        free[cell, port] = False
    return np.argwhere(free)


def place_gateways(
    patch: PlacedPatch, n_gateways: int, used: Iterable[tuple[int, int]] = ()
) -> NDArray[np.int64]:
    """Place k gateways on one patch; return their (cell, port), (k, 2), in the order of cells.

    Args:
        patch: The patch; its present interfaces are ignored.
        n_gateways: Number of gateways.
        used: Ports (cell, port) in other use, such as ends of bridges.

    Raises:
        DeploymentError: fewer than k cells have a free port, or the patch has more than k components.
    """
    try:
        return choose_gateway_ports(
            patch.n_cells, patch.wires, free_ports(patch.n_cells, patch.wires, used), n_gateways
        )
    except DeploymentError as error:
        raise DeploymentError(f"patches.{patch.name}: {error}") from None


def with_placed_gateways(
    patch: PatchSpec, cells: CellSpec, n_gateways: int, used: Iterable[tuple[int, int]] = ()
) -> PatchSpec:
    """Return `patch` with its gateways replaced by k placed ones; errors as `place_gateways`."""
    places = place_gateways(place_patch(patch, cells), n_gateways, used).tolist()
    interfaces = tuple(InterfaceSpec(cell=cell, port=port) for cell, port in places)
    return msgspec.structs.replace(patch, interfaces=interfaces)


def choose_gateway_ports(
    n_cells: int, wires: ArrayLike, ports: NDArray[np.int64], n_gateways: int
) -> NDArray[np.int64]:
    """Place k gateways (k, 2) among `ports` (f, 2) of cells that `wires` (m, 4) connect.

    A cell has one route to the computer, so that a second gateway at one cell would be idle: each cell gets
    at most one, on its lowest free port.

    Raises:
        DeploymentError: fewer than k cells have a port, or the wires leave more than k components.
    """
    cells, first = np.unique(ports[:, 0], return_index=True)
    if not 1 <= n_gateways <= len(cells):
        raise DeploymentError(
            f"{n_gateways} gateways: give 1 to {len(cells)}, the number of cells with a free port"
        )
    hops = _hop_counts(n_cells, wires, cells)
    chosen = list(range(n_gateways)) if n_gateways == len(cells) else _multi_start_search(hops, n_gateways)
    if (hops[chosen].min(axis=0) == n_cells).any():
        raise DeploymentError(
            f"{n_gateways} gateways: the cells have more connected components; give at least one gateway "
            "per component"
        )
    places: NDArray[np.int64] = ports[first[chosen]]
    return places


def _hop_counts(n_cells: int, wires: ArrayLike, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return hop counts (c, n) from each of `cells` to all n cells; n where there is no path."""
    from scipy.sparse.csgraph import shortest_path  # its import takes longer than most commands

    hops = shortest_path(wire_graph(n_cells, wires), directed=False, unweighted=True, indices=cells)
    return np.where(np.isfinite(hops), hops, n_cells).astype(np.int64)


def _multi_start_search(hops: NDArray[np.int64], n_gateways: int) -> list[int]:
    """Search from several first gateways, the best single one and some candidates spaced evenly."""
    size = n_gateways * n_gateways * hops.size
    more = (
        np.linspace(0, len(hops) - 1, _N_STARTS if size <= _MULTI_START_LIMIT else 0)
        .astype(np.int64)
        .tolist()
    )
    firsts = [_best_candidate(hops, [])[0], *more]
    return min(
        _greedy_search(hops, [one], n_gateways, local_search=size <= _LOCAL_SEARCH_LIMIT) for one in firsts
    )[1]


def _greedy_search(
    hops: NDArray[np.int64], chosen: list[int], n_gateways: int, *, local_search: bool
) -> tuple[_Key, list[int]]:
    """Insert greedily up to k, then move single gateways while that helps; return key and choice."""
    while len(chosen) < n_gateways:
        chosen.append(_best_candidate(hops, chosen)[0])
    moved = local_search
    while moved:
        moved = False
        for i in range(len(chosen)):
            others = chosen[:i] + chosen[i + 1 :]
            best, keys = _best_candidate(hops, others)
            if keys[best] < keys[chosen[i]]:
                chosen[i], moved = best, True
    chosen.sort()
    return _best_candidate(hops, chosen[1:])[1][chosen[0]], chosen


def _best_candidate(hops: NDArray[np.int64], chosen: list[int]) -> tuple[int, list[_Key]]:
    """Return the best candidate beside `chosen`, the first of equals, and the key of every candidate.

    A key is: hops of the deepest cells, their number, cells of the largest tree, sum of hops. A cell at equal
    distance from several gateways counts for each in equal fractions.
    """
    n_cells = hops.shape[1]
    nearest = hops[chosen].min(axis=0) if chosen else np.full(n_cells, n_cells + 1)
    owners = (hops[chosen] == nearest).astype(np.float64)
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
    taken = set(chosen)
    return min((i for i in range(len(keys)) if i not in taken), key=keys.__getitem__), keys
