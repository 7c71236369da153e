"""Stage spec: one step of the controller's program."""

from typing import Literal

from skinnet.deployment.types import NonNegative, Positive, Table

__all__ = ["StageSpec"]


class StageSpec(Table, frozen=True, kw_only=True):
    """Stage of the controller's program."""

    kind: Literal["structure", "map", "posture", "guide", "passive", "teach_and_grasp"]
    """Explorations, posture, tactile guidance, no motion, or teaching and grasping."""
    duration_s: Positive | None = None
    """Duration; required for `guide` and `passive`."""
    force_gain: NonNegative = 0.0
    """Velocity per reading of force above the threshold, for `guide`."""
    force_threshold: NonNegative = 0.05
    """Reading of force above which a cell reacts, for `guide`."""
    proximity_gain: NonNegative = 0.0
    """Velocity per reading of proximity above the threshold, for `guide`."""
    proximity_threshold: NonNegative = 0.01
    """Reading of proximity above which a cell reacts, for `guide`."""
    pose: str = "home"
    """Target of `posture`: "home" or a pose of `controller.poses_rad`."""
    speed_rad_s: Positive = 0.4
    """Speed limit of each joint, for `posture`."""
    tolerance_rad: Positive = 0.01
    """Goal tolerance of each joint, for `posture`."""
