"""Stand spec: a lift that presents an object to the robot."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import Fraction, NonNegative, Positive, StageName, Table, ns_of_s

__all__ = ["StandSpec"]


class StandSpec(Table, frozen=True, kw_only=True):
    """Lift that presents an object to the robot on a plate, and lowers it again *(assumed)*.

    The plate starts `rise_m` below its upper position and rises `rise_delay_s` after the first start of the
    stage `rise_stage`. It lowers by `lower_m`, `lower_delay_s` after the start of `lower_stage`, stays down
    for `lowered_s`, or less if that stage ends, and returns to its upper position for the rest of the run.
    """

    grasp_z_m: Positive = 1.07
    """Height of the object's centre in the upper position: that of the HRP-2-like robot's forearms in a
    hug."""
    object_face_x_m: float = 0.24
    """Position of a box's nearest face, without the disturbance (x, world frame); round objects are placed
    nearer to the robot."""
    max_offset_m: NonNegative = 0.0
    """Disturbance: largest offset of the object in x and in y, drawn by the seed."""
    max_yaw_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0
    """Disturbance: largest rotation of the object about z, drawn by the seed."""
    fix_object: bool = False
    """Fix the object to the plate."""
    rise_m: NonNegative = 0.0
    """Distance of the plate below its upper position before it rises."""
    rise_stage: StageName | None = None
    """Stage that makes the plate rise; required with `rise_m`."""
    rise_delay_s: NonNegative = 0.0
    """Delay from the start of `rise_stage` until the plate rises."""
    lower_stage: StageName | None = None
    """Stage that makes the plate lower; without one it stays up."""
    lower_delay_s: NonNegative = 1.0
    """Delay from the start of `lower_stage` until the plate lowers."""
    lower_m: Positive = 0.25
    """Distance by which the plate lowers."""
    lowered_s: NonNegative = 6.0
    """Longest duration of the lower position."""
    max_descent_m: Positive = 0.05
    """Greatest descent of the object while the stand is away for a grasp that counts as a success."""
    bare_weight_fraction: Fraction = 0.1
    """Greatest fraction of the object's weight that links without skin may bear while it counts as carried by
    skin."""
    speed_m_s: Positive = 0.10
    """Speed limit of the plate."""
    acceleration_m_s2: Positive = 0.5
    """Acceleration of the plate, low enough that objects do not slip."""
    plate_edge_x_m: float = 0.17
    """Near edge of the plate (x, world frame), clear of the chest when the object is pulled to it."""
    plate_width_m: Positive = 0.20
    """Width of the plate, narrow enough for the forearms to pass by its sides."""

    @property
    def rise_delay_ns(self) -> int:
        """Delay from the start of `rise_stage` until the plate rises [ns]."""
        return ns_of_s(self.rise_delay_s)

    @property
    def lower_delay_ns(self) -> int:
        """Delay from the start of `lower_stage` until the plate lowers [ns]."""
        return ns_of_s(self.lower_delay_s)

    @property
    def lowered_ns(self) -> int:
        """Duration of the lower position [ns]."""
        return ns_of_s(self.lowered_s)
