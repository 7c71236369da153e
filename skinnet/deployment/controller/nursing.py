"""Nursing spec: whole-body contact manipulation of Mukai et al. 2011 [R11]."""

from typing import Annotated, Literal

from msgspec import Meta, field

from skinnet.deployment.types import Name, NonNegative, Positive, Table, Vector3, ns_of_ms, ns_of_s

__all__ = ["AssumedContactSpec", "ContactWeightSpec", "ImpedanceSpec", "NursingSpec", "WaypointSpec"]


def _require_positive(spec: Table, *fields: str) -> None:
    """Require positive fields; msgspec checks types only in what is read from a file."""
    for name in fields:
        if not getattr(spec, name) > 0.0:
            raise ValueError(f"{name} = {getattr(spec, name):g}: must be above zero")


class ContactWeightSpec(Table, frozen=True, kw_only=True):
    """Weights of one contact in the evaluation function (6); defaults are those of a forearm [R11]."""

    position: Positive = 1.0
    """Weight of the position of the contact."""
    rotation: Positive = 0.2
    """Weight of the rotation of the contact."""

    def __post_init__(self) -> None:
        _require_positive(self, "position", "rotation")


class ImpedanceSpec(Table, frozen=True, kw_only=True):
    """Virtual inertia, viscosity and stiffness of equation (19) or (21)."""

    inertia: Positive
    """Virtual inertia."""
    damping: Positive
    """Virtual viscosity."""
    stiffness: Positive
    """Virtual stiffness."""

    def __post_init__(self) -> None:
        _require_positive(self, "inertia", "damping", "stiffness")


class AssumedContactSpec(Table, frozen=True, kw_only=True):
    """Contact that is assumed instead of sensed, at ξ on a surface, as in experiment A [R11, VI.A]."""

    surface: Name
    """Surface of the contact."""
    xi_m: tuple[float, float] = (0.0, 0.0)
    """Tactile coordinates of the contact."""


class WaypointSpec(Table, frozen=True, kw_only=True):
    """Waypoint of the object, relative to its initial pose, world frame."""

    t_s: Positive
    """Time since the start of the motion."""
    displacement_m: Vector3 = (0.0, 0.0, 0.0)
    """Displacement of the centre."""
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    """Rotation vector (axis times angle)."""


