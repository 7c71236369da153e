"""Measured layouts of skins that exist: positions and normals of cells or elements from a CSV file."""

import csv
import math
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skinnet.covering.port_turns import best_turns, turned
from skinnet.deployment.skin.sheets import MAX_SIDE
from skinnet.errors import DeploymentError
from skinnet.pinned_linalg import norm
from skinnet.skin.lattice import pitch_m

__all__ = ["LAYOUT_COLUMNS", "Layout", "cells_of_layout", "read_layout"]

Floats = NDArray[np.float64]

LAYOUT_COLUMNS = ("x_m", "y_m", "z_m", "nx", "ny", "nz")
"""Columns that a layout must have: position [m] and outward normal of each cell, frame of the body."""
_AXIS_COLUMNS = ("ux", "uy", "uz")
"""Columns that one of cells may have: direction of port 0."""
_GRID_COLUMNS = ("sheet", "row", "column")
"""Columns that one of tactile sheets must have: name of the sheet, and place of the element in it."""
_OVERLAP_FRACTION = 0.9
_BACK_TO_BACK_COSINE = -0.985
_MIN_LENGTH = 1e-9


class Layout(msgspec.Struct, frozen=True, kw_only=True):
    """Layout of cells, or of the elements of tactile sheets, as its file gives it.

    Attributes:
        name: Name of the file, for messages, with that of its cover.
        line: Line of each cell in the file.
        position_m: Centre of each cell, frame of the body [m].
        normal: Outward normal of each, of any length.
        x_axis: Direction of port 0 of each; empty if the file has none.
        sheet: Sheet of each element; empty for cells.
        grid: Row, from the top, and column of each element in its sheet, from 0; empty for cells.
    """

    name: str
    line: tuple[int, ...]
    position_m: tuple[tuple[float, ...], ...]
    normal: tuple[tuple[float, ...], ...]
    x_axis: tuple[tuple[float, ...], ...] = ()
    sheet: tuple[str, ...] = ()
    grid: tuple[tuple[int, int], ...] = ()


def read_layout(path: Path, cover: str, *, of_sheets: bool = False) -> Layout:
    """Read the layout of a cover from a CSV file with a header: of cells, or of the elements of sheets.

    Raises:
        DeploymentError: the file cannot be read, or names line, column and what is allowed there.
    """
    name = f'cover.{cover}.layout = "{path.name}"'
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            columns = [column.strip() for column in rows.fieldnames or ()]
            rows.fieldnames = columns
            _check_columns(name, columns, *((_GRID_COLUMNS, ()) if of_sheets else ((), _AXIS_COLUMNS)))
            groups = [LAYOUT_COLUMNS[:3], LAYOUT_COLUMNS[3:]]
            groups += [_AXIS_COLUMNS] if _AXIS_COLUMNS[0] in columns else []
            lines, read, places = [], [], []
            for row in rows:
                lines.append(rows.line_num)
                read.append([_vector(name, rows.line_num, row, group) for group in groups])
                if of_sheets:
                    places.append(_place(name, rows.line_num, row))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise DeploymentError(
            f"{name}: cannot read {path}: {reason}; give a CSV file, relative to the deployment"
        ) from None
    if not read:
        raise DeploymentError(f"{name}: has no cell; give one line for each under the header")
    position_m, normal, *axis = (tuple(vectors) for vectors in zip(*read, strict=True))
    return Layout(
        name=name,
        line=tuple(lines),
        position_m=position_m,
        normal=normal,
        x_axis=axis[0] if axis else (),
        sheet=tuple(sheet for sheet, *_ in places),
        grid=tuple((row, column) for _, row, column in places),
    )


