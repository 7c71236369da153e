"""Unrolled patch: planar hexagon positions of cells on a curved body."""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from skinnet.skin.lattice import PORT_ANGLES_RAD
from skinnet.skin.placement import PlacedPatch

__all__ = ["unroll_patch"]

_OVERLAP_FRACTION = 0.9
_COMPONENT_GAP = 1.5


def unroll_patch(patch: PlacedPatch) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unroll a patch: cell centres (n, 2) in pitches, seen from outside, and angles (n,) of port 0 [rad].

    A wire joins the midpoints of two edges, so the planar position of a cell follows from its neighbour's,
    whatever the curvature; a ring is cut open where its ends meet. Connected components lie side by side. If
    cells then overlap (a cone, a sphere), all are projected on the best-fitting plane instead.
    """
    n = patch.n_cells
    at, turn = np.full((n, 2), math.nan), np.zeros(n)
    neighbours: list[list[tuple[int, int, int]]] = [[] for _ in range(n)]
    for a, port_a, b, port_b in patch.wires.tolist():
        neighbours[a].append((port_a, b, port_b))
        neighbours[b].append((port_b, a, port_a))
    right = 0.0
    for first in range(n):
        if math.isnan(at[first, 0]):
            piece = _unroll_component(first, neighbours, at, turn)
            at[piece] += [right - at[piece, 0].min(), -at[piece, 1].mean()]
            right = float(at[piece, 0].max()) + _COMPONENT_GAP
    if _overlaps(at):
        return _project_patch(patch)
    return at - 0.5 * (at.min(axis=0) + at.max(axis=0)), turn


def _unroll_component(
    first: int,
    neighbours: list[list[tuple[int, int, int]]],
    position: NDArray[np.float64],
    angle_rad: NDArray[np.float64],
) -> list[int]:
    position[first] = 0.0
    piece, waiting = [first], deque([first])
    while waiting:
        cell = waiting.popleft()
        for port, other, its_port in sorted(neighbours[cell]):
            if not math.isnan(position[other, 0]):
                continue
            angle = angle_rad[cell] + PORT_ANGLES_RAD[port]
            position[other] = position[cell] + [math.cos(angle), math.sin(angle)]
            angle_rad[other] = angle + math.pi - PORT_ANGLES_RAD[its_port]
            piece.append(other)
            waiting.append(other)
    return piece


def _overlaps(position: NDArray[np.float64]) -> bool:
    gaps = np.linalg.norm(position[:, None] - position[None], axis=2)
    return bool((gaps[np.triu_indices(len(position), 1)] < _OVERLAP_FRACTION).any())


def _project_patch(patch: PlacedPatch) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project centres on the plane of the first two principal axes, in smallest distances of cells."""
    centred = patch.position_m - patch.position_m.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2][:2]
    outwards = patch.R_body_cell[:, :, 2].mean(axis=0)
    if np.cross(axes[0], axes[1]) @ outwards < 0.0:
        axes[1] *= -1.0
    gaps = np.linalg.norm(patch.position_m[:, None] - patch.position_m[None], axis=2)
    pitch_m = gaps[np.triu_indices(patch.n_cells, 1)].min()
    towards = patch.R_body_cell[:, :, 0] @ axes.T
    return centred @ axes.T / pitch_m, np.arctan2(towards[:, 1], towards[:, 0])
