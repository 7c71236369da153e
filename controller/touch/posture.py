"""Postural trajectories: joint velocities towards a pose, equation (5) of [M14, V.B]."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PoseReached", "PoseTarget", "Posture"]


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """A pose to go to."""

    name: str
    """Returned in the event, so that whoever waits knows which pose was reached."""
    position_rad: NDArray[np.float64]
    """(D,): φ_des."""
    speed_rad_s: float = 0.4
    """ω_max: velocity of the joint that is furthest away; 0.4 in free motion [M14, Table II]."""
    accuracy_rad: float = 0.01
    """φ_acc: joints that are not further away than this rest [M14, Table II]."""
    deactivate: bool = False
    """Let the posture go once it is reached, instead of coming back to it when pushed away."""


@dataclass(frozen=True)
class PoseReached:
    """Every joint came within the accuracy of the pose `name`; sent once per target."""

    name: str
    t_ns: int


class Posture:
    """Drives towards the newest target."""

    def __init__(self) -> None:
        """Starts without a target: at rest."""
        self._target: PoseTarget | None = None
        self._announced = False

    @property
    def active(self) -> bool:
        """There is a target that is still driven to or held."""
        return self._target is not None

    def go(self, target: PoseTarget) -> None:
        """Takes a new target, which will be announced once when it is reached.

        Raises:
            ValueError: speed or accuracy is not positive, or the pose is not finite.
        """
        if not (
            target.speed_rad_s > 0.0 and target.accuracy_rad > 0.0 and np.isfinite(target.position_rad).all()
        ):
            raise ValueError(f"pose {target.name!r}: speed and accuracy must be positive, positions finite")
        self._target, self._announced = target, False

    def release(self) -> None:
        """Forgets the target."""
        self._target = None

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], PoseReached | None]:
        """Joint velocities (D,) [rad/s] at the measured positions (D,), and the event on arrival."""
        target = self._target
        if target is None:
            return np.zeros(len(position_rad)), None
        way = target.position_rad - position_rad
        far = np.abs(way) > target.accuracy_rad
        if far.any():
            return target.speed_rad_s * way * far / np.abs(way).max(), None
        event = None if self._announced else PoseReached(target.name, t_ns)
        self._announced = True
        if target.deactivate:
            self._target = None
        return np.zeros(len(position_rad)), event
