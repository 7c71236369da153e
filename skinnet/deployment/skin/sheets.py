"""Tactile sheet specs: surfaces, sheets and their boards.

Values marked *assumed* have no published source; all others cite theirs.
"""

from typing import Annotated

from msgspec import Meta, field

from skinnet.deployment.types import Name, NonNegative, Positive, Table, Vector3, ns_of_ms

__all__ = [
    "MAX_SIDE",
    "BoardSpec",
    "PressureSpec",
    "RegionSpec",
    "SheetSpec",
    "SurfaceSpec",
]

MAX_SIDE = 8
"""Largest number of rows and of columns of a sheet [R11]."""


class SurfaceSpec(Table, frozen=True, kw_only=True):
    """Surface of a body that carries tactile sheets, with its own tactile coordinates ξ.

    `origin_m` is the point ξ = 0 on the rigid surface; `normal` points outwards and `up` along ξ2, all in the
    frame of the body. Without `radius_m` the surface is a plane. With it, the surface is flat over `flat_m`
    across `up`, half to each side of the origin, and then bends with the radius: a cylinder if `flat_m` is 0.
    """

    name: Name
    """Name of the surface."""
    body: str
    """Body of the model that has the surface."""
    origin_m: Vector3
    """Point ξ = 0, frame of the body."""
    normal: Vector3
    """Outward normal at the origin, of any length."""
    up: Vector3
    """Direction of ξ2, of any length."""
    radius_m: Positive | None = None
    """Radius of the bent parts; a plane unless given."""
    flat_m: NonNegative = 0.0
    """Width of the flat part across `up`."""


class SheetSpec(Table, frozen=True, kw_only=True):
    """Tactile sheet with its board: 8 × 8 elements at a pitch of 21.5 mm [R11], or fewer.

    `centre_xi_m` are the tactile coordinates of the centre of the grid. `mask` has one string per row, from
    the top, with `#` for an element and `.` for one that is cut away, as seen from outside with `up` upwards;
    without it the grid is full. With `connect_across_gaps`, elements on both sides of a gap of one cut row or
    column are neighbours, as if the teeth of the comb touched.
    """

    name: Name
    """Name of the sheet and of its board."""
    surface: Name
    """Surface that carries the sheet."""
    centre_xi_m: tuple[float, float] = (0.0, 0.0)
    """Tactile coordinates of the centre of the grid."""
    columns: Annotated[int, Meta(ge=1, le=MAX_SIDE)] = MAX_SIDE
    """Number of elements in a row."""
    rows: Annotated[int, Meta(ge=1, le=MAX_SIDE)] = MAX_SIDE
    """Number of rows."""
    pitch_m: Positive = 0.0215
    """Distance between the centres of neighbouring elements."""
    mask: tuple[str, ...] = ()
    """Rows of the grid from the top, `#` for an element, `.` for none."""
    connect_across_gaps: bool = True
    """Make elements on both sides of a gap of one row or column neighbours."""

    @property
    def n_elements(self) -> int:
        """Number of elements, for a valid mask."""
        return sum(row.count("#") for row in self.mask) if self.mask else self.columns * self.rows


class PressureSpec(Table, frozen=True, kw_only=True):
    """Pressure elements: 0 to above 90 kPa, more than 5 bit [R11].

    Eight bits, since in the feasibility study a grasp with 5 bits dropped its object and one with 8 held it.
    """

    range_kpa: Positive = 90.0
    """Highest reading."""
    bits: Annotated[int, Meta(ge=1, le=24)] = 8
    """Resolution of a reading."""
    noise_kpa: NonNegative = 0.1
    """Standard deviation of a reading *(assumed)*."""
    element_read_us: Positive = 50.0
    """Read time of one element *(assumed: 64 in 3.2 ms leave time to compute and send within 4 ms)*."""

    @property
    def lsb_kpa(self) -> float:
        """Resolution of a reading [kPa]."""
        return self.range_kpa / float((1 << self.bits) - 1)


class RegionSpec(Table, frozen=True, kw_only=True):
    """Contact regions: activation thresholds of elements, and tracking between scans *(assumed)*."""

    activation_kpa: Positive = 1.0
    """Pressure above which an element becomes active."""
    deactivation_kpa: Positive = 0.6
    """Pressure below which an active element becomes inactive."""
    association_distance_m: NonNegative = 0.032
    """Association distance between two scans without a common element; a row plus a column is 0.0304 m."""


class BoardSpec(Table, frozen=True, kw_only=True):
    """Board of a tactile sheet, with a scan period of 4 ms [R11]."""

    period_ms: Positive = 4.0
    """Scan period; equals `body.stimulus_period_ms`."""
    processing_delay_us: NonNegative = 200.0
    """Processing delay from the last reading of a scan to the sending of its message *(assumed)*."""
    pattern_interval_scans: Annotated[int, Meta(ge=0)] = 0
    """Interval of raw patterns, in scans; 0: only on request."""
    pressure: PressureSpec = field(default_factory=PressureSpec)
    """Pressure elements."""
    regions: RegionSpec = field(default_factory=RegionSpec)
    """Contact regions."""

    @property
    def period_ns(self) -> int:
        """Scan period [ns]."""
        return ns_of_ms(self.period_ms)
