"""Stress sweep spec of `skinnet stress`."""

from typing import Annotated, Literal

from msgspec import Meta

from skinnet.deployment.types import Encoding, Fraction, NonNegative, Positive, Table

__all__ = ["PublishedRateSpec", "StressSpec"]

_Count = Annotated[int, Meta(ge=1)]


class PublishedRateSpec(Table, frozen=True, kw_only=True):
    """Published fraction of the clock-driven rate, for comparison with the measured one."""

    fraction: Fraction
    """Rate, as a fraction of the clock-driven one."""
    quantity: Literal["bytes", "packets", "rate"] = "rate"
    """Quantity of the fraction; "rate" where the source gives no packet length: it is then compared with
    both."""
    stimulated: bool
    """Rate of a stimulated skin, instead of one at rest."""
    is_upper_bound: bool = False
    """Upper bound instead of a value."""
    source: str
    """Abbreviation of the source."""

    def applies_to(self, quantity: str) -> bool:
        """Check if the published fraction applies to `quantity`, "bytes" or "packets"."""
        return self.quantity in (quantity, "rate")


class StressSpec(Table, frozen=True, kw_only=True):
    """Parameter sweep of `skinnet stress`: one run for every combination."""

    cells: tuple[_Count, ...] = ()
    """Numbers of cells, reached by whole patches from the first; all unless given."""
    gateways: tuple[_Count, ...] = ()
    """Numbers of gateways per patch, placed by search; those of the deployment unless given."""
    stimulated_fractions: tuple[Fraction, ...] = ()
    """Fractions of stimulated cells, which need `scripted_stimuli`; zero and their fraction unless given."""
    encodings: Annotated[tuple[Encoding, ...], Meta(min_length=1)] = (
        "periodic",
        "send_on_delta",
        "level_crossing",
    )
    """Event encodings that are compared."""
    delta_noise_ratios: tuple[Positive, ...] = ()
    """Send-on-delta thresholds as multiples of each sensor's noise, quantisation included: further runs with
    all cells and each fraction of stimulated ones."""
    warm_up_s: NonNegative = 1.0
    """Warm-up before the measurement (simulated time), in which cells send their first readings."""
    duration_s: Positive = 4.0
    """Duration of the measurement (simulated time)."""
    published: tuple[PublishedRateSpec, ...] = ()
    """Published rates, for comparison."""
