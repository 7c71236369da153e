"""Scheduled network events (link failure, repair, impairment, routes) and the network's snapshot."""

from dataclasses import dataclass, field
from typing import TypeAlias

from skinnet.network.kernel import MAX_SIZE_BYTES
from skinnet.network.records import NEVER_NS, KernelState
from skinnet.network.routes import Routes
from skinnet.network.topology import COLUMN_RANGES

__all__ = ["LinkFailure", "LinkImpairment", "LinkRepair", "NetworkSnapshot", "ScheduledEvent"]


@dataclass(frozen=True)
class LinkFailure:
    """Link failure."""

    rank: int


@dataclass(frozen=True)
class LinkRepair:
    """Link repair."""

    rank: int


@dataclass(frozen=True)
class LinkImpairment:
    """Link impairment: new values for fields of a link's record.

    Raises:
        ValueError: A value is outside its range.
    """

    rank: int
    values: dict[str, float]

    def __post_init__(self) -> None:
        for name, value in self.values.items():
            lowest, highest = COLUMN_RANGES[name]
            if not lowest <= value <= highest:
                raise ValueError(f"{name} is {value}; allowed are {lowest} to {highest}")


ScheduledEvent: TypeAlias = LinkFailure | LinkRepair | LinkImpairment | Routes
"""Scheduled change of a network; its routes hold link ranks, not link numbers."""


@dataclass
class NetworkSnapshot:
    """Snapshot of a network's time-varying state; opaque, valid for any network of the same topology."""

    arrays: KernelState
    now_ns: int = 0
    next_event_ns: int = NEVER_NS
    offered: int = 0
    min_size_bytes: int = MAX_SIZE_BYTES + 1
    n_scheduled: int = 0
    scheduled_events: list[tuple[int, int, ScheduledEvent]] = field(default_factory=list)
