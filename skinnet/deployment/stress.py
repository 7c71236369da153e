"""What `skinnet stress` sweeps, as a deployment describes it."""

from typing import Annotated, Literal

from msgspec import Meta

from skinnet.deployment.table import NonNegative, Positive, Share, Table

__all__ = ["EncodingName", "PublishedSpec", "StressSpec"]

EncodingName = Literal["clock", "delta", "levels"]
_Count = Annotated[int, Meta(ge=1)]


class PublishedSpec(Table, frozen=True, kw_only=True):
    """A published share of the clock-driven rate, drawn beside what is measured."""

    share: Share
    of: Literal["bytes", "packets", "rate"] = "rate"
    """What it is a share of; "rate" where the source does not say how long its packets are: then it stands
    beside both."""
    stimulated: bool
    at_most: bool = False
    """The source gives a bound, not a value."""
    source: str

    def is_of(self, what: str) -> bool:
        """Whether it stands beside the share of `what`, "bytes" or "packets"."""
        return self.of in (what, "rate")


class StressSpec(Table, frozen=True, kw_only=True):
    """The sweep of `skinnet stress`: every combination of these, each a run of its own."""

    cells: tuple[_Count, ...] = ()
    """Numbers of cells, by whole patches from the first until the number is reached; all unless given."""
    gateways: tuple[_Count, ...] = ()
    """Gateways of each patch, at good places; those of the deployment unless given."""
    stimulated: tuple[Share, ...] = ()
    """Shares of stimulated cells; without a script there is only what the body does. Unless given: none, and
    the script's own share."""
    encodings: Annotated[tuple[EncodingName, ...], Meta(min_length=1)] = ("clock", "delta", "levels")
    delta_sigmas: tuple[Positive, ...] = ()
    """More runs with send-on-delta, where each delta is so many times the noise of its sensor, quantisation
    included; with all cells and each share of stimulated ones."""
    settle_s: NonNegative = 1.0
    """Simulated time before the measurement, in which cells send their first readings."""
    duration_s: Positive = 4.0
    """Simulated time that is measured."""
    published: tuple[PublishedSpec, ...] = ()
