"""Link budget spec: load and limits of `skinnet plan`."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import Encoding, Fraction, NonNegative, Positive, Table

__all__ = ["LinkBudgetSpec"]


class LinkBudgetSpec(Table, frozen=True, kw_only=True):
    """Load and limits of a link budget, which `[[cover]]` keeps when it places gateways; runs ignore them."""

    encoding: Encoding | None = None
    """Event encoding; that of `cells.encoding` unless given, but `periodic` if the program has an exploration
    stage, in which all cells stream."""
    stimulated_fraction: Fraction = 0.54
    """Fraction of the cells touched at once, possibly all neighbours; 680 of 1260 [B19]."""
    event_rate_hz: NonNegative = 59.0
    """Event rate of a touched cell: 40 000 events/s of 680 cells [B19]."""
    idle_event_rate_hz: NonNegative = 0.1
    """Event rate of an untouched cell *(assumed)*."""
    stream_when_touched: bool = False
    """Stream the full reading of each touched cell too, as a controller may request."""
    max_latency_ms: Positive | None = None
    """Upper limit of the worst-case latency from the sample to the gateway."""
    max_utilisation: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0
    """Upper limit of the utilisation of a link."""
    min_voltage_v: Positive | None = None
    """Lower limit of the cell voltage; `power.brown_out_v` unless given."""
