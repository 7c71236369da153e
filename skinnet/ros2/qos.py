"""Quality of service in the compact form of liveliness tokens.

`reliability:durability:history,depth:deadline s,ns:lifespan s,ns:liveliness,lease s,ns`, with numbers of
rmw's enumerations; a part that is as rmw_zenoh has it by default stays empty (`qos_to_keyexpr` there).
"""

from dataclasses import dataclass
from enum import IntEnum

__all__ = ["Durability", "History", "Qos", "Reliability"]

_DEFAULT_DEPTH = 42


class Reliability(IntEnum):
    """`rmw_qos_reliability_policy_e`."""

    RELIABLE = 1
    BEST_EFFORT = 2


class Durability(IntEnum):
    """`rmw_qos_durability_policy_e`."""

    TRANSIENT_LOCAL = 1
    VOLATILE = 2


class History(IntEnum):
    """`rmw_qos_history_policy_e`."""

    KEEP_LAST = 1
    KEEP_ALL = 2


@dataclass(frozen=True)
class Qos:
    """What a publisher offers or a subscription asks for; no deadlines, lifespans or leases.

    Attributes:
        reliability: Over a reliable link, or the fastest there is.
        durability: Whether subscriptions that come later get the last messages.
        history: Which messages are kept.
        depth: How many.
    """

    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    history: History = History.KEEP_LAST
    depth: int = 10

    @property
    def compact(self) -> str:
        """The form in tokens."""
        reliability = "" if self.reliability is Reliability.RELIABLE else f"{self.reliability:d}"
        durability = "" if self.durability is Durability.VOLATILE else f"{self.durability:d}"
        history = "" if self.history is History.KEEP_LAST else f"{self.history:d}"
        depth = "" if self.depth == _DEFAULT_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:{history},{depth}:,:,:,,"
