"""Patches of a covering: components of its wiring, bridges between them, one gateway for each group."""

import math
import re
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skinnet import pinned_math
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import CellPoseSpec, InterfaceSpec, PatchSpec
from skinnet.skin.gateway_placement import choose_gateway_ports, free_ports
from skinnet.skin.lattice import PORT_ANGLES_RAD, pitch_m
from skinnet.skin.placement import PlacedPatch, place_patch

__all__ = ["bridges_between", "component_patches", "patch_name", "with_one_gateway_each"]

Floats = NDArray[np.float64]

_MAX_BRIDGE_FRACTION = 1.0
"""Greatest length of a bridge from port to port, as a fraction of the pitch."""
_SAME_SIDE_COSINE = -0.5
_MAX_NAME = 64
_DIGITS_M, _DIGITS_AXIS = 6, 6


def component_patches(
    name: str, body: str, position_m: Floats, R_body_cell: Floats, cells: CellSpec, min_component: int
) -> list[PatchSpec]:
    """Patches without interfaces, one for each component of the wiring of cells on `body`, the largest first.

    Args:
        name: Name of the patches, with a number if there are several.
        body: Body that carries them.
        position_m: (n, 3) centres of the cells, frame of the body [m].
        R_body_cell: (n, 3, 3) their axes.
        cells: Cells.
        min_component: Least number of cells of a patch; smaller components are left out.
    """
    poses = [
        CellPoseSpec(
            position_m=_rounded(p, _DIGITS_M), normal=_rounded(z, 6), x_axis=_rounded(x, _DIGITS_AXIS)
        )
        for p, x, z in zip(position_m, R_body_cell[:, :, 0], R_body_cell[:, :, 2], strict=True)
    ]
    if not poses:
        return []
    whole = place_patch(PatchSpec(name=patch_name(name), body=body, cells=tuple(poses)), cells)
    label = _components(len(poses), whole.wires)
    members = [np.flatnonzero(label == k) for k in range(label.max() + 1)]
    members = sorted((m for m in members if len(m) >= min_component), key=lambda m: (-len(m), int(m[0])))
    return [
        PatchSpec(
            name=patch_name(name, str(number) if len(members) > 1 else ""),
            body=body,
            cells=tuple(poses[i] for i in cells_of),
        )
        for number, cells_of in enumerate(members)
    ]


def patch_name(*parts: str) -> str:
    """Name of a patch from parts: characters that names may not have become _, long parts are cut."""
    *head, tail = (re.sub(r"[^A-Za-z0-9_\-]", "_", part) for part in parts if part)
    text = "_".join(head)
    return f"{text[: _MAX_NAME - len(tail) - 1]}_{tail}" if text else tail[:_MAX_NAME]


def bridges_between(
    patches: Sequence[PlacedPatch], poses: Sequence[tuple[Floats, Floats]], side_m: float
) -> list[BridgeSpec]:
    """Bridges that join patches of one link where free ports are near: the shortest first (Kruskal).

    Args:
        patches: Patches of the link.
        poses: Rotation and translation of each patch's body in one common frame.
        side_m: Side of the cells [m].
    """
    ends: list[tuple[int, int, int]] = []
    ports_m, normals = [], []
    apothem_m = 0.5 * pitch_m(side_m)
    for number, (patch, (R, t)) in enumerate(zip(patches, poses, strict=True)):
        used = [(int(cell), int(port)) for cell, port in patch.interfaces]
        for cell, port in free_ports(patch.n_cells, patch.wires, used).tolist():
            x, y, z = patch.R_body_cell[cell].T
            angle = PORT_ANGLES_RAD[port]
            at_m = patch.position_m[cell] + apothem_m * (
                pinned_math.cos(angle) * x + pinned_math.sin(angle) * y
            )
            ends.append((number, cell, port))
            ports_m.append(t + (R * at_m).sum(axis=1))
            normals.append((R * z).sum(axis=1))
    if len(patches) < 2 or not ends:
        return []
    candidates = []
    for a, b in sorted(cKDTree(np.array(ports_m)).query_pairs(_MAX_BRIDGE_FRACTION * 2.0 * apothem_m)):
        if ends[a][0] != ends[b][0] and float((normals[a] * normals[b]).sum()) > _SAME_SIDE_COSINE:
            length_m = float(np.sqrt(((ports_m[a] - ports_m[b]) ** 2).sum()))
            candidates.append((round(length_m, 5), min(ends[a], ends[b]), max(ends[a], ends[b])))
    group, bridges = list(range(len(patches))), []
    taken: set[tuple[int, int, int]] = set()
    for _, one, other in sorted(candidates):
        if group[one[0]] == group[other[0]] or one in taken or other in taken:
            continue
        taken |= {one, other}
        old, new = group[other[0]], group[one[0]]
        group = [new if number == old else number for number in group]
        bridges.append(
            BridgeSpec(
                a=f"{patches[one[0]].name}/{one[1]}:{one[2]}",
                b=f"{patches[other[0]].name}/{other[1]}:{other[2]}",
            )
        )
    return bridges


def with_one_gateway_each(
    patches: Sequence[PatchSpec], bridges: Iterable[BridgeSpec], cells: CellSpec
) -> list[PatchSpec]:
    """Patches with one interface for each group that bridges join, near to all of its cells."""
    number = {patch.name: i for i, patch in enumerate(patches)}
    placed = [place_patch(patch, cells) for patch in patches]
    first = np.concatenate([[0], np.cumsum([p.n_cells for p in placed])]).astype(np.int64)
    wires = [p.wires + np.array([first[i], 0, first[i], 0]) for i, p in enumerate(placed)]
    for bridge in bridges:
        rows = []
        for end in (bridge.a, bridge.b):
            name, _, place = end.rpartition("/")
            cell, _, port = place.partition(":")
            rows += [first[number[name]] + int(cell), int(port)]
        wires.append(np.array([rows]))
    every = np.concatenate(wires) if wires else np.zeros((0, 4), dtype=np.int64)
    label = _components(int(first[-1]), every)
    interfaces: list[list[InterfaceSpec]] = [[] for _ in patches]
    for group in range(label.max() + 1):
        mine = np.flatnonzero(label == group)
        new = np.full(len(label), -1, dtype=np.int64)
        new[mine] = np.arange(len(mine))
        own = every[label[every[:, 0]] == group].copy()
        own[:, [0, 2]] = new[own[:, [0, 2]]]
        cell, port = choose_gateway_ports(len(mine), own, free_ports(len(mine), own), 1)[0]
        patch = int(np.searchsorted(first, mine[cell], side="right")) - 1
        interfaces[patch].append(InterfaceSpec(cell=int(mine[cell] - first[patch]), port=int(port)))
    return [
        msgspec.structs.replace(patch, interfaces=tuple(found))
        for patch, found in zip(patches, interfaces, strict=True)
    ]


def _components(n_cells: int, wires: NDArray[np.int64]) -> NDArray[np.int64]:
    """Component (n,) of each cell, in the order of their first cells."""
    ones = np.ones(len(wires), dtype=np.int8)
    graph = coo_array((ones, (wires[:, 0], wires[:, 2])), shape=(n_cells, n_cells))
    found = connected_components(graph, directed=False)[1]
    _, first, label = np.unique(found, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray(rank[label.reshape(-1)], dtype=np.int64)


def _rounded(vector: Floats, digits: int) -> tuple[float, float, float]:
    x, y, z = (round(float(value), digits) + 0.0 for value in vector)
    if not math.isfinite(x + y + z):
        raise AssertionError("a cell's pose is not finite")
    return x, y, z
