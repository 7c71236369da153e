"""Cuts of groups of patches that have more cells than the ports of one gateway can carry."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import shortest_path

from skinnet.covering.covering_patches import patch_name
from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.skin.whole_skin import WholeSkin
from skinnet.skin.wire_graph import wire_components, wire_graph
from skinnet.tools.plan.gateway_search import PatchGroup

__all__ = ["cut_group"]

Indices = NDArray[np.int64]


def cut_group(
    patches: Sequence[PatchSpec], bridges: Sequence[BridgeSpec], skin: WholeSkin, group: PatchGroup
) -> tuple[list[list[PatchSpec]], list[BridgeSpec]]:
    """Cut a group of patches into two of about as many cells, each in one piece.

    Return for each patch what becomes of it, itself or its parts, and the bridges that are left.

    Args:
        patches: All patches, each with its cells one by one and without gateways.
        bridges: Bridges between them.
        skin: The same as one graph.
        group: Group of it to cut.
    """
    far = np.zeros(skin.n_cells, dtype=np.int64)
    far[group.cells[_far_half(len(group.cells), group.wires)]] = 1
    place: dict[tuple[str, int], str] = {}
    parts = []
    for patch, placed, first in zip(patches, skin.patches, skin.first_cell.tolist(), strict=False):
        side = far[first : first + placed.n_cells]
        kept = placed.wires[side[placed.wires[:, 0]] == side[placed.wires[:, 2]]]
        pieces = wire_components(placed.n_cells, kept)
        names = [patch_name(patch.name, str(k) if len(pieces) > 1 else "") for k in range(len(pieces))]
        parts.append(
            [
                msgspec.structs.replace(patch, name=name, cells=tuple(patch.cells[i] for i in piece))
                for name, piece in zip(names, pieces, strict=True)
            ]
        )
        for name, piece in zip(names, pieces, strict=True):
            place |= {(patch.name, old): f"{name}/{new}" for new, old in enumerate(piece.tolist())}
    row = {patch.name: first for patch, first in zip(patches, skin.first_cell.tolist(), strict=False)}
    left = []
    for bridge in bridges:
        (a, cell_a, port_a), (b, cell_b, port_b) = parse_port(bridge.a), parse_port(bridge.b)
        if far[row[a] + cell_a] == far[row[b] + cell_b]:
            left.append(BridgeSpec(a=f"{place[a, cell_a]}:{port_a}", b=f"{place[b, cell_b]}:{port_b}"))
    return parts, left


def _far_half(n_cells: int, wires: Indices) -> Indices:
    """Cells of a connected graph far from one of its ends, about half of them; both halves are connected."""
    graph = wire_graph(n_cells, wires)
    start = int(np.argmax(shortest_path(graph, directed=False, unweighted=True, indices=0)))
    hops = shortest_path(graph, directed=False, unweighted=True, indices=start)
    is_near = np.zeros(n_cells, dtype=np.bool_)
    is_near[np.lexsort((np.arange(n_cells), hops))[: n_cells // 2]] = True
    far_wires = wires[~is_near[wires[:, 0]] & ~is_near[wires[:, 2]]]
    pieces = [piece for piece in wire_components(n_cells, far_wires) if not is_near[piece[0]]]
    return max(pieces, key=len)
