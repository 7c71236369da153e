"""Names of cells, of their ports, and of sets of cells, with their parsers."""

from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta

from skinnet.errors import DeploymentError
from skinnet.suggestions import known_names

__all__ = [
    "CellName",
    "CellPattern",
    "CellRange",
    "FaultTarget",
    "PortName",
    "match_cells",
    "parse_cell_range",
    "parse_port",
]

CellName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+/[0-9]+(?!\n)$")]
"""Cell: "patch/cell"."""
PortName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+/[0-9]+:[0-3](?!\n)$")]
"""Port of a cell: "patch/cell:port"."""
CellRange = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+(/[0-9]+(-[0-9]+)?)?(?!\n)$")]
"""Range of cells: all of "patch", one as in "patch/3", or several as in "patch/3-7", ends included."""
CellPattern = Annotated[str, Meta(pattern=r"^([A-Za-z0-9_\-]+|\*)/([0-9]+|\*)(?!\n)$")]
"""Pattern of cells: "patch/cell", where * matches any."""
FaultTarget = Annotated[
    str, Meta(pattern=r"^[A-Za-z0-9_\-*]+(/(?!0[0-9])[0-9*]+)?(:(?!0[0-9])[0-9*]+)?(?!\n)$")
]
"""Target of a fault: patch, process, "patch/cell", "patch/cell:port" or "patch:gateway"; * matches any."""


def parse_port(name: str) -> tuple[str, int, int]:
    """Split a `PortName` into patch, cell and port."""
    patch, _, place = name.partition("/")
    cell, _, port = place.partition(":")
    return patch, int(cell), int(port)


def parse_cell_range(key: str, name: str, cells_per_patch: Mapping[str, int]) -> tuple[str, range]:
    """Parse the cell range `name` into its patch and cells.

    Args:
        key: Deployment key of the name, for errors.
        name: A `CellRange` or `CellName`.
        cells_per_patch: Number of cells of every patch.

    Raises:
        DeploymentError: the patch or a cell does not exist.
    """
    patch, _, numbers = name.partition("/")
    if patch not in cells_per_patch:
        raise DeploymentError(f"{key} = {name!r}: unknown patch; {known_names(patch, cells_per_patch)}")
    if not numbers:
        return patch, range(cells_per_patch[patch])
    first, _, last = numbers.partition("-")
    cells = range(int(first), int(last or first) + 1)
    if not cells:
        raise DeploymentError(f"{key} = {name!r}: must ascend")
    if cells[-1] >= cells_per_patch[patch]:
        raise DeploymentError(f"{key} = {name!r}: {patch} has cells 0 to {cells_per_patch[patch] - 1}")
    return patch, cells


def match_cells(key: str, pattern: str, cells_per_patch: Mapping[str, int]) -> list[tuple[str, int]]:
    """List the cells (patch, cell) that match a `CellPattern`.

    Args:
        key: Deployment key of the pattern, for errors.
        pattern: A `CellPattern`.
        cells_per_patch: Number of cells of every patch.

    Raises:
        DeploymentError: no such patch, or no patch with such a cell.
    """
    patch, _, cell = pattern.partition("/")
    if patch != "*" and patch not in cells_per_patch:
        raise DeploymentError(f"{key}: {pattern!r}: unknown patch; {known_names(patch, cells_per_patch)}")
    patches = list(cells_per_patch) if patch == "*" else [patch]
    if cell == "*":
        return [(name, i) for name in patches for i in range(cells_per_patch[name])]
    found = [(name, int(cell)) for name in patches if int(cell) < cells_per_patch[name]]
    if not found:
        last = max(cells_per_patch[name] for name in patches) - 1
        raise DeploymentError(f"{key}: {pattern!r}: {patch} has cells 0 to {last}")
    return found