def cells_of_layout(layout: Layout, side_m: float) -> tuple[Floats, Floats]:
    """Positions (n, 3) [m] and rotations (n, 3, 3) of the cells of a layout, frame of its body.

    Where the file has no direction of port 0, an edge faces the nearest cell, and ports are turned so that
    few components remain.

    Raises:
        DeploymentError: cells overlap, or a direction of port 0 is along the normal; names the lines.
    """
    position_m = np.array(layout.position_m)
    normal = np.array(layout.normal)
    normal /= np.sqrt((normal * normal).sum(axis=1))[:, None]
    _require_room(layout, position_m, normal, side_m)
    x_axis = np.array(layout.x_axis) if layout.x_axis else _towards_nearest(position_m)
    x_axis = x_axis - normal * (x_axis * normal).sum(axis=1)[:, None]
    length = np.sqrt((x_axis * x_axis).sum(axis=1))
    flat = np.flatnonzero(length < _MIN_LENGTH)
    if len(flat) and layout.x_axis:
        raise DeploymentError(
            f"{layout.name}: line {layout.line[flat[0]]}, columns ux, uy, uz: along the normal; give a "
            "direction across it"
        )
    x_axis[flat] = np.cross(normal[flat], np.eye(3)[np.argmin(np.abs(normal[flat]), axis=1)])
    x_axis /= np.sqrt((x_axis * x_axis).sum(axis=1))[:, None]
    R = np.stack([x_axis, np.cross(normal, x_axis), normal], axis=2)
    if layout.x_axis:
        return position_m, R
    turns, _, _ = best_turns(position_m, R, pitch_m(side_m))
    return position_m, turned(R, turns)


def _check_columns(name: str, columns: list[str], needed: tuple[str, ...], optional: tuple[str, ...]) -> None:
    """Require the columns of all layouts and those `needed` here; those `optional` come together."""
    needed = needed + LAYOUT_COLUMNS
    allowed = f"give {', '.join(needed)}"
    if optional:
        allowed += f", and {', '.join(optional)} for the direction of port 0"
    missing = [column for column in needed if column not in columns]
    if missing:
        raise DeploymentError(f"{name}: line 1: no column {missing[0]}; {allowed}")
    some = [column for column in optional if column in columns]
    if 0 < len(some) < len(optional):
        raise DeploymentError(f"{name}: line 1: {some[0]} without the others; {allowed}")
    unknown = [column for column in columns if column not in needed + optional]
    twice = [column for column in columns if columns.count(column) > 1]
    if unknown or twice:
        kind = "unknown column" if unknown else "twice the column"
        raise DeploymentError(f"{name}: line 1: {kind} {(unknown or twice)[0]!r}; {allowed}")


def _place(name: str, line: int, row: dict[str, str]) -> tuple[str, int, int]:
    """Sheet, row and column of an element."""
    sheet = (row["sheet"] or "").strip()
    if not sheet:
        raise DeploymentError(f"{name}: line {line}, column sheet: nothing; give the name of the sheet")
    places = []
    for column in _GRID_COLUMNS[1:]:
        text = (row[column] or "").strip()
        if not (text.isdecimal() and int(text) < MAX_SIDE):
            raise DeploymentError(
                f"{name}: line {line}, column {column}: {text or 'nothing'!r} is no whole number from 0 to "
                f"{MAX_SIDE - 1}; a sheet has at most {MAX_SIDE} × {MAX_SIDE} elements"
            )
        places.append(int(text))
    return sheet, places[0], places[1]


def _vector(name: str, line: int, row: dict[str, str], columns: tuple[str, ...]) -> tuple[float, ...]:
    values = []
    for column in columns:
        text = row[column]
        try:
            value = float(text)
        except (TypeError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            raise DeploymentError(
                f"{name}: line {line}, column {column}: {text or 'nothing'!r} is no finite number"
                + ("; lengths are in m" if column.endswith("_m") else "")
            )
        values.append(value)
    if not columns[0].endswith("_m") and math.sqrt(sum(value * value for value in values)) < _MIN_LENGTH:
        raise DeploymentError(
            f"{name}: line {line}, columns {', '.join(columns)}: all zero; give a direction of any length"
        )
    return tuple(values)


def _require_room(layout: Layout, position_m: Floats, normal: Floats, side_m: float) -> None:
    pitch = pitch_m(side_m)
    for a, b in sorted(cKDTree(position_m).query_pairs(_OVERLAP_FRACTION * pitch)):
        if float((normal[a] * normal[b]).sum()) > _BACK_TO_BACK_COSINE:
            off_m = norm(position_m[a] - position_m[b])
            raise DeploymentError(
                f"{layout.name}: lines {layout.line[a]} and {layout.line[b]} are {1e3 * off_m:.1f} mm apart; "
                f"cells of side {1e3 * side_m:g} mm need {1e3 * _OVERLAP_FRACTION * pitch:.1f} mm "
                "(cells.side_m)"
            )


def _towards_nearest(position_m: Floats) -> Floats:
    if len(position_m) == 1:
        return np.array([[1.0, 0.0, 0.0]])
    nearest = np.asarray(cKDTree(position_m).query(position_m, 2)[1])[:, 1]
    towards: Floats = position_m[nearest] - position_m
    return towards
