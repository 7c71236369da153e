"""Findings: properties of a valid deployment that spoil a run, or that its author should know."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["SEVERITIES", "Code", "Finding", "Severity", "as_documents", "has_errors", "in_order", "listed"]

Severity = Literal["error", "warning", "remark"]
Code = Literal[
    "axis_along_gravity",
    "base_drift",
    "cells_buried",
    "cells_intruded",
    "cells_off_drawn",
    "cells_off_surface",
    "cells_overlap",
    "cells_pressed",
    "cells_unreached",
    "contacts_disabled",
    "energy_grows",
    "foam_curve",
    "free_base",
    "gravity_tilted",
    "gravity_zero",
    "hull_gap",
    "joint_drift",
    "limit_near_home",
    "links_collide",
    "margins_cleared",
    "mesh_inward",
    "mesh_open",
    "passive_joint_drift",
    "servo_oscillates",
    "servo_overloaded",
    "servo_sags",
    "servo_slow",
    "servo_yields",
    "skin_without_contact",
    "speed",
    "unstable",
]
"""Kinds of findings, constant over versions."""

SEVERITIES: tuple[Severity, ...] = ("error", "warning", "remark")
"""Severities, the worst first: the run cannot give what it is asked for; part of its results is spoiled; good
to know."""
_N_LISTED = 4


@dataclass(frozen=True)
class Finding:
    """Finding of the diagnosis.

    Attributes:
        severity: "error", "warning" or "remark".
        code: Kind of finding.
        subject: Body, joint, patch or key concerned.
        text: Observation with its figures, one line.
        mend: Remedy, one line.
        cells: Names "patch/cell" of the cells concerned.
    """

    severity: Severity
    code: Code
    subject: str
    text: str
    mend: str
    cells: tuple[str, ...] = ()


def in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings by severity, the worst first, else as they come."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def has_errors(findings: Iterable[Finding]) -> bool:
    """True if a finding is an error."""
    return any(finding.severity == "error" for finding in findings)


def as_documents(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Findings as JSON objects, with the names of their fields."""
    return [{**vars(finding), "cells": list(finding.cells)} for finding in findings]


def listed(names: Sequence[str]) -> str:
    """Names in one line: the first few, and the number of the others."""
    if len(names) <= _N_LISTED + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_N_LISTED])} and {len(names) - _N_LISTED} more"
