"""What may be ordered to happen to a network at a time, and all of a network that changes with time."""

from dataclasses import dataclass, field
from typing import TypeAlias

from skinnet.network.kernel import MAX_SIZE_BYTES
from skinnet.network.records import FAR_NS, State
from skinnet.network.routes import Routes
from skinnet.network.topology import ALLOWED

__all__ = ["Change", "Fail", "Impair", "Repair", "Snapshot"]


@dataclass(frozen=True)
class Fail:
    """A link goes down."""

    rank: int


@dataclass(frozen=True)
class Repair:
    """A link comes back."""

    rank: int


@dataclass(frozen=True)
class Impair:
    """Fields of a link's record get these values.

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
"""Routes among them lead over ranks, not over numbers of links."""


@dataclass
class Snapshot:
    """All of a network that changes with time; opaque, and good for any network of the same topology."""

    arrays: State
    now_ns: int = 0
    next_ns: int = FAR_NS
    offered: int = 0
    least_size_bytes: int = MAX_SIZE_BYTES + 1
    n_changes: int = 0
    changes: list[tuple[int, int, Change]] = field(default_factory=list)
