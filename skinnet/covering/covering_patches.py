"""Patches of a covering: components of its wiring, and bridges that join those of a link."""

import math
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet import pinned_linalg, pinned_math
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import CellPoseSpec, PatchSpec
from skinnet.skin.gateway_placement import free_ports
from skinnet.skin.lattice import PORT_ANGLES_RAD, pitch_m
from skinnet.skin.placement import PlacedPatch, place_patch
from skinnet.skin.wire_graph import wire_components

__all__ = ["DIGITS_AXIS", "bridges_between", "component_patches", "patch_name", "rounded_vector"]

Floats = NDArray[np.float64]

_PORTS_OF_JOINED = 3
"""Least number of free ports of two groups that are joined: a bridge takes two, a gateway one."""
_SAME_SIDE_COSINE = -0.5
_MAX_NAME = 64
_DIGITS_M, _DIGITS_LENGTH = 6, 5
DIGITS_AXIS = 6
"""Digits of the axes of cells in a deployment."""


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
            position_m=rounded_vector(p, _DIGITS_M),
            normal=rounded_vector(z, DIGITS_AXIS),
            x_axis=rounded_vector(x, DIGITS_AXIS),
        )
        for p, x, z in zip(position_m, R_body_cell[:, :, 0], R_body_cell[:, :, 2], strict=True)
    ]
    if not poses:
        return []
    whole = place_patch(PatchSpec(name=patch_name(name), body=body, cells=tuple(poses)), cells)
    pieces = wire_components(len(poses), whole.wires)
    members = sorted((piece for piece in pieces if len(piece) >= min_component), key=len, reverse=True)
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
    """Bridges that join all patches of one link into one group, the shortest first (Kruskal, 1956).

    A bridge to the other side of the link counts one pitch more, as it leads round an edge. Each end takes a
    free port, and one stays free for a gateway; patches without free ports stay alone.

    Args:
        patches: Patches of the link.
        poses: Rotation and translation of each patch's body in one common frame.
        side_m: Side of the cells [m].
    """
    ends, ports_m, normals = _free_ports(patches, poses, 0.5 * pitch_m(side_m))
    if len(patches) < 2 or not ends:
        return []
    group = list(range(len(patches)))
    free = [sum(end[0] == number for end in ends) for number in group]
    bridges: list[BridgeSpec] = []
    taken: set[tuple[int, int, int]] = set()
    tree, reach_m = cKDTree(ports_m), 2.0 * pitch_m(side_m)
    extent_m = pinned_linalg.norm(np.ptp(ports_m, axis=0))
    while len(bridges) < len(patches) - 1 and reach_m < 2.0 * extent_m + 4.0 * pitch_m(side_m):
        pairs = tree.query_pairs(reach_m, output_type="ndarray")
        between = np.array(group)[np.array([end[0] for end in ends])]
        a, b = pairs[between[pairs[:, 0]] != between[pairs[:, 1]]].T
        length_m = np.linalg.norm(ports_m[a] - ports_m[b], axis=1)
        opposite = (normals[a] * normals[b]).sum(axis=1) <= _SAME_SIDE_COSINE
        cost = np.round(length_m + pitch_m(side_m) * opposite, _DIGITS_LENGTH)
        order = np.lexsort((b, a, cost))
        for one, other in ((ends[a[i]], ends[b[i]]) for i in order.tolist()):
            new, old = group[one[0]], group[other[0]]
            if new == old or one in taken or other in taken or free[new] + free[old] < _PORTS_OF_JOINED:
                continue
            taken |= {one, other}
            free[new] += free[old] - 2
            group = [new if number == old else number for number in group]
            bridges.append(BridgeSpec(a=_port_name(patches, one), b=_port_name(patches, other)))
        reach_m *= 2.0
    return bridges


def _free_ports(
    patches: Sequence[PlacedPatch], poses: Sequence[tuple[Floats, Floats]], apothem_m: float
) -> tuple[list[tuple[int, int, int]], Floats, Floats]:
    """Free ports (f) as patch, cell and port, their positions (f, 3) [m] and the normals (f, 3) there."""
    ends: list[tuple[int, int, int]] = []
    ports_m, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for number, (patch, (R, t)) in enumerate(zip(patches, poses, strict=True)):
        used = [(int(cell), int(port)) for cell, port in patch.interfaces]
        for cell, port in free_ports(patch.n_cells, patch.wires, used).tolist():
            x, y, z = patch.R_body_cell[cell].T
            angle = PORT_ANGLES_RAD[port]
            at_m = patch.position_m[cell] + apothem_m * (
                pinned_math.cos(angle) * x + pinned_math.sin(angle) * y
            )
            ends.append((number, cell, port))
            ports_m.append((t + (R * at_m).sum(axis=1))[None])
            normals.append((R * z).sum(axis=1)[None])
    return ends, np.concatenate(ports_m), np.concatenate(normals)


def _port_name(patches: Sequence[PlacedPatch], end: tuple[int, int, int]) -> str:
    return f"{patches[end[0]].name}/{end[1]}:{end[2]}"


def rounded_vector(vector: Floats, digits: int) -> tuple[float, float, float]:
    """Vector (3,) as a deployment gives it, rounded to so many digits, without a negative zero."""
    x, y, z = (round(float(value), digits) + 0.0 for value in vector)
    if not math.isfinite(x + y + z):
        raise AssertionError("a cell's pose is not finite")
    return x, y, z
