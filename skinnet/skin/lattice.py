"""Hexagonal lattice of HEX-o-SKIN cells.

A cell is a regular hexagon. Its local x axis points from the centre to an edge; edges lie at 0°, 60°, … 300°.
Four of the six edges carry ports [T11]; which four is not published. Here: 0°, 60°, 180° and 240°, so that
each port faces a port of the neighbour and equal cells tile without rotation.
"""

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["N_PORTS", "PORT_ANGLES_RAD", "lattice_cells", "lattice_plane_m", "pitch_m"]

N_PORTS = 4
PORT_ANGLES_RAD = (0.0, math.pi / 3, math.pi, 4 * math.pi / 3)


def pitch_m(side_m: float) -> float:
    """Return the lattice pitch [m], the distance of neighbouring centres: twice the hexagon's apothem."""
    return math.sqrt(3.0) * side_m


def lattice_cells(columns: int, rows: int) -> list[tuple[int, int]]:
    """Return the axial coordinates (q, r) of a block of cells, row by row, each shifted by half a cell."""
    return [(column - row // 2, row) for row in range(rows) for column in range(columns)]


def lattice_plane_m(cells: list[tuple[int, int]], side_m: float) -> NDArray[np.float64]:
    """Return centres (n, 2) [m] of `cells` in the lattice plane, with the centre of their extent at zero."""
    axial = np.array(cells, dtype=np.float64).reshape(-1, 2)
    pitch = pitch_m(side_m)
    plane = np.column_stack(
        [pitch * (axial[:, 0] + 0.5 * axial[:, 1]), pitch * math.sqrt(3.0) / 2 * axial[:, 1]]
    )
    centred: NDArray[np.float64] = plane - 0.5 * (plane.min(axis=0) + plane.max(axis=0))
    return centred
