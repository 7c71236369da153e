"""Exploration specs: kinematic structure and sensory-motor map."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import NonNegative, Positive, Table

__all__ = ["MapExplorationSpec", "StructureExplorationSpec"]


class StructureExplorationSpec(Table, frozen=True, kw_only=True):
    """Structural exploration, with the timing of [M14, VI.A]."""

    step_rad: Positive = 0.1
    speed_rad_s: Positive = 1.0
    settle_s: NonNegative = 0.5
    averaging_s: Positive = 1.0
    threshold_g: Positive = 0.01


class MapExplorationSpec(Table, frozen=True, kw_only=True):
    """Sensory-motor map exploration by velocity sines of 0.3 rad/s (frequency: docs/assumptions.md)."""

    amplitude_rad_s: Positive = 0.3
    frequency_hz: Positive = 4.0
    periods: Annotated[int, Meta(ge=1)] = 4
    settle_s: NonNegative = 0.3
    min_row_norm: NonNegative = 0.05
    """Norm of a map row below which its cell counts as immobile along its normal."""
