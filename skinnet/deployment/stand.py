"""The stand that presents an object to the robot, as a deployment describes it."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.table import NonNegative, Positive, StageName, Table, ns_of_s

__all__ = ["StandSpec"]


class StandSpec(Table, frozen=True, kw_only=True):
    """A plate on a column that lifts an object to the robot, and lowers away from it *(assumed)*.

    It starts `below_m` too low and rises `present_s` after the stage `present_stage` first began. It lowers
    away by `lower_m`, `lower_s` after `lower_stage` began, stays away for `away_s`, and comes back up to
    where it was; it comes back at once if that stage ends before. Once back it stays.
    """

    grasp_z_m: Positive = 1.07
    """Height of the middle of the object while the stand is up: that of the HRP-2-like robot's forearms when
    they hug."""
    near_x_m: float = 0.24
    """How near a box's nearest face comes to the robot, without the disturbance (x, world frame); round
    objects come nearer."""
    offset_m: NonNegative = 0.0
    """Disturbance: the object stands off by up to so much in x and in y, drawn by the seed."""
    yaw_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0
    """Disturbance: it is turned by up to so much, drawn by the seed."""
    stuck: bool = False
    """The object is fixed to the stand."""
    below_m: NonNegative = 0.0
    present_stage: StageName | None = None
    """Needed with `below_m`."""
    present_s: NonNegative = 0.0
    lower_stage: StageName | None = None
    """Without one the stand stays up."""
    lower_s: NonNegative = 1.0
    lower_m: Positive = 0.25
    away_s: NonNegative = 6.0
    speed_m_s: Positive = 0.10
    acceleration_m_s2: Positive = 0.5
    """Gentle: what stands on it stays where it is."""
    plate_near_x_m: float = 0.17
    """Where the plate begins: clear of the robot's chest when the object is pulled towards it."""
    plate_width_m: Positive = 0.20
    """Narrower than what two forearms can hold: they pass by its sides."""

    @property
    def present_ns(self) -> int:
        """From the beginning of `present_stage` until it rises [ns]."""
        return ns_of_s(self.present_s)

    @property
    def lower_ns(self) -> int:
        """From the beginning of `lower_stage` until it lowers away [ns]."""
        return ns_of_s(self.lower_s)

    @property
    def away_ns(self) -> int:
        """How long it stays away [ns]."""
        return ns_of_s(self.away_s)
