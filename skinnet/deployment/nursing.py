"""What a deployment says of the nursing program."""

from typing import Annotated, Literal

from msgspec import Meta, field

from skinnet.deployment.table import Name, NonNegative, Positive, Table, Vector, ns_of_ms, ns_of_s

__all__ = ["AssumedContactSpec", "ImpedanceSpec", "NursingSpec", "WaypointSpec", "WeightSpec"]


def _above_zero(spec: Table, *fields: str) -> None:
    """The types say so too, but only to what is read from a file."""
    for name in fields:
        if not getattr(spec, name) > 0.0:
            raise ValueError(f"{name} = {getattr(spec, name):g}: must be above zero")


class WeightSpec(Table, frozen=True, kw_only=True):
    """Weights of one contact in the evaluation function (6); those of a forearm unless given [R11]."""

    position: Positive = 1.0
    rotation: Positive = 0.2

    def __post_init__(self) -> None:
        _above_zero(self, "position", "rotation")


class ImpedanceSpec(Table, frozen=True, kw_only=True):
    """Virtual inertia, viscosity and stiffness of equation (19) or (21)."""

    inertia: Positive
    damping: Positive
    stiffness: Positive

    def __post_init__(self) -> None:
        _above_zero(self, "inertia", "damping", "stiffness")


class AssumedContactSpec(Table, frozen=True, kw_only=True):
    """A contact that is assumed, as in experiment A [R11, VI.A]: where ξ is on a surface."""

    surface: Name
    xi_m: tuple[float, float] = (0.0, 0.0)


class WaypointSpec(Table, frozen=True, kw_only=True):
    """Where the object is to be, against where it was in the beginning, world frame."""

    t_s: Positive
    """Since the object began to move."""
    displacement_m: Vector = (0.0, 0.0, 0.0)
    rotation_rad: Vector = (0.0, 0.0, 0.0)
    """Axis times angle."""


class NursingSpec(Table, frozen=True, kw_only=True):
    """Whole-body contact manipulation [R11]; what has no source there is assumed."""

    label: Name = "nursing"
    """What its figures are called."""
    joints: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Joints that take part: arms and waist; with the cart every deviation vanishes, against the paper."""
    waypoints: Annotated[tuple[WaypointSpec, ...], Meta(min_length=1)]
    assumed: tuple[AssumedContactSpec, ...] = ()
    """Contacts to go by instead of those that are felt; feedback must be none."""
    solver: Literal["closed_form", "qp"] = "closed_form"
    feedback: Literal["none", "position", "rotation", "position_rotation"] = "position_rotation"
    weights: dict[str, WeightSpec] = field(default_factory=dict)
    """By sheet, or by the body that carries it; a `WeightSpec` as it is for all others."""
    joint_weight: Positive = 1e-4
    """w_q of every joint [R11, VI.A]."""
    object_m: Vector | None = None
    """Inherent centre of the object in the beginning, world frame; the mean of the contacts unless given."""
    position_feedback: ImpedanceSpec = ImpedanceSpec(inertia=545.0, damping=1090.0, stiffness=2725.0)
    """Table II [R11]."""
    rotation_feedback: ImpedanceSpec = ImpedanceSpec(inertia=0.0043, damping=0.143, stiffness=0.108)
    """Table II [R11]."""
    speed_rad_s: Positive = 0.5
    """Of every joint *(assumed)*."""
    acceleration_rad_s2: Positive | None = None
    """Of every joint; without limit unless given."""
    joint_offset_sigma_deg: NonNegative = 0.0
    """By how much the controller is wrong about each joint, drawn from the seed."""
    link_error_sigma_mm: NonNegative = 0.0
    """By how much the controller is wrong about where each link is, per axis, drawn from the seed."""
    joint_offset_deg: dict[str, float] = field(default_factory=dict)
    """The same for joints that are named here, instead of a draw."""
    link_error_mm: dict[str, Vector] = field(default_factory=dict)
    """The same for links that are named here, by body, in the frame of its parent."""
    hold_s: NonNegative = 1.0
    record_s: NonNegative = 0.2
    settle_s: NonNegative = 3.0
    contact_n: Positive = 1.0
    """Weaker is no contact *(assumed)*."""
    follow_m: NonNegative = 0.043
    """So far may a contact jump along its sheet, or be found under a new number: two elements *(assumed)*."""
    lost_ms: Positive = 100.0
    """A contact that is weaker for so long is lost *(assumed)*."""
    silent_ms: Positive = 40.0
    """Skin that says nothing for so long, ten frames of the boards, is silent *(assumed)*."""
    comfort_kpa: Positive = 60.0
    """Highest pressure on an element; below the 90 kPa of the sensors *(assumed)*."""
    reach_m: Positive = 0.1
    """A contact that deviates more is out of reach *(assumed)*."""
    reach_rad: Positive = 0.7
    """The same for its rotation *(assumed)*."""
    mobility: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.25
    """Least share of a shift in any direction that the contacts must be able to follow *(assumed)*."""
    mobility_lever_m: Positive = 0.05
    """Joint levers below this count as lost in a singular posture *(assumed)*."""

    def __post_init__(self) -> None:
        _above_zero(self, "joint_weight", "speed_rad_s", "contact_n", "lost_ms", "silent_ms", "comfort_kpa")
        _above_zero(self, "reach_m", "reach_rad", "mobility_lever_m")
        if self.acceleration_rad_s2 is not None:
            _above_zero(self, "acceleration_rad_s2")
        if self.assumed and self.feedback != "none":
            raise ValueError(f'feedback = "{self.feedback}": assumed contacts feel nothing; set it to none')
        times_s = [0.0, *(point.t_s for point in self.waypoints)]
        if sorted(set(times_s)) != times_s:
            raise ValueError(f"waypoints at {times_s[1:]} s: each must be later than the one before")

    @property
    def feels_position(self) -> bool:
        """Position feedback is on."""
        return self.feedback in ("position", "position_rotation")

    @property
    def feels_rotation(self) -> bool:
        """Rotation feedback is on."""
        return self.feedback in ("rotation", "position_rotation")

    @property
    def hold_ns(self) -> int:
        """Duration of the hold [ns]."""
        return ns_of_s(self.hold_s)

    @property
    def record_ns(self) -> int:
        """Duration of the record [ns]."""
        return ns_of_s(self.record_s)

    @property
    def settle_ns(self) -> int:
        """Duration of settling [ns]."""
        return ns_of_s(self.settle_s)

    @property
    def lost_ns(self) -> int:
        """Patience with a weak contact [ns]."""
        return ns_of_ms(self.lost_ms)

    @property
    def silent_ns(self) -> int:
        """Patience with the skin [ns]."""
        return ns_of_ms(self.silent_ms)
