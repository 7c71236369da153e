"""HEX-o-SKIN cell specs: sampling, geometry, sensors and event encoding.

Values marked *assumed* have no published source; all others cite theirs.
"""

from typing import Annotated

from msgspec import Meta, field

from skinnet.deployment.types import Encoding, LevelThresholds, NonNegative, Positive, Table, ns_of_ms

__all__ = ["AccelerometerSpec", "CellSpec", "EncodingSpec", "ForceSpec", "ProximitySpec", "TemperatureSpec"]


HalfAngle = Annotated[float, Meta(gt=0.0, le=85.0)]


class ForceSpec(Table, frozen=True, kw_only=True):
    """Force cells: reading 0.05 ≈ 0.6 N and 0.14 ≈ 1.0 N [M14]; the ends of the curve are assumed."""

    calibration_n: tuple[float, ...] = (0.0, 0.6, 1.0, 4.822)
    """Forces of the calibration points, ascending."""
    calibration_reading: tuple[float, ...] = (0.0, 0.05, 0.14, 1.0)
    """Readings at `calibration_n`; linear in between."""
    noise: NonNegative = 0.004
    """Standard deviation of a reading: idle noise 0.003–0.005 (field report, docs/assumptions.md)."""
    lsb: Positive = 0.0009765625
    """Resolution of a reading (least significant bit): 10 bits."""
    levels: LevelThresholds = (0.04, 0.10, 0.30, 0.45)
    """Low, medium, high and pain force: Table I [M14]."""
    hysteresis: NonNegative = 0.028
    """Hysteresis of level crossing: seven times the noise, less than one false event in 15 s at rest."""
    delta: Positive = 0.02
    """Threshold of send-on-delta."""


class ProximitySpec(Table, frozen=True, kw_only=True):
    """Proximity sensor, range about 5 cm [M14]; reading = (d0 / (d0 + distance))² *(assumed law)*."""

    range_m: Positive = 0.05
    """Range d of the sensor, at which the reading is `reading_at_range`."""
    reading_at_range: Positive = 0.01
    """Reading at `range_m`, which defines d0."""
    half_angle_deg: HalfAngle = 35.0
    """Half angle of the field of view, a cone about the cell's normal: the nearest point in it counts
    *(assumed)*."""
    noise: NonNegative = 0.0008
    """Standard deviation of a reading."""
    lsb: Positive = 0.0009765625
    """Resolution of a reading (least significant bit): 10 bits."""
    levels: LevelThresholds = (0.01, 0.02, 0.10, 0.80)
    """High, medium, low proximity and close contact: Table I [M14]."""
    hysteresis: NonNegative = 0.0056
    """Hysteresis of level crossing: seven times the noise."""
    delta: Positive = 0.02
    """Threshold of send-on-delta."""


class AccelerometerSpec(Table, frozen=True, kw_only=True):
    """Tri-axial accelerometer: ±8 g, 4 mg per LSB [T11]."""

    range_g: Positive = 8.0
    """Range, in both directions of each axis."""
    lsb_g: Positive = 0.004
    """Resolution of a reading (least significant bit)."""
    noise_g: NonNegative = 0.004
    """Standard deviation of a reading."""
    delta_g: Positive = 0.1
    """Threshold of send-on-delta."""


class TemperatureSpec(Table, frozen=True, kw_only=True):
    """Temperature sensor: 0.06 °C, −5…55 °C, time constant 2.6 s [T11]."""

    lsb_c: Positive = 0.06
    """Resolution of a reading (least significant bit)."""
    min_c: float = -5.0
    """Lowest reading."""
    max_c: float = 55.0
    """Highest reading."""
    time_constant_s: Positive = 2.6
    """Time constant of the first-order lag."""
    noise_c: NonNegative = 0.03
    """Standard deviation of a reading."""
    delta_c: Positive = 0.5
    """Threshold of send-on-delta."""


class EncodingSpec(Table, frozen=True, kw_only=True):
    """Event encoding of the readings: `level_crossing`, `send_on_delta` or `periodic` (every period)."""

    kind: Encoding = "level_crossing"
    """Encoding with which the cells start; the controller may change it."""
    repeat_ms: Annotated[float, Meta(ge=0.0, le=60_000.0)] = 100.0
    """Time after which a cell repeats a level that no request for its stream answered *(assumed)*; then 2, 4,
    8 and 16 times as long between repeats; 0 for never."""


class CellSpec(Table, frozen=True, kw_only=True):
    """HEX-o-SKIN cell: sampling, geometry, sensors and event encoding."""

    period_ms: Positive = 4.0
    """Sampling period; equals `body.stimulus_period_ms`."""
    side_m: Positive = 0.014
    """Side of the hexagon [M14]."""
    force_cell_radius_m: Positive = 0.0055
    """Distance of the three force cells from the centre *(assumed)*."""
    processing_delay_us: Positive = 50.0
    """Processing delay from a packet to the cell's answer during network formation *(assumed)*."""
    encoding: EncodingSpec = field(default_factory=EncodingSpec)
    """Event encoding."""
    force: ForceSpec = field(default_factory=ForceSpec)
    """Force cells."""
    proximity: ProximitySpec = field(default_factory=ProximitySpec)
    """Proximity sensor."""
    accelerometer: AccelerometerSpec = field(default_factory=AccelerometerSpec)
    """Accelerometer."""
    temperature: TemperatureSpec = field(default_factory=TemperatureSpec)
    """Temperature sensor."""

    @property
    def period_ns(self) -> int:
        """Sampling period [ns]."""
        return ns_of_ms(self.period_ms)

    @property
    def repeat_periods(self) -> int:
        """Sampling periods until an unanswered level is repeated, rounded up; 0 for never."""
        return -(-ns_of_ms(self.encoding.repeat_ms) // self.period_ns)
