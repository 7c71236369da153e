"""Teach-and-grasp spec: teaching by touch and grasping, on request [M14, IV and V]."""

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta, field

from skinnet.deployment.types import Fraction, NonNegative, Positive, Table, ns_of_ms, ns_of_s
from skinnet.protocol.states import CONFIGURABLE_STATES

__all__ = ["AreaReactionSpec", "OperatorRequestSpec", "StateName", "StateParametersSpec", "TeachAndGraspSpec"]

AreaName = Literal["pat", "contact", "chest", "other"]
if TYPE_CHECKING:
    StateName: TypeAlias = str
else:
    StateName = Literal[CONFIGURABLE_STATES]
LevelNumber = Annotated[int, Meta(ge=1, le=4)]


class AreaReactionSpec(Table, frozen=True, kw_only=True):
    """Tactile reaction of one area in one state; defaults are those of Table II [M14]."""

    force_threshold: NonNegative | None = None
    """Reading of force above which a cell reacts."""
    force_gain: NonNegative | None = None
    """Velocity per reading of force above the threshold."""
    proximity_threshold: NonNegative | None = None
    """Reading of proximity above which a cell reacts."""
    proximity_gain: NonNegative | None = None
    """Velocity per reading of proximity above the threshold."""


class StateParametersSpec(Table, frozen=True, kw_only=True):
    """Parameters of one state; defaults are those of Table II [M14]."""

    speed_rad_s: Positive | None = None
    """Speed limit of each joint on the way to a pose."""
    tolerance_rad: Positive | None = None
    """Goal tolerance of each joint."""
    timeout_s: Positive | None = None
    """Timeout of the state."""
    areas: dict[AreaName, AreaReactionSpec] = field(default_factory=dict)
    """Tactile reactions by area."""


class OperatorRequestSpec(Table, frozen=True, kw_only=True):
    """Request of the scripted operator, who sends one after the other.

    It is sent once the stage has been in `state` for `delay_s`, counted from the previous request if that
    was later, without any contact for `contact_free_s`.
    """

    state: StateName
    """State in which the request is sent."""
    request: Literal["guide", "attend", "remember", "go", "grasp", "release", "cancel", "end"]
    """Name of the request (docs/requests.md)."""
    argument: str = ""
    """Argument of the request: a pose, an area, or what the request defines."""
    delay_s: NonNegative = 0.5
    """Delay in the state before the request."""
    contact_free_s: NonNegative = 0.0
    """Duration without any contact before the request."""


class TeachAndGraspSpec(Table, frozen=True, kw_only=True):
    """Teaching and grasping [M14]; levels are those of Table I, counted from 1."""

    operator_requests: tuple[OperatorRequestSpec, ...] = ()
    """Scripted requests; without any, external clients send requests until one of them ends the stage."""
    operator_timeout_s: Positive = 10.0
    """Timeout of the scripted operator, while the robot is at rest; then the stage ends."""
    pre_contact: bool = True
    """Use proximity and force to grasp; if false, force only."""
    near_level: LevelNumber = 2
    """Proximity level at which an object is near an arm: medium *(settled in docs/grasping.md)*."""
    contact_level: LevelNumber = 4
    """Proximity level that counts as contact, close contact; any level of force counts too."""
    load_level: LevelNumber = 2
    """Force level at which an object is held: medium."""
    pain_level: LevelNumber = 4
    """Force level of pain, at which the grasp is cancelled."""
    contact_timeout_ms: Positive = 300.0
    """Time without contact after which an arm has lost the object *(assumed)*."""
    stall_timeout_ms: Positive = 1500.0
    """Time without progress towards the pose after which the robot is stalled *(assumed)*."""
    set_down_delay_s: Positive = 4.0
    """Time for which the robot holds an object to be taken before it lets go *(assumed)*."""
    min_skin_fraction: Fraction = 0.5
    """Fraction of an area's cells below which the area is lost *(assumed)*."""
    states: dict[StateName, StateParametersSpec] = field(default_factory=dict)
    """Parameters by state, where they differ from Table II [M14]."""

    @property
    def contact_timeout_ns(self) -> int:
        """Timeout of an arm without contact [ns]."""
        return ns_of_ms(self.contact_timeout_ms)

    @property
    def stall_timeout_ns(self) -> int:
        """Timeout of a robot without progress [ns]."""
        return ns_of_ms(self.stall_timeout_ms)

    @property
    def set_down_delay_ns(self) -> int:
        """Duration of the wait before it lets go [ns]."""
        return ns_of_s(self.set_down_delay_s)

    @property
    def operator_timeout_ns(self) -> int:
        """Timeout of the scripted operator [ns]."""
        return ns_of_s(self.operator_timeout_s)
