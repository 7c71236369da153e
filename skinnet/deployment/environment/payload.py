"""Payload spec: a cylinder held between the robot's arms."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import Name, NonNegative, Positive, Table, Vector3

__all__ = ["PayloadSpec"]


class PayloadSpec(Table, frozen=True, kw_only=True):
    """Cylinder of 140 mm with an elastic sheet of 10 mm, held between the arms [R11, VI.B].

    Before the run, the simulator fixes the cylinder and the arms close on it: each joint of `closing_joints`
    turns in its direction until the sheets beyond it press with `grip_force_n`. The simulator begins to
    release the cylinder `release_delay_s` after the start of the controller's stage `release_stage`.
    """

    position_m: Vector3
    """Initial position of the centre, world frame."""
    axis: Vector3 = (0.0, 0.0, 1.0)
    """Axis of the cylinder, world frame; upright unless given *(assumed)*."""
    diameter_m: Positive = 0.140
    """Diameter without the sheet [R11]."""
    length_m: Positive = 0.30
    """Length of the cylinder *(assumed)*."""
    mass_kg: Positive = 3.0
    """Mass, not given in [R11]; 3 kg was held in the feasibility study."""
    sheet_thickness_m: NonNegative = 0.010
    """Thickness of the elastic sheet [R11]."""
    sheet_stiffness_pa_per_m: Positive = 4.0e6
    """Stiffness of the sheet, in series with the robot's foam: rubber of 40 kPa, 10 mm *(assumed)*."""
    closing_joints: dict[str, Annotated[float, Meta(ge=-1.0, le=1.0)]]
    """Joints that close the arms before the run, each with its signed fraction of `closing_speed_rad_s`."""
    closing_speed_rad_s: Positive = 0.05
    """Speed of a closing joint before contact *(assumed)*."""
    grip_force_n: Positive = 60.0
    """Initial grip force on the sheets of each arm: held in the feasibility study."""
    release_stage: Name = "hold"
    """Stage of the controller in which the simulator releases the cylinder."""
    release_delay_s: NonNegative = 0.1
    """Delay from the start of `release_stage` to the release."""
    release_ramp_s: NonNegative = 0.4
    """Duration of the release ramp, which avoids an impact on the foam *(assumed)*."""
    drop_threshold_m: Positive = 0.10
    """Displacement of the centre relative to the arms that counts as a drop: a third of its length
    *(assumed)*."""
    drop_unsupported_s: Positive = 0.1
    """Time without any contact with the robot that counts as a drop: a free fall of 49 mm *(assumed)*."""

    @property
    def outer_radius_m(self) -> float:
        """Outer radius, with the elastic sheet [m]."""
        return 0.5 * self.diameter_m + self.sheet_thickness_m
