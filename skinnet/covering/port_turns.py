"""Turns of cells by 60° that join most of them by wires: four of six edges have ports.

A turn moves no edge of a hexagon, but decides which edges have ports. Single cells, whole components, and
pairs of neighbours are turned while that leaves fewer components, or as many and more wires.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet import pinned_math
from skinnet.compilation import compiled_without_nrt
from skinnet.skin.lattice import N_PORTS, PORT_ANGLES_RAD

__all__ = ["best_turns", "turned"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_WIRE_FRACTION = 1.15
_FACING_COSINE = pinned_math.cos(math.radians(35.0))
_SAME_SIDE_COSINE = -0.5
"""As in `skinnet.skin.placement`, whose wires count in the end."""
_N_TURNS = 3
"""Turns that differ: ports lie opposite to ports."""
_SWEEPS = 8


class _Neighbours(NamedTuple):
    """Pairs (p) of cells that could be wired.

    Attributes:
        pair: (p, 2) cells.
        faces: (p, 2, 3) True where a cell has a port that faces the other one, for each of its turns.
        first: (n + 1,) first entry of each cell in `of_cell`.
        of_cell: Pairs of each cell.
    """

    pair: Indices
    faces: NDArray[np.bool_]
    first: Indices
    of_cell: Indices


def turned(R_body_cell: Floats, turns: Indices) -> Floats:
    """Turn the axes (n, 3, 3) of cells by `turns` (n,) × 60° about their normals."""
    cosine = np.array([1.0, 0.5, -0.5])[turns][:, None]
    sine = np.array([0.0, 0.5 * math.sqrt(3.0), 0.5 * math.sqrt(3.0)])[turns][:, None]
    x, y = R_body_cell[:, :, 0], R_body_cell[:, :, 1]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, R_body_cell[:, :, 2]], axis=2)


def best_turns(position_m: Floats, R_body_cell: Floats, pitch_m: float) -> tuple[Indices, int, int]:
    """Turns (n,) of cells in steps of 60°, and the components and wires that they leave, about.

    Args:
        position_m: (n, 3) centres of the cells [m].
        R_body_cell: (n, 3, 3) their axes.
        pitch_m: Distance of neighbours, that of the cell itself [m].
    """
    neighbours = _neighbours(position_m, R_body_cell, pitch_m)
    turns = np.zeros(len(position_m), dtype=np.int64)
    scratch = np.zeros((3, len(turns)), dtype=np.int64)
    components, wires = _search(neighbours, turns, *scratch)
    return turns, int(components), int(wires)


def _neighbours(position_m: Floats, R_body_cell: Floats, pitch_m: float) -> _Neighbours:
    n = len(position_m)
    pairs = np.array(sorted(cKDTree(position_m).query_pairs(_WIRE_FRACTION * pitch_m)), dtype=np.int64)
    pairs = pairs.reshape(-1, 2)
    a, b = pairs[:, 0], pairs[:, 1]
    same_side = (R_body_cell[a, :, 2] * R_body_cell[b, :, 2]).sum(axis=1) >= _SAME_SIDE_COSINE
    pairs = pairs[same_side]
    towards = position_m[pairs[:, 1]] - position_m[pairs[:, 0]]
    towards /= np.sqrt((towards * towards).sum(axis=1))[:, None]
    faces = np.zeros((len(pairs), 2, _N_TURNS), dtype=np.bool_)
    for turn in range(_N_TURNS):
        for end, sign in ((0, 1.0), (1, -1.0)):
            R = R_body_cell[pairs[:, end]]
            x, y = ((R[:, :, k] * towards).sum(axis=1) * sign for k in (0, 1))
            best = np.full(len(pairs), -1.0)
            for port in range(N_PORTS):
                angle = PORT_ANGLES_RAD[port] + turn * math.pi / 3
                best = np.maximum(best, pinned_math.cos(angle) * x + pinned_math.sin(angle) * y)
            faces[:, end, turn] = np.round(best, 9) > _FACING_COSINE
    owner = pairs.T.ravel()
    order = np.argsort(owner, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=n))]).astype(np.int64)
    of_cell = np.ascontiguousarray(order % max(len(pairs), 1)).astype(np.int64)
    return _Neighbours(np.ascontiguousarray(pairs), faces, first, of_cell)


@compiled_without_nrt
def _search(
    neighbours: _Neighbours, turns: Indices, root: Indices, labels: Indices, before: Indices
) -> tuple[int, int]:
    """Improve `turns` (n,) in place; the other arrays (n,) are work space."""
    n = len(turns)
    components, wires = _count(neighbours, turns, root)
    for _ in range(_SWEEPS):
        improved = False
        for cell in range(n):
            kept = turns[cell]
            own = _wires_of(neighbours, turns, cell)
            for step in range(1, _N_TURNS):
                turns[cell] = (kept + step) % _N_TURNS
                if _wires_of(neighbours, turns, cell) < own - 1:
                    continue
                trial = _count(neighbours, turns, root)
                if trial[0] < components or (trial[0] == components and trial[1] > wires):
                    components, wires = trial
                    kept, own, improved = turns[cell], _wires_of(neighbours, turns, cell), True
            turns[cell] = kept
        _count(neighbours, turns, root)
        _copy(labels, root)
        for label in range(n):
            if labels[label] != label:
                continue
            for step in range(1, _N_TURNS):
                _copy(before, turns)
                for cell in range(n):
                    if labels[cell] == label:
                        turns[cell] = (turns[cell] + step) % _N_TURNS
                trial = _count(neighbours, turns, root)
                if trial[0] < components or (trial[0] == components and trial[1] > wires):
                    components, wires = trial
                    improved = True
                else:
                    _copy(turns, before)
        _count(neighbours, turns, root)
        for p in range(len(neighbours.pair)):
            a, b = neighbours.pair[p, 0], neighbours.pair[p, 1]
            apart = root[a] != root[b]
            kept_a, kept_b = turns[a], turns[b]
            own = _wires_of(neighbours, turns, a) + _wires_of(neighbours, turns, b)
            for step in range(_N_TURNS * _N_TURNS):
                turns[a], turns[b] = step // _N_TURNS, step % _N_TURNS
                wired_now = _wires_of(neighbours, turns, a) + _wires_of(neighbours, turns, b)
                if not (apart and _is_wired(neighbours, turns, p)) and wired_now < own:
                    continue
                trial = _count(neighbours, turns, root)
                if trial[0] < components or (trial[0] == components and trial[1] > wires):
                    components, wires = trial
                    kept_a, kept_b, improved = turns[a], turns[b], True
                    own = wired_now
            turns[a], turns[b] = kept_a, kept_b
            _count(neighbours, turns, root)
        if not improved:
            break
    return components, wires


@compiled_without_nrt
def _copy(target: Indices, source: Indices) -> None:
    for i in range(len(source)):
        target[i] = source[i]


@compiled_without_nrt
def _is_wired(neighbours: _Neighbours, turns: Indices, p: int) -> bool:
    a, b = neighbours.pair[p, 0], neighbours.pair[p, 1]
    return bool(neighbours.faces[p, 0, turns[a]] and neighbours.faces[p, 1, turns[b]])


@compiled_without_nrt
def _wires_of(neighbours: _Neighbours, turns: Indices, cell: int) -> int:
    count = 0
    for entry in range(neighbours.first[cell], neighbours.first[cell + 1]):
        count += 1 if _is_wired(neighbours, turns, neighbours.of_cell[entry]) else 0
    return count


@compiled_without_nrt
def _count(neighbours: _Neighbours, turns: Indices, root: Indices) -> tuple[int, int]:
    """Components and wires; `root` (n,) becomes the lowest cell of each cell's component."""
    n, wires = len(turns), 0
    components = n
    for i in range(n):
        root[i] = i
    for p in range(len(neighbours.pair)):
        if not _is_wired(neighbours, turns, p):
            continue
        wires += 1
        a, b = _root(root, neighbours.pair[p, 0]), _root(root, neighbours.pair[p, 1])
        if a != b:
            components -= 1
            root[max(a, b)] = min(a, b)
    for i in range(n):
        root[i] = _root(root, i)
    return components, wires


@compiled_without_nrt
def _root(root: Indices, i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i
