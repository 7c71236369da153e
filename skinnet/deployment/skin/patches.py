"""Patch specs: HEX-o-SKIN cells on a body, placed by a lattice or one by one, and their interfaces."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import Name, Positive, Table, Vector3

__all__ = ["CellPoseSpec", "InterfaceSpec", "LatticeSpec", "PatchSpec"]


class LatticeSpec(Table, frozen=True, kw_only=True):
    """Hexagonal lattice of `rows` × `columns` cells on a plane or around a cylinder.

    `origin_m` is the centre of the lattice on the rigid surface, `normal` points outwards and `up` from row
    to row, all in the frame of the body. With `radius_m` the lattice lies on a cylinder whose axis is
    parallel to `up`, `radius_m` below the origin.
    """

    columns: Annotated[int, Meta(ge=1)]
    rows: Annotated[int, Meta(ge=1)]
    origin_m: Vector3
    normal: Vector3
    up: Vector3
    radius_m: Positive | None = None


class CellPoseSpec(Table, frozen=True, kw_only=True):
    """Pose of a single cell on the rigid surface, in the frame of the body.

    `x_axis` points from the centre to the edge of port 0.
    """

    position_m: Vector3
    normal: Vector3
    x_axis: Vector3


class InterfaceSpec(Table, frozen=True, kw_only=True):
    """Interface: a free port of a boundary cell that is wired to the computer."""

    cell: Annotated[int, Meta(ge=0)]
    port: Annotated[int, Meta(ge=0, le=3)]


class PatchSpec(Table, frozen=True, kw_only=True):
    """Patch of HEX-o-SKIN cells on one body, placed by a lattice or cell by cell."""

    name: Name
    body: str
    lattice: LatticeSpec | None = None
    cells: tuple[CellPoseSpec, ...] = ()
    interfaces: tuple[InterfaceSpec, ...] = ()
    """Ports of the gateways; at least one, here or in a patch that bridges connect."""

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cells) if self.lattice is None else self.lattice.columns * self.lattice.rows
