"""Field types of the deployment schema, and the frozen base class of its tables."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

__all__ = [
    "Encoding",
    "Fraction",
    "LevelThresholds",
    "Name",
    "NonNegative",
    "Positive",
    "StageName",
    "Table",
    "Vector3",
    "ns_of_ms",
    "ns_of_s",
]

Positive = Annotated[float, Meta(gt=0.0)]
NonNegative = Annotated[float, Meta(ge=0.0)]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+(?!\n)$", min_length=1, max_length=64)]
StageName = Annotated[
    str, Meta(pattern=r"^[A-Za-z0-9_\-]+(\.[A-Za-z0-9_\-]+)?(?!\n)$", min_length=1, max_length=129)
]
"""Stage of the program, or with a dot one of its states: "stage.state"."""
Vector3 = tuple[float, float, float]
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
LevelThresholds = Annotated[tuple[float, ...], Meta(min_length=1, max_length=4)]
"""Thresholds of one modality: at most four, as in Table I [M14]."""
Encoding = Literal["level_crossing", "send_on_delta", "periodic"]
"""Event encoding of readings: on crossing a level, on a change by more than a threshold, or every period."""


def ns_of_ms(value_ms: float) -> int:
    """Convert milliseconds to integer nanoseconds."""
    return round(value_ms * 1e6)


def ns_of_s(value_s: float) -> int:
    """Convert seconds to integer nanoseconds."""
    return round(value_s * 1e9)


class Table(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """TOML table as a frozen struct that rejects unknown keys."""
