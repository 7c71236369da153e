"""Flattened layout of the whole skin: unrolled patches and tactile sheets packed in rows."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.skin.placement import PlacedPatch
from skinnet.skin.tactile_sheets import PlacedSheet
from skinnet.skin.unrolled_patch import unroll_patch

__all__ = ["Box", "FlattenedSkin", "flatten_skin"]

Floats = NDArray[np.float64]

_MARGIN = 0.8
"""Margin around a patch, in pitches of its cells."""
_LABEL_HEIGHT = 1.7
"""Label height below a patch, in pitches."""
_MIN_BOX_WIDTH = 5.6
"""Least width of a patch's box, in pitches."""


@dataclass(frozen=True)
class Box:
    """Bounding box of a patch and its label: lower left corner, width and height in pitches; y is up."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class FlattenedSkin:
    """Flattened skin: planar positions of all cells and elements, in pitches.

    Attributes:
        position: (n, 2) centres of all cells, then of all elements; x to the right, y up, from −height to 0.
        angle_rad: (n,) angle of port 0 of a cell [rad]; 0 for an element.
        boxes: Bounding boxes, one per patch, then one per sheet.
        width: Width of the layout.
        height: Height of the layout; its lower edge is at −height.
    """

    position: Floats
    angle_rad: Floats
    boxes: tuple[Box, ...]
    width: float
    height: float


def flatten_skin(
    patches: Iterable[PlacedPatch], sheets: Iterable[PlacedSheet] = (), aspect_ratio: float = 1.75
) -> FlattenedSkin:
    """Pack patches and sheets in order into rows, about `aspect_ratio` times as wide as high."""
    pieces = [unroll_patch(patch) for patch in patches]
    pieces += [(_element_positions(sheet), np.zeros(sheet.n_elements)) for sheet in sheets]
    rooms = [
        (max(w + 1.0 + 2 * _MARGIN, _MIN_BOX_WIDTH), h + 1.16 + 2 * _MARGIN + _LABEL_HEIGHT)
        for w, h in (np.ptp(at, axis=0).tolist() for at, _ in pieces)
    ]
    area = sum(w * h for w, h in rooms)
    widths = [math.sqrt(area * aspect_ratio) * stretch for stretch in np.linspace(0.8, 1.5, 36)]
    tries = [_pack_shelves(rooms, max(width, max(w for w, _ in rooms))) for width in widths]
    spots, width, height = min(
        tries, key=lambda t: abs(math.log(t[1] / t[2] / aspect_ratio)) + t[1] * t[2] / area
    )
    boxes = tuple(Box(*spot, *room) for spot, room in zip(spots, rooms, strict=True))
    at = [
        piece + np.array([box.x + box.width / 2, box.y + box.height / 2 + _LABEL_HEIGHT / 2])
        for (piece, _), box in zip(pieces, boxes, strict=True)
    ]
    return FlattenedSkin(np.vstack(at), np.concatenate([turn for _, turn in pieces]), boxes, width, height)


def _element_positions(sheet: PlacedSheet) -> Floats:
    """Return element centres (n, 2) in pitches, seen from outside with `up` upwards."""
    at = np.column_stack([sheet.grid[:, 1], -sheet.grid[:, 0]]).astype(np.float64)
    centred: Floats = at - 0.5 * (at.min(axis=0) + at.max(axis=0))
    return centred


def _pack_shelves(
    sizes: Sequence[tuple[float, float]], width: float
) -> tuple[list[tuple[float, float]], float, float]:
    """Pack boxes into rows (shelf packing); return lower left corners, common width and total height."""
    rows: list[list[int]] = [[]]
    for index, (w, _) in enumerate(sizes):
        if rows[-1] and sum(sizes[i][0] for i in rows[-1]) + w > width + 1e-9:
            rows.append([])
        rows[-1].append(index)
    spots = [(0.0, 0.0)] * len(sizes)
    widest = max(sum(sizes[i][0] for i in row) for row in rows)
    y = 0.0
    for row in rows:
        tall = max(sizes[i][1] for i in row)
        y -= tall
        gap = (widest - sum(sizes[i][0] for i in row)) / len(row)
        x = gap / 2
        for i in row:
            spots[i] = (x, y)
            x += sizes[i][0] + gap
    return spots, widest, -y
