"""Stage spec: one step of the controller's program."""

from typing import Literal

from skinnet.deployment.types import NonNegative, Positive, Table

__all__ = ["StageSpec"]


class StageSpec(Table, frozen=True, kw_only=True):
    """Stage of the controller's program."""

    kind: Literal["structure", "map", "posture", "guide", "passive", "teach_and_grasp"]
    duration_s: Positive | None = None
    force_gain: NonNegative = 0.0
    force_threshold: NonNegative = 0.05
    proximity_gain: NonNegative = 0.0
    proximity_threshold: NonNegative = 0.01
    pose: str = "home"
    speed_rad_s: Positive = 0.4
    tolerance_rad: Positive = 0.01
