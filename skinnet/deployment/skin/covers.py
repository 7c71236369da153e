"""Cover specs: which surface of which links is covered with HEX-o-SKIN cells or tactile sheets."""

from typing import Annotated, Literal

from msgspec import Meta

from skinnet.deployment.types import Name, NonNegative, Positive, Table, Vector3

__all__ = ["BoxRegionSpec", "CoverRegionSpec", "CoverSpec", "HalfSpaceSpec", "IntervalSpec"]


class HalfSpaceSpec(Table, frozen=True, kw_only=True):
    """Half-space: points x of the body's frame with normal · x ≥ `offset_m`."""

    normal: Vector3
    """Direction into the half-space, of any length."""
    offset_m: float = 0.0
    """Distance of its border from the origin of the body, along the normal."""

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ValueError("normal = [0, 0, 0]: must have a length above zero")


class BoxRegionSpec(Table, frozen=True, kw_only=True):
    """Box with sides parallel to the axes of the body's frame."""

    min_m: Vector3
    """Lowest coordinates."""
    max_m: Vector3
    """Highest coordinates."""

    def __post_init__(self) -> None:
        if not all(low < high for low, high in zip(self.min_m, self.max_m, strict=True)):
            raise ValueError(
                f"min_m = {list(self.min_m)}: each must be below that of max_m = {list(self.max_m)}"
            )


class IntervalSpec(Table, frozen=True, kw_only=True):
    """Interval along an axis through the origin of the body's frame."""

    axis: Literal["x", "y", "z"] | Vector3
    """Axis of the body's frame, or a direction in it."""
    min_m: float
    """Lower end."""
    max_m: float
    """Upper end."""

    def __post_init__(self) -> None:
        if not isinstance(self.axis, str) and not any(self.axis):
            raise ValueError("axis = [0, 0, 0]: must have a length above zero")
        if not self.min_m < self.max_m:
            raise ValueError(f"min_m = {self.min_m:g}: must be below max_m = {self.max_m:g}")


class CoverRegionSpec(Table, frozen=True, kw_only=True):
    """Region of a link's surface, frame of the body: what lies in all the parts that are given."""

    half_space: HalfSpaceSpec | None = None
    """Half-space."""
    box: BoxRegionSpec | None = None
    """Box."""
    interval: IntervalSpec | None = None
    """Interval along an axis."""
    geoms: tuple[str, ...] = ()
    """Geoms by name; all of the link unless given."""

    def __post_init__(self) -> None:
        if self.half_space is None and self.box is None and self.interval is None and not self.geoms:
            raise ValueError("an empty table: give half_space, box, interval or geoms, or leave region out")


class CoverSpec(Table, frozen=True, kw_only=True):
    """Cover: cells over the felt surface of links, placed and wired before a run; it becomes patches.

    A link is a body with all that is welded to it. Felt are primitives and convex hulls of meshes, as MuJoCo
    collides them. Bridges join the cells of a link into one network, which gets as few gateways as keep the
    limits of `[plan]`; one that needs more than the 16 ports of a gateway is cut into several.
    """

    name: Name
    """Name of the cover, with which those of its patches begin."""
    body: str | Annotated[tuple[str, ...], Meta(min_length=1)]
    """Body, list of bodies, or a pattern with * and ? of their names; those of a list must all take cells."""
    kind: Literal["cells", "sheet"] = "cells"
    """Kind of skin: `cells`, or tactile sheets of 8 × 8 elements, flat or bent round a cylinder, as many as
    find a place on the felt surface, with all elements within 4 mm of it *(assumed)*."""
    pitch_m: Positive | None = None
    """Distance of neighbouring cells; that of the cell itself, √3 × `cells.side_m`, unless given. Of sheets,
    that of their elements; 21.5 mm unless given [R11]."""
    layout: str | None = None
    """Measured layout instead of a covering: a CSV file, relative to the deployment, with a header and a line
    for each cell: its centre `x_m`, `y_m`, `z_m` and outward normal `nx`, `ny`, `nz`, frame of the body, and,
    if known, the direction `ux`, `uy`, `uz` of port 0. With `kind = "sheet"` the lines are elements, which
    have `sheet`, `row` from the top and `column` instead of that direction; each sheet is flat or bent about
    its columns, with elements within a fifth of the pitch of their places *(assumed)*."""
    region: CoverRegionSpec | None = None
    """Part of the surface; all of it unless given."""
    margin_m: NonNegative | None = None
    """Least distance of cells from creases of the surface above 45° and from the edge of the region; unless
    given, cells may lie across creases, and only their centres need be in the region."""
    clearance: bool = True
    """Leave out surface that another link reaches across one joint, anywhere in its range, or beside it at
    home."""
    max_cells: Annotated[int, Meta(ge=1)] | None = None
    """Greatest number of cells on each link."""
    min_component: Annotated[int, Meta(ge=1)] = 1
    """Least number of wired cells; smaller components are left out."""

    @property
    def is_pattern(self) -> bool:
        """True if `body` is a pattern of names."""
        return isinstance(self.body, str) and any(sign in self.body for sign in "*?")

    def __post_init__(self) -> None:
        if self.kind == "sheet":
            for key in ("margin_m", "max_cells"):
                if getattr(self, key) is not None:
                    raise ValueError(f'{key}: not with kind = "sheet"; leave it out, or give kind = "cells"')
        if self.layout is None:
            return
        if not isinstance(self.body, str) or self.is_pattern:
            raise ValueError(f"layout = {self.layout!r}: lies on one body; give its name as body")
        for key in ("pitch_m", "region", "margin_m", "max_cells"):
            if getattr(self, key) is not None:
                raise ValueError(f"{key}: not with layout, which tells where every cell is; leave one out")
