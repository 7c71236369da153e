"""Exploration specs: kinematic structure and sensory-motor map."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import NonNegative, Positive, Table

__all__ = ["MapExplorationSpec", "StructureExplorationSpec"]


class StructureExplorationSpec(Table, frozen=True, kw_only=True):
    """Structural exploration, with the timing of [M14, VI.A]."""

    step_rad: Positive = 0.1
    """Step of each joint."""
    speed_rad_s: Positive = 1.0
    """Speed of the step."""
    settle_s: NonNegative = 0.5
    """Settling time after each step."""
    averaging_s: Positive = 1.0
    """Averaging time of the accelerations, before and after each step."""
    threshold_g: Positive = 0.01
    """Change of the normalised gravity vector above which a cell has moved."""


class MapExplorationSpec(Table, frozen=True, kw_only=True):
    """Sensory-motor map exploration by velocity sines of 0.3 rad/s (frequency: docs/assumptions.md)."""

    amplitude_rad_s: Positive = 0.3
    """Amplitude of the velocity sine of each joint."""
    frequency_hz: Positive = 4.0
    """Frequency of the sine."""
    tilt_frequency_hz: Positive | None = None
    """Frequency of a second sine of each joint, by which the tilt of gravity is removed; it stays unless
    given."""
    periods: Annotated[int, Meta(ge=1)] = 4
    """Number of measured periods per joint."""
    settle_s: NonNegative = 0.3
    """Settling time before each sine."""
    min_row_norm: NonNegative = 0.05
    """Norm of a map row below which its cell counts as immobile along its normal."""
    min_lever_m: Positive = 0.005
    """Lever arm above which the acceleration of a cell tells that a joint moves it, where gravity does not
    *(assumed)*."""

    def __post_init__(self) -> None:
        """Refuse equal frequencies.

        Raises:
            ValueError: both sines have the same frequency.
        """
        if self.tilt_frequency_hz == self.frequency_hz:
            raise ValueError(
                f"tilt_frequency_hz is that of the first sine, {self.frequency_hz} Hz; give another, such as "
                f"{self.frequency_hz / 2} Hz"
            )
