"""What the tables of a deployment are made of: the frozen base, and types that say what is allowed."""

from typing import Annotated

from msgspec import Meta, Struct

__all__ = [
    "CellName",
    "Levels",
    "Name",
    "NonNegative",
    "PortName",
    "Positive",
    "Share",
    "StageName",
    "Table",
    "Vector",
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
"""A stage of the program, or with a dot one of the states that a stage goes through."""
Vector = tuple[float, float, float]
CellName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+/[0-9]+$")]
"""A cell: "patch/cell"."""
PortName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_\-]+/[0-9]+:[0-3]$")]
"""A port of a cell: "patch/cell:port"."""
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Levels = Annotated[tuple[float, ...], Meta(min_length=1, max_length=4)]
"""Thresholds of one modality: as many as Table I [M14] has, or fewer."""


def ns_of_ms(value_ms: float) -> int:
    """Integer nanoseconds of a time in milliseconds."""
    return round(value_ms * 1e6)


def ns_of_s(value_s: float) -> int:
    """Integer nanoseconds of a time in seconds."""
    return round(value_s * 1e9)


def parse_port(name: str) -> tuple[str, int, int]:
    """Patch, cell and port of a `PortName`."""
    patch, _, place = name.partition("/")
    cell, _, port = place.partition(":")
    return patch, int(cell), int(port)


class Table(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A TOML table: unknown keys are refused."""
