"""A robot of two joints and a few cells, as the raw tables of a deployment: what tests of the core run on."""

from typing import Any

from locations import DEPLOYMENTS

from skinnet.deployment import Deployment
from skinnet.deployment.load import from_document
from skinnet.migration.deployments import FORMAT

SHIPPED = DEPLOYMENTS / "hrp2_touch.toml"


def lattice(columns: int, rows: int, **more: Any) -> dict[str, Any]:
    return {
        "columns": columns,
        "rows": rows,
        "origin_m": (0.0, 0.0, 0.0),
        "normal": (0.0, 0.0, 1.0),
        "up": (0.0, 1.0, 0.0),
    } | more


def patch(name: str, columns: int = 3, rows: int = 2, *interfaces: tuple[int, int]) -> dict[str, Any]:
    ends = [{"cell": cell, "port": port} for cell, port in interfaces or ((0, 2),)]
    return {"name": name, "body": name, "lattice": lattice(columns, rows), "interfaces": ends}


def small(*patches: dict[str, Any], **tables: Any) -> Deployment:
    """A deployment with `tables` in the place of its own; it may break the rules that `check` knows."""
    raw = {
        "format": FORMAT,
        "name": "small",
        "robot": "bot",
        "body": {"model": "none", "reference_body": "base", "joints": ("elbow", "wrist")},
        "patches": patches or (patch("arm"), patch("hand", 2, 1)),
        "controller": {"program": ("home",), "stages": {"home": {"kind": "posture"}}},
    }
    for table, value in tables.items():
        own = raw.get(table)
        raw[table] = own | value if isinstance(own, dict) and isinstance(value, dict) else value
    return from_document(raw, "small")
