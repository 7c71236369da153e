"""Rules of faults, as a deployment states them: what breaks, where, and when.

A rule is one entry of `[[faults]]`; its `kind` says which of the tables below it is.
"""

from typing import Annotated, Literal

from msgspec import Meta

from skinnet.deployment.table import NonNegative, Positive, Share, Table

__all__ = [
    "Babble",
    "BitErrors",
    "BurstLoss",
    "CellDead",
    "CellRule",
    "Channel",
    "Drift",
    "FaultRule",
    "GatewayLost",
    "LinkCut",
    "LinkRule",
    "Loss",
    "SlowHost",
    "Stuck",
]

Target = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-*]+(/(?!0[0-9])[0-9*]+)?(:(?!0[0-9])[0-9*]+)?$")]
Channel = Literal["force0", "force1", "force2", "proximity", "ax_g", "ay_g", "az_g", "temperature_c"]
"""Columns of a reading, as in `skinnet.messages.READING_NAMES`; a test holds them together."""
_Interval = Annotated[float, Meta(ge=0.001)]
"""Repeated faults are at least a millisecond apart on average, so that a slip makes no billions."""
_Dwell = Annotated[float, Meta(ge=0.0001)]
"""About one packet on the wire: no burst is shorter on average."""
_PacketRate = Annotated[float, Meta(gt=0.0, le=100_000.0)]


class _Rule(Table, frozen=True, kw_only=True, tag_field="kind"):
    """Where and when: at one time or at random; the draws depend on the seed and on what is hit only."""

    target: Target
    """What breaks, by name or by a pattern in which `*` stands for anything."""
    pick: Annotated[int, Meta(ge=1)] | None = None
    """Only so many of those that match, chosen by the seed; all unless given."""
    at_s: NonNegative | None = None
    """When it breaks; from the start unless this or one of the next two is given."""
    between_s: tuple[NonNegative, NonNegative] | None = None
    """It breaks at a random time between these, each target at its own."""
    mean_interval_s: _Interval | None = None
    """It breaks again and again: each target, while whole, at random with this mean (a Poisson process)."""
    duration_s: Positive | None = None
    """After so long it is whole again; for good unless given."""

    @property
    def kind(self) -> str:
        """The rule's kind, as the deployment writes it."""
        return str(self.__struct_config__.tag)


class LinkRule(_Rule, frozen=True, kw_only=True):
    """Something about links."""

    direction: Literal["out", "in", "both"] = "both"
    """Out of the named ports, into them, or both."""


class LinkCut(LinkRule, frozen=True, kw_only=True, tag="link_cut"):
    """A link is cut: what is on it or is sent over it is lost.

    Links go by the port at one of their ends, "patch/cell:port" or "patch:gateway"; "patch/cell" and "patch"
    stand for all links of a cell and of a patch.
    """


class BitErrors(LinkRule, frozen=True, kw_only=True, tag="bit_errors"):
    """Bits flip on a link, independently; the checksum catches every packet that is hit.

    Links go by the same names as for `link_cut`.
    """

    rate: Share
    """Probability for each bit on the wire."""


class Loss(LinkRule, frozen=True, kw_only=True, tag="loss"):
    """A link loses packets, independently. Links go by the same names as for `link_cut`."""

    probability: Share


class BurstLoss(LinkRule, frozen=True, kw_only=True, tag="burst_loss"):
    """A link loses packets in bursts (Gilbert 1960, Elliott 1963), in continuous time.

    It is good or bad for times that are exponentially distributed, and loses packets accordingly, each
    direction by itself. Links go by the same names as for `link_cut`.
    """

    mean_good_s: _Dwell
    mean_bad_s: _Dwell
    loss_good: Share = 0.0
    """Probability of loss while good."""
    loss_bad: Share = 1.0
    """Probability of loss while bad."""


class GatewayLost(_Rule, frozen=True, kw_only=True, tag="gateway_lost"):
    """A port of an interface dies: "patch:gateway", or "patch" for all gateways of a patch."""


class CellRule(_Rule, frozen=True, kw_only=True):
    """Something about cells."""


class CellDead(CellRule, frozen=True, kw_only=True, tag="cell_dead"):
    """A cell is dead: it neither senses nor forwards. Cells are "patch/cell", or "patch" for all of a patch.

    A cell that is added at run time is one that is dead until then: `at_s = 0`, `duration_s = 5`.
    """


class Stuck(CellRule, frozen=True, kw_only=True, tag="stuck"):
    """A reading no longer changes. Cells go by the same names as for `cell_dead`."""

    channel: Channel | Literal["all"]
    value: float | None = None
    """The reading from then on; the first one after the fault unless given."""


class Drift(CellRule, frozen=True, kw_only=True, tag="drift"):
    """A reading drifts away, within the sensor's range. Cells go by the same names as for `cell_dead`."""

    channel: Channel
    per_s: float
    """Growth of its offset, in units of the reading per second."""


class Babble(CellRule, frozen=True, kw_only=True, tag="babble"):
    """A cell sends events of its own at random, whatever it feels (a Poisson process).

    Cells go by the same names as for `cell_dead`.
    """

    packets_per_s: _PacketRate


class SlowHost(_Rule, frozen=True, kw_only=True, tag="slow_host"):
    """The process of a cell host, by name, needs more wall time; what it computes stays the same."""

    extra_ms: Positive
    """Wall time that each period takes more."""


FaultRule = (
    LinkCut | CellDead | Stuck | Drift | Babble | BitErrors | Loss | BurstLoss | GatewayLost | SlowHost
)
