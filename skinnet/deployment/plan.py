"""What `skinnet plan` assumes of the load of a skin, and what the skin must keep."""

from typing import Annotated, Literal

from msgspec import Meta

from skinnet.deployment.table import NonNegative, Positive, Share, Table

__all__ = ["PlanSpec"]


class PlanSpec(Table, frozen=True, kw_only=True):
    """Load and limits of a link budget; a run does not read them."""

    encoding: Literal["levels", "delta", "clock"] | None = None
    """What cells send; as in `cells.encoding` unless given, but `clock` if the program has a stage that
    explores, for then all cells stream."""
    stimulated: Share = 0.54
    """Share of the cells that are touched at once, and may all be neighbours; 680 of 1260 [B19]."""
    events_hz: NonNegative = 59.0
    """Events a second of a touched cell: 40 000 a second of 680 cells [B19]."""
    idle_events_hz: NonNegative = 0.1
    """Events a second of a cell that nothing touches *(assumed)*."""
    streams_when_touched: bool = False
    """A touched cell also sends its full reading each period, as a controller may ask it to."""
    latency_ms: Positive | None = None
    """Limit of the worst-case latency from the sample to the gateway."""
    utilisation: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0
    """Limit of the share of its time that a link sends."""
    voltage_v: Positive | None = None
    """Limit of the lowest voltage; `power.minimum_v` unless given."""
