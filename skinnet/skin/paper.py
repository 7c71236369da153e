"""The whole skin on one sheet of paper: patches unrolled, tactile sheets as grids, in rows from the top."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.skin.placement import PlacedPatch
from skinnet.skin.sheet import PlacedSheet
from skinnet.skin.unroll import unroll

__all__ = ["Box", "Paper", "lay_out"]

Floats = NDArray[np.float64]

_MARGIN = 0.8
"""Around a patch, in pitches of its cells."""
_LABEL = 1.7
"""Below it, for its name."""
_NARROWEST = 5.6
"""Least width of its box."""


@dataclass(frozen=True)
class Box:
    """Room for a patch and its name: lower left corner, width and height in pitches; y is up."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Paper:
    """Where everything lies, in pitches.

    Attributes:
        at: (n, 2) centres, first those of all cells, then those of all elements; x to the right, y up to 0.
        turn: (n,) angle of port 0 of a cell [rad]; 0 for an element.
        boxes: One for each patch, then for each sheet.
        width: Of the paper.
        height: Of the paper; its lower edge lies at −height.
    """

    at: Floats
    turn: Floats
    boxes: tuple[Box, ...]
    width: float
    height: float


def lay_out(
    patches: Iterable[PlacedPatch], sheets: Iterable[PlacedSheet] = (), aspect: float = 1.75
) -> Paper:
    """Patches and sheets in their order on shelves, about `aspect` times as wide as high."""
    pieces = [unroll(patch) for patch in patches]
    pieces += [(_grid(sheet), np.zeros(sheet.n_elements)) for sheet in sheets]
    rooms = [
        (max(w + 1.0 + 2 * _MARGIN, _NARROWEST), h + 1.16 + 2 * _MARGIN + _LABEL)
        for w, h in (np.ptp(at, axis=0).tolist() for at, _ in pieces)
    ]
    area = sum(w * h for w, h in rooms)
    widths = [math.sqrt(area * aspect) * stretch for stretch in np.linspace(0.8, 1.5, 36)]
    tries = [_shelves(rooms, max(width, max(w for w, _ in rooms))) for width in widths]
    spots, width, height = min(tries, key=lambda t: abs(math.log(t[1] / t[2] / aspect)) + t[1] * t[2] / area)
    boxes = tuple(Box(*spot, *room) for spot, room in zip(spots, rooms, strict=True))
    at = [
        piece + np.array([box.x + box.width / 2, box.y + box.height / 2 + _LABEL / 2])
        for (piece, _), box in zip(pieces, boxes, strict=True)
    ]
    return Paper(np.vstack(at), np.concatenate([turn for _, turn in pieces]), boxes, width, height)


def _grid(sheet: PlacedSheet) -> Floats:
    """Centres (n, 2) of the elements in pitches, as one sees them from outside with `up` upwards."""
    at = np.column_stack([sheet.grid[:, 1], -sheet.grid[:, 0]]).astype(np.float64)
    centred: Floats = at - 0.5 * (at.min(axis=0) + at.max(axis=0))
    return centred


def _shelves(
    rooms: Sequence[tuple[float, float]], width: float
) -> tuple[list[tuple[float, float]], float, float]:
    """Lower left corners of boxes in rows from the top, the rows' common width, and the height of all."""
    rows: list[list[int]] = [[]]
    for index, (w, _) in enumerate(rooms):
        if rows[-1] and sum(rooms[i][0] for i in rows[-1]) + w > width + 1e-9:
            rows.append([])
        rows[-1].append(index)
    spots = [(0.0, 0.0)] * len(rooms)
    widest = max(sum(rooms[i][0] for i in row) for row in rows)
    y = 0.0
    for row in rows:
        tall = max(rooms[i][1] for i in row)
        y -= tall
        gap = (widest - sum(rooms[i][0] for i in row)) / len(row)
        x = gap / 2
        for i in row:
            spots[i] = (x, y)
            x += rooms[i][0] + gap
    return spots, widest, -y
