"""Posture control: joint velocities towards a pose, equation (5) of [M14, V.B]."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PoseReached", "PoseTarget", "PostureControl"]


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """Target pose with speed and accuracy."""

    name: str
    """Name of the pose, repeated in `PoseReached`."""
    position_rad: NDArray[np.float64]
    """Desired joint positions (D,): φ_des."""
    speed_rad_s: float = 0.4
    """Velocity ω_max of the joint with the largest error; 0.4 in free motion [M14, Table II]."""
    tolerance_rad: float = 0.01
    """Position tolerance φ_acc: joints within it rest [M14, Table II]."""
    release_when_reached: bool = False
    """Release the target once it is reached, instead of returning to it when pushed away."""


@dataclass(frozen=True)
class PoseReached:
    """Completion event: all joints are within the accuracy of pose `name`; once per target."""

    name: str
    t_ns: int


class PostureControl:
    """Posture controller towards the newest target pose."""

    def __init__(self) -> None:
        """Start at rest, without a target."""
        self._target: PoseTarget | None = None
        self._completion_reported = False

    @property
    def active(self) -> bool:
        """True while a target is approached or held."""
        return self._target is not None

    def set_target(self, target: PoseTarget) -> None:
        """Set a new target; its completion is reported once.

        Raises:
            ValueError: speed or accuracy is not positive, or the pose is not finite.
        """
        if not (
            target.speed_rad_s > 0.0 and target.tolerance_rad > 0.0 and np.isfinite(target.position_rad).all()
        ):
            raise ValueError(f"pose {target.name!r}: speed and accuracy must be positive, positions finite")
        self._target, self._completion_reported = target, False

    def clear_target(self) -> None:
        """Clear the target."""
        self._target = None

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], PoseReached | None]:
        """Compute joint velocities (D,) [rad/s] from measured positions (D,), and the completion event."""
        target = self._target
        if target is None:
            return np.zeros(len(position_rad)), None
        way = target.position_rad - position_rad
        far = np.abs(way) > target.tolerance_rad
        if far.any():
            return target.speed_rad_s * way * far / np.abs(way).max(), None
        event = None if self._completion_reported else PoseReached(target.name, t_ns)
        self._completion_reported = True
        if target.release_when_reached:
            self._target = None
        return np.zeros(len(position_rad)), event
