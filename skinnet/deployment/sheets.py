"""Tactile sheets, their boards and the network of the boards, as a deployment describes them.

Values marked *assumed* have no published source; all others name theirs.
"""

from typing import Annotated, Literal

from msgspec import Meta, field

from skinnet.deployment.table import Name, NonNegative, Positive, Share, Table, Vector, ns_of_ms

__all__ = [
    "MAX_SIDE",
    "BoardNetworkSpec",
    "BoardSpec",
    "PressureSpec",
    "RegionSpec",
    "SheetSpec",
    "SurfaceSpec",
]

MAX_SIDE = 8
"""Rows and columns of the largest sheet [R11]."""


class SurfaceSpec(Table, frozen=True, kw_only=True):
    """A surface of a body on which tactile sheets lie, with tactile coordinates of its own.

    `origin_m` is where ξ is zero, on the rigid surface; `normal` points outwards and `up` along ξ2, all in
    the frame of the body. Without `radius_m` the surface is a plane. With it, it is flat over `flat_m`
    across `up`, half of that to each side of the origin, then bends with the radius: a cylinder if `flat_m`
    is 0.
    """

    name: Name
    body: str
    origin_m: Vector
    normal: Vector
    up: Vector
    radius_m: Positive | None = None
    flat_m: NonNegative = 0.0


class SheetSpec(Table, frozen=True, kw_only=True):
    """A tactile sheet with its board: 8 × 8 elements, 21.5 mm apart [R11], or a part of that.

    `middle_xi_m` are the tactile coordinates of the middle of the grid. `mask` has a text for each row, the
    first for the one farthest up, of `#` for an element and `.` for one that is cut away: it
    shows the sheet as one sees it from outside with `up` upwards. Without it the grid is full. With
    `joins_gaps`, elements on both sides of a gap of one cut row or column count as neighbours,
    as if the teeth of the comb touched.
    """

    name: Name
    surface: Name
    middle_xi_m: tuple[float, float] = (0.0, 0.0)
    columns: Annotated[int, Meta(ge=1, le=MAX_SIDE)] = MAX_SIDE
    rows: Annotated[int, Meta(ge=1, le=MAX_SIDE)] = MAX_SIDE
    pitch_m: Positive = 0.0215
    mask: tuple[str, ...] = ()
    joins_gaps: bool = True

    @property
    def n_elements(self) -> int:
        """Number of elements; right for a mask that holds."""
        return sum(row.count("#") for row in self.mask) if self.mask else self.columns * self.rows


class PressureSpec(Table, frozen=True, kw_only=True):
    """Pressure elements: 0 to above 90 kPa, more than 5 bit [R11].

    Eight bits, because in the feasibility study a grasp with 5 dropped its object and one with 8 held it.
    """

    range_kpa: Positive = 90.0
    bits: Annotated[int, Meta(ge=1, le=24)] = 8
    noise_kpa: NonNegative = 0.1
    """Standard deviation of a reading *(assumed)*."""
    element_us: Positive = 50.0
    """Time to read one element *(assumed: 64 in 3.2 ms leave time to compute and send within 4 ms)*."""

    @property
    def lsb_kpa(self) -> float:
        """One step of a reading [kPa]."""
        return self.range_kpa / (2.0**self.bits - 1.0)


class RegionSpec(Table, frozen=True, kw_only=True):
    """When an element is active, and how far a region may jump and still be the same *(assumed)*."""

    on_kpa: Positive = 1.0
    off_kpa: Positive = 0.6
    follow_m: NonNegative = 0.032
    """Between two frames, if no element remains in common; one row and one column are 0.0304 m apart."""


class BoardSpec(Table, frozen=True, kw_only=True):
    """The board of a tactile sheet: a period of 4 ms [R11]."""

    period_ms: Positive = 4.0
    compute_us: NonNegative = 200.0
    """From the last reading of a frame to the moment its message is sent *(assumed)*."""
    pattern_every: Annotated[int, Meta(ge=0)] = 0
    """Send the raw pattern every n frames; 0: only when asked to."""
    pressure: PressureSpec = field(default_factory=PressureSpec)
    regions: RegionSpec = field(default_factory=RegionSpec)

    @property
    def period_ns(self) -> int:
        """Period of frames [ns]."""
        return ns_of_ms(self.period_ms)


class BoardNetworkSpec(Table, frozen=True, kw_only=True):
    """The network of the boards to the main PC *(assumed; the paper has more than 20 boards on one [R11])*.

    `bus` is one medium that all boards and the PC share, such as CAN; who asks first sends first. `star`
    gives each board a wire of its own. In a `chain` each board passes on what comes from the boards behind
    it. The wires of star and chain are full-duplex. 14 bits a byte are the 111 bits of a CAN frame of 8
    bytes.
    """

    kind: Literal["bus", "star", "chain"] = "bus"
    bits_per_s: Annotated[int, Meta(gt=0)] = 1_000_000
    bits_per_byte: Annotated[int, Meta(gt=0, le=64)] = 14
    delay_us: NonNegative = 0.0
    """From the end of a transmission to the arrival, on each link."""
    jitter_us: NonNegative = 0.0
    loss: Share = 0.0
    """Chance that a link destroys a message."""
    queue_messages: Annotated[int, Meta(ge=-1)] = 32
    """How many messages may wait for a link; −1 for any number."""
    head_bytes: Annotated[int, Meta(gt=0)] = 8
    """Of any message: board, kind, frame number, count."""
    region_bytes: Annotated[int, Meta(gt=0)] = 12
    """Of a region: number, kin, force, ξ1, ξ2 of two bytes each, peak, elements of one."""
