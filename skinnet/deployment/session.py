"""What a deployment says of a session: teaching by touch and grasping, on request [M14, IV and V]."""

from typing import Annotated, Literal

from msgspec import Meta, field

from skinnet.deployment.table import NonNegative, Positive, Share, Table, ns_of_ms, ns_of_s

__all__ = ["AreaSpec", "OperatorSpec", "SessionSpec", "StateName", "StateSpec"]

AreaName = Literal["pat", "contact", "chest", "other"]
StateName = Literal[
    "idle",
    "guide_force",
    "guide_proximity",
    "attend",
    "remember",
    "go",
    "open",
    "approach",
    "contact",
    "load",
    "pull",
    "hold",
    "set_down",
    "release",
    "safe",
]
Level = Annotated[int, Meta(ge=1, le=4)]


class AreaSpec(Table, frozen=True, kw_only=True):
    """Reaction of the cells of one area in one state; what is not given is as in Table II [M14]."""

    force_threshold: NonNegative | None = None
    force_gain: NonNegative | None = None
    proximity_threshold: NonNegative | None = None
    proximity_gain: NonNegative | None = None


class StateSpec(Table, frozen=True, kw_only=True):
    """Directives of one state; what is not given is as in Table II [M14]."""

    speed_rad_s: Positive | None = None
    accuracy_rad: Positive | None = None
    patience_s: Positive | None = None
    areas: dict[AreaName, AreaSpec] = field(default_factory=dict)


class OperatorSpec(Table, frozen=True, kw_only=True):
    """One request of the scripted operator, who sends one after the other.

    It is sent when the session has been in `state` for `after_s`, counted from the request before if that
    was later, and nothing has touched the robot for `quiet_s`.
    """

    state: StateName
    request: Literal["guide", "attend", "remember", "go", "grasp", "release", "cancel", "end"]
    argument: str = ""
    after_s: NonNegative = 0.5
    quiet_s: NonNegative = 0.0


class SessionSpec(Table, frozen=True, kw_only=True):
    """Teaching and grasping; levels are those of Table I [M14], counted from 1."""

    operator: tuple[OperatorSpec, ...] = ()
    """Without any, requests come from users only, and the session lasts until one of them ends it."""
    patience_s: Positive = 10.0
    """A session whose operator waits in vain, the robot at rest, ends after so long."""
    pre_contact: bool = True
    """Use the proximity sensors to grasp; without them all that is left is force."""
    near_level: Level = 2
    """An object is near an arm at this level of proximity: medium *(settled in docs/grasping.md)*."""
    contact_level: Level = 4
    """Contact is felt at this level of proximity, close contact, or at any level of force."""
    load_level: Level = 2
    """A force holds at this level: medium."""
    pain_level: Level = 4
    """A force hurts at this level: the grasp is cancelled."""
    lost_ms: Positive = 300.0
    """An arm that feels no contact for so long has lost the object *(assumed)*."""
    stall_ms: Positive = 1500.0
    """A robot that comes no nearer to its pose for so long is stalled *(assumed)*."""
    set_down_s: Positive = 4.0
    """A robot that shall let go of what it carries holds it so long, for somebody to take it *(assumed)*."""
    least_skin: Share = 0.5
    """An area of which a smaller share of the cells is there is lost *(assumed)*."""
    states: dict[StateName, StateSpec] = field(default_factory=dict)

    @property
    def lost_ns(self) -> int:
        """Patience with an arm without contact [ns]."""
        return ns_of_ms(self.lost_ms)

    @property
    def stall_ns(self) -> int:
        """Patience with a robot that comes no nearer [ns]."""
        return ns_of_ms(self.stall_ms)

    @property
    def set_down_ns(self) -> int:
        """How long it waits with what it carries [ns]."""
        return ns_of_s(self.set_down_s)

    @property
    def patience_ns(self) -> int:
        """Patience of the operator [ns]."""
        return ns_of_s(self.patience_s)