class NursingSpec(Table, frozen=True, kw_only=True):
    """Whole-body contact manipulation [R11]; values without a source there are assumed."""

    label: Name = "nursing"
    """Label of its metrics."""
    joints: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Controlled joints: arms and waist; with the cart all deviations vanish, contrary to [R11]."""
    waypoints: Annotated[tuple[WaypointSpec, ...], Meta(min_length=1)]
    """Trajectory of the object, in the order of time."""
    assumed_contacts: tuple[AssumedContactSpec, ...] = ()
    """Contacts used instead of sensed ones; requires `feedback = "none"`."""
    solver: Literal["closed_form", "qp"] = "closed_form"
    """Solution of the evaluation function (6): closed form, or quadratic program with limits."""
    feedback: Literal["none", "position", "rotation", "position_rotation"] = "position_rotation"
    """Tactile feedback of contact positions and rotations."""
    weights: dict[str, ContactWeightSpec] = field(default_factory=dict)
    """Contact weights by sheet or by its body; default weights for all others."""
    joint_weight: Positive = 1e-4
    """Weight w_q of every joint [R11, VI.A]."""
    object_centre_m: Vector3 | None = None
    """Initial inherent centre of the object, world frame; mean of the contacts unless given."""
    position_feedback: ImpedanceSpec = ImpedanceSpec(inertia=545.0, damping=1090.0, stiffness=2725.0)
    """Impedance of the position feedback: Table II [R11]."""
    rotation_feedback: ImpedanceSpec = ImpedanceSpec(inertia=0.0043, damping=0.143, stiffness=0.108)
    """Impedance of the rotation feedback: Table II [R11]."""
    max_joint_speed_rad_s: Positive = 0.5
    """Speed limit of every joint *(assumed)*."""
    max_joint_acceleration_rad_s2: Positive | None = None
    """Acceleration limit of every joint; none unless given."""
    joint_offset_sigma_deg: NonNegative = 0.0
    """Standard deviation of the joint offsets in the controller's model, drawn by the seed."""
    link_error_sigma_mm: NonNegative = 0.0
    """Standard deviation of the link positions in the controller's model, per axis, drawn by the seed."""
    joint_offset_deg: dict[str, float] = field(default_factory=dict)
    """Joint offsets given by name instead of drawn."""
    link_error_mm: dict[str, Vector3] = field(default_factory=dict)
    """Link position errors given by body instead of drawn, in the frame of its parent."""
    hold_s: NonNegative = 1.0
    """Duration of the hold before the motion."""
    record_s: NonNegative = 0.2
    """Duration over which the initial contacts are averaged."""
    settle_s: NonNegative = 3.0
    """Duration of the hold after the motion."""
    contact_threshold_n: Positive = 1.0
    """Force threshold of a contact *(assumed)*."""
    association_distance_m: NonNegative = 0.043
    """Association distance: largest jump of a contact along its sheet, or to a new region id; two elements
    *(assumed)*."""
    contact_timeout_ms: Positive = 100.0
    """Time below the force threshold after which a contact is lost *(assumed)*."""
    skin_timeout_ms: Positive = 40.0
    """Timeout of the skin input: ten board periods *(assumed)*."""
    max_pressure_kpa: Positive = 60.0
    """Pressure limit of an element; below the 90 kPa of the sensors *(assumed)*."""
    position_tolerance_m: Positive = 0.1
    """Position deviation beyond which a contact is out of reach *(assumed)*."""
    rotation_tolerance_rad: Positive = 0.7
    """Rotation deviation beyond which a contact is out of reach *(assumed)*."""
    min_mobility: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.25
    """Minimum fraction of a shift in any direction that the contacts can follow *(assumed)*."""
    mobility_lever_m: Positive = 0.05
    """Joint lever below which a direction counts as lost in a singular posture *(assumed)*."""

    def __post_init__(self) -> None:
        _require_positive(
            self,
            "joint_weight",
            "max_joint_speed_rad_s",
            "contact_threshold_n",
            "contact_timeout_ms",
            "skin_timeout_ms",
            "max_pressure_kpa",
        )
        _require_positive(self, "position_tolerance_m", "rotation_tolerance_rad", "mobility_lever_m")
        if self.max_joint_acceleration_rad_s2 is not None:
            _require_positive(self, "max_joint_acceleration_rad_s2")
        if self.assumed_contacts and self.feedback != "none":
            raise ValueError(
                f'feedback = "{self.feedback}": assumed contacts have no sensor readings; set it to none'
            )
        times_s = [0.0, *(point.t_s for point in self.waypoints)]
        if sorted(set(times_s)) != times_s:
            raise ValueError(f"waypoints at {times_s[1:]} s: times must ascend strictly")

    @property
    def has_position_feedback(self) -> bool:
        """True with position feedback."""
        return self.feedback in ("position", "position_rotation")

    @property
    def has_rotation_feedback(self) -> bool:
        """True with rotation feedback."""
        return self.feedback in ("rotation", "position_rotation")

    @property
    def hold_ns(self) -> int:
        """Duration of the hold [ns]."""
        return ns_of_s(self.hold_s)

    @property
    def record_ns(self) -> int:
        """Duration of the recording of initial contacts [ns]."""
        return ns_of_s(self.record_s)

    @property
    def settle_ns(self) -> int:
        """Duration of settling [ns]."""
        return ns_of_s(self.settle_s)

    @property
    def contact_timeout_ns(self) -> int:
        """Timeout of a weak contact [ns]."""
        return ns_of_ms(self.contact_timeout_ms)

    @property
    def skin_timeout_ns(self) -> int:
        """Timeout of the skin input [ns]."""
        return ns_of_ms(self.skin_timeout_ms)
