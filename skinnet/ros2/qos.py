"""QoS profiles of ROS 2, in the compact form of liveliness tokens.

`reliability:durability:history,depth:deadline s,ns:lifespan s,ns:liveliness,lease s,ns`, with the values of
rmw's enumerations; a part with rmw_zenoh's default value stays empty (`qos_to_keyexpr` there).
"""

from dataclasses import dataclass
from enum import IntEnum

__all__ = ["Durability", "History", "QosProfile", "Reliability"]

_DEFAULT_DEPTH = 42


class Reliability(IntEnum):
    """Reliability policy, `rmw_qos_reliability_policy_e`."""

    RELIABLE = 1
    BEST_EFFORT = 2


class Durability(IntEnum):
    """Durability policy, `rmw_qos_durability_policy_e`."""

    TRANSIENT_LOCAL = 1
    VOLATILE = 2


class History(IntEnum):
    """History policy, `rmw_qos_history_policy_e`."""

    KEEP_LAST = 1
    KEEP_ALL = 2


@dataclass(frozen=True)
class QosProfile:
    """QoS profile of a publisher or subscription; without deadline, lifespan and lease.

    Attributes:
        reliability: Reliable or best-effort delivery.
        durability: Whether late subscriptions get the last messages.
        history: Keep the last messages or all.
        depth: Number of kept messages.
    """

    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    history: History = History.KEEP_LAST
    depth: int = 10

    @property
    def compact_form(self) -> str:
        """Compact form, as in tokens."""
        reliability = "" if self.reliability is Reliability.RELIABLE else f"{self.reliability:d}"
        durability = "" if self.durability is Durability.VOLATILE else f"{self.durability:d}"
        history = "" if self.history is History.KEEP_LAST else f"{self.history:d}"
        depth = "" if self.depth == _DEFAULT_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:{history},{depth}:,:,:,,"
