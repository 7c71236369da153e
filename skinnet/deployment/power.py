"""Power network spec: supply, resistances and brown-out of the cells."""

from skinnet.deployment.types import NonNegative, PortName, Positive, Table

__all__ = ["PowerSpec"]


class PowerSpec(Table, frozen=True, kw_only=True):
    """Power network over the 4-wire links that also carry data [T11]; undervoltage browns cells out."""

    supply_v: Positive = 3.3
    """Supply voltage [T11]."""
    current_ma: NonNegative = 47.0
    """Current of a cell with power saving; 130 mA without [T11]."""
    link_ohm: Positive = 0.05
    """Resistance of a link, both conductors together *(assumed: none is published)*."""
    feed_ohm: NonNegative = 0.0
    """Resistance between the supply and a feed point *(assumed)*."""
    brown_out_v: Positive = 2.7
    """Brown-out voltage, below which a cell leaves the network *(assumed)*."""
    feeds: tuple[PortName, ...] = ()
    """Feed points, ports of cells; all interfaces unless given."""

    def __post_init__(self) -> None:
        if self.brown_out_v >= self.supply_v:
            raise ValueError(
                f"brown_out_v = {self.brown_out_v:g}: must be below supply_v = {self.supply_v:g}"
            )
