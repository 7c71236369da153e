"""Patch specs: HEX-o-SKIN cells on a body, placed by a lattice or one by one, and their interfaces."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import Name, Positive, Table, Vector3

__all__ = ["CellPoseSpec", "InterfaceSpec", "LatticeSpec", "PatchSpec"]

_MAX_CELLS = 20_000
"""Greatest number of cells in a patch: twice the largest skin that the simulator is designed for."""


class LatticeSpec(Table, frozen=True, kw_only=True):
    """Hexagonal lattice of `rows` × `columns` cells on a plane or around a cylinder.

    `origin_m` is the centre of the lattice on the rigid surface, `normal` points outwards and `up` from row
    to row, all in the frame of the body. With `radius_m` the lattice lies on a cylinder whose axis is
    parallel to `up`, `radius_m` below the origin.
    """

    columns: Annotated[int, Meta(ge=1)]
    """Number of cells in a row."""
    rows: Annotated[int, Meta(ge=1)]
    """Number of rows."""
    origin_m: Vector3
    """Centre of the lattice on the rigid surface, frame of the body."""
    normal: Vector3
    """Outward normal at the origin, of any length."""
    up: Vector3
    """Direction in which rows stack, of any length."""
    radius_m: Positive | None = None
    """Radius of the cylinder; a plane unless given."""

    def __post_init__(self) -> None:
        n_cells = self.columns * self.rows
        if n_cells > _MAX_CELLS:
            raise ValueError(
                f"columns × rows = {self.columns} × {self.rows}: a patch has at most {_MAX_CELLS} cells"
            )


class CellPoseSpec(Table, frozen=True, kw_only=True):
    """Pose of a single cell on the rigid surface, in the frame of the body.

    `x_axis` points from the centre to the edge of port 0.
    """

    position_m: Vector3
    """Centre of the cell on the rigid surface, frame of the body."""
    normal: Vector3
    """Outward normal, of any length."""
    x_axis: Vector3
    """Direction of port 0, of any length."""


class InterfaceSpec(Table, frozen=True, kw_only=True):
    """Interface: a free port of a boundary cell that is wired to the computer."""

    cell: Annotated[int, Meta(ge=0)]
    """Number of the cell in its patch."""
    port: Annotated[int, Meta(ge=0, le=3)]
    """Free port of the cell."""


class PatchSpec(Table, frozen=True, kw_only=True):
    """Patch of HEX-o-SKIN cells on one body, placed by a lattice or cell by cell."""

    name: Name
    """Name of the patch, unique in the robot."""
    body: str
    """Body of the model that carries the patch."""
    lattice: LatticeSpec | None = None
    """Lattice of the cells; instead of `cells`."""
    cells: tuple[CellPoseSpec, ...] = ()
    """Pose of each cell; instead of `lattice`."""
    interfaces: tuple[InterfaceSpec, ...] = ()
    """Ports of the gateways; at least one, here or in a patch that bridges connect."""

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cells) if self.lattice is None else self.lattice.columns * self.lattice.rows
