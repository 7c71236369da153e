"""An object in the robot's arms, as a deployment describes it."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.table import Name, NonNegative, Positive, Table, Vector

__all__ = ["PayloadSpec"]


class PayloadSpec(Table, frozen=True, kw_only=True):
    """A cylinder of 140 mm with an elastic sheet of 10 mm, held between the arms [R11, VI.B].

    Before the run begins, the world holds it in its place and the arms close on it: each joint of
    `closing` turns, in the direction of its number, until the sheets beyond it press with `grip_n`. The world
    begins to let go `release_s` after the controller's stage `release_stage` began.
    """

    position_m: Vector
    """Its middle in the beginning, world frame."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Of the cylinder, world frame; upright unless given *(assumed)*."""
    diameter_m: Positive = 0.140
    """Without the sheet [R11]."""
    length_m: Positive = 0.30
    """*(assumed)*"""
    mass_kg: Positive = 3.0
    """Not given in the paper; 3 kg was held in the feasibility study."""
    sheet_thickness_m: NonNegative = 0.010
    """Of the elastic sheet around it [R11]."""
    sheet_stiffness_pa_per_m: Positive = 4.0e6
    """Of that sheet, in series with the robot's foam: rubber foam of 40 kPa, 10 mm thick *(assumed)*."""
    closing: dict[str, Annotated[float, Meta(ge=-1.0, le=1.0)]]
    """Joints that close the arms in the beginning, with the direction and its share of `closing_rad_s`."""
    closing_rad_s: Positive = 0.05
    """Speed of a closing joint that does not feel anything yet *(assumed)*."""
    grip_n: Positive = 60.0
    """Force of each arm's sheets in the beginning: held in the feasibility study."""
    release_stage: Name = "hold"
    release_s: NonNegative = 0.1
    easing_s: NonNegative = 0.4
    """For so long it is let go gently, so that it sinks into the foam without a jolt *(assumed)*."""
    fallen_m: Positive = 0.15
    """It counts as dropped when its middle is so far below where it was released *(assumed)*."""

    @property
    def radius_m(self) -> float:
        """Of the face of the elastic sheet [m]."""
        return 0.5 * self.diameter_m + self.sheet_thickness_m
