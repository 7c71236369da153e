"""Field types of the deployment schema, and the frozen base class of its tables."""

from typing import Annotated

from msgspec import Meta, Struct

__all__ = [
    "CellName",
    "Fraction",
    "LevelThresholds",
    "Name",
    "NonNegative",
    "PortName",
    "Positive",
    "StageName",
    "Table",
    "Vector3",
    "ns_of_ms",
    "ns_of_s",
    "parse_port",
]

Positive = Annotated[float, Meta(gt=0.0)]
NonNegative = Annotated[float, Meta(ge=0.0)]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+$", min_length=1, max_length=64)]
StageName = Annotated[
    str, Meta(pattern=r"^[A-Za-z0-9_\-]+(\.[A-Za-z0-9_\-]+)?$", min_length=1, max_length=129)
]
"""Stage of the program, or with a dot one of its states: "stage.state"."""
Vector3 = tuple[float, float, float]
CellName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+/[0-9]+$")]
"""Cell: "patch/cell"."""
PortName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+/[0-9]+:[0-3]$")]
"""Port of a cell: "patch/cell:port"."""
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
LevelThresholds = Annotated[tuple[float, ...], Meta(min_length=1, max_length=4)]
"""Thresholds of one modality: at most four, as in Table I [M14]."""


def ns_of_ms(value_ms: float) -> int:
    """Convert milliseconds to integer nanoseconds."""
    return round(value_ms * 1e6)


def ns_of_s(value_s: float) -> int:
    """Convert seconds to integer nanoseconds."""
    return round(value_s * 1e9)


def parse_port(name: str) -> tuple[str, int, int]:
    """Split a `PortName` into patch, cell and port."""
    patch, _, place = name.partition("/")
    cell, _, port = place.partition(":")
    return patch, int(cell), int(port)


class Table(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """TOML table as a frozen struct that rejects unknown keys."""
