"""Scheduled network events (link failure, repair, impairment, routes) and the network's snapshot."""

from dataclasses import dataclass, field
from typing import TypeAlias

from skinnet.network.kernel import MAX_SIZE_BYTES
from skinnet.network.records import FAR_NS, State
from skinnet.network.routes import Routes
from skinnet.network.topology import ALLOWED

__all__ = ["Change", "Fail", "Impair", "Repair", "Snapshot"]


@dataclass(frozen=True)
class Fail:
    """Link failure."""

    rank: int


@dataclass(frozen=True)
class Repair:
    """Link repair."""

    rank: int


@dataclass(frozen=True)
class Impair:
    """Link impairment: new values for fields of a link's record.

    Raises:
        ValueError: A value is outside its range.
    """

    rank: int
    values: dict[str, float]

    def __post_init__(self) -> None:
        for name, value in self.values.items():
            lowest, highest = ALLOWED[name]
            if not lowest <= value <= highest:
                raise ValueError(f"{name} is {value}; allowed are {lowest} to {highest}")


Change: TypeAlias = Fail | Repair | Impair | Routes
"""Scheduled change of a network; its routes hold link ranks, not link numbers."""


@dataclass
class Snapshot:
    """Snapshot of a network's time-varying state; opaque, valid for any network of the same topology."""

    arrays: State
    now_ns: int = 0
    next_ns: int = FAR_NS
    offered: int = 0
    least_size_bytes: int = MAX_SIZE_BYTES + 1
    n_changes: int = 0
    changes: list[tuple[int, int, Change]] = field(default_factory=list)
