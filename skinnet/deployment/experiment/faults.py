"""Fault rules of a deployment: kind, targets and times of each injected fault.

A rule is one entry of `[[faults]]`; its `kind` selects one of the tables below.
"""

from typing import Annotated, Literal

from msgspec import Meta

from skinnet.deployment.cell_names import FaultTarget
from skinnet.deployment.types import Fraction, NonNegative, Positive, Table

__all__ = [
    "BabblingIdiot",
    "BitErrors",
    "BurstLoss",
    "CellDead",
    "CellRule",
    "Drift",
    "FaultRule",
    "GatewayLost",
    "LinkCut",
    "LinkRule",
    "Loss",
    "SensorChannel",
    "SlowProcess",
    "StuckAt",
]

SensorChannel = Literal["force0", "force1", "force2", "proximity", "ax_g", "ay_g", "az_g", "temperature_c"]
"""Columns of a reading, as in `skinnet.protocol.messages.READING_NAMES`; a test compares the two."""
_Interval = Annotated[float, Meta(ge=0.001)]
"""Mean interval of repeated faults [s], bounded below against typing errors that yield billions of faults."""
_Dwell = Annotated[float, Meta(ge=0.0001)]
"""Mean dwell time of a channel state [s]: at least about one packet on the wire."""
_PacketRate = Annotated[float, Meta(gt=0.0, le=100_000.0)]


class _Rule(Table, frozen=True, kw_only=True, tag_field="kind"):
    """Targets and times of a fault; random draws depend on the seed and on the target only."""

    target: FaultTarget
    """Targets of the fault, by name or by a pattern in which `*` matches anything."""
    pick: Annotated[int, Meta(ge=1)] | None = None
    """Number of targets drawn by the seed from those that match; all unless given."""
    at_s: NonNegative | None = None
    """Onset of the fault; the start of the run unless this or one of the next two is given."""
    between_s: tuple[NonNegative, NonNegative] | None = None
    """Interval from which the onset is drawn, for each target by itself."""
    mean_interval_s: _Interval | None = None
    """Mean time from repair to the next fault of each target (a Poisson process)."""
    duration_s: Positive | None = None
    """Duration of the fault; permanent unless given."""

    @property
    def kind(self) -> str:
        """Kind of fault, as written in the deployment."""
        return str(self.__struct_config__.tag)


class LinkRule(_Rule, frozen=True, kw_only=True):
    """Fault of links."""

    direction: Literal["out", "in", "both"] = "both"
    """Direction of the faulty links: out of the named ports, into them, or both."""


class LinkCut(LinkRule, frozen=True, kw_only=True, tag="link_cut"):
    """Link cut: packets on the link or sent over it are lost.

    A link is named by the port at one of its ends, "patch/cell:port" or "patch:gateway"; "patch/cell" and
    "patch" stand for all links of a cell and of a patch.
    """


class BitErrors(LinkRule, frozen=True, kw_only=True, tag="bit_errors"):
    """Independent bit errors on a link; the checksum detects every corrupted packet.

    Links are named as for `link_cut`.
    """

    bit_error_rate: Fraction
    """Bit error probability, for each bit on the wire."""


class Loss(LinkRule, frozen=True, kw_only=True, tag="loss"):
    """Independent packet loss on a link. Links are named as for `link_cut`."""

    probability: Fraction
    """Probability that a packet is lost."""


class BurstLoss(LinkRule, frozen=True, kw_only=True, tag="burst_loss"):
    """Burst packet loss on a link (Gilbert 1960, Elliott 1963), in continuous time.

    Dwell times in the good and bad states are exponentially distributed, independently for each direction.
    Links are named as for `link_cut`.
    """

    mean_good_s: _Dwell
    """Mean dwell time in the good state."""
    mean_bad_s: _Dwell
    """Mean dwell time in the bad state."""
    loss_good: Fraction = 0.0
    """Loss probability in the good state."""
    loss_bad: Fraction = 1.0
    """Loss probability in the bad state."""


class GatewayLost(_Rule, frozen=True, kw_only=True, tag="gateway_lost"):
    """Gateway failure: "patch:gateway", or "patch" for all gateways of a patch."""


class CellRule(_Rule, frozen=True, kw_only=True):
    """Fault of cells."""


class CellDead(CellRule, frozen=True, kw_only=True, tag="cell_dead"):
    """Cell failure: the cell neither senses nor forwards.

    A cell is named "patch/cell"; "patch" stands for all cells of a patch. To add a cell at run time, let it
    be dead until then: `at_s = 0`, `duration_s = 5`.
    """


class StuckAt(CellRule, frozen=True, kw_only=True, tag="stuck_at"):
    """Stuck-at fault of a reading. Cells are named as for `cell_dead`."""

    channel: SensorChannel | Literal["all"]
    """Column of the reading; "all" for every column."""
    value: float | None = None
    """Constant reading; the first one after the onset unless given."""


class Drift(CellRule, frozen=True, kw_only=True, tag="drift"):
    """Drift of a reading within the sensor's range. Cells are named as for `cell_dead`."""

    channel: SensorChannel
    """Column of the reading."""
    rate_per_s: float
    """Drift rate, in units of the reading per second."""


class BabblingIdiot(CellRule, frozen=True, kw_only=True, tag="babbling_idiot"):
    """Babbling idiot (Kopetz): a cell sends spurious events as a Poisson process.

    Cells are named as for `cell_dead`.
    """

    rate_hz: _PacketRate
    """Mean rate of the spurious events of a cell."""


class SlowProcess(_Rule, frozen=True, kw_only=True, tag="slow_process"):
    """Slow process: a cell process, by name, needs more wall-clock time for the same results."""

    added_delay_ms: Positive
    """Additional wall-clock time of each period."""


FaultRule = (
    LinkCut
    | CellDead
    | StuckAt
    | Drift
    | BabblingIdiot
    | BitErrors
    | Loss
    | BurstLoss
    | GatewayLost
    | SlowProcess
)
