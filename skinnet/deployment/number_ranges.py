"""Ranges of numbers in a deployment, by the unit that a key's name ends with.

They hold what arithmetic of the simulator can represent (int64 nanoseconds, int32 counts, squares of floats),
not what is sensible for a robot.
"""

from typing import Any

from skinnet.deployment.documentation import unit_of
from skinnet.errors import DeploymentError

__all__ = ["reject_out_of_range"]

_RANGES = {
    "s": (1e-9, 1e7),
    "ms": (1e-6, 1e10),
    "µs": (1e-3, 1e13),
    "m": (1e-9, 1e4),
    "mm": (1e-6, 1e7),
    "rad": (1e-9, 1e4),
    "°": (1e-9, 1e6),
    "rad/s": (1e-9, 1e4),
    "m/s": (1e-9, 1e4),
    "rad/s²": (1e-9, 1e6),
    "m/s²": (1e-9, 1e6),
    "Hz": (1e-9, 1e6),
    "kg": (1e-6, 1e6),
    "N": (1e-9, 1e6),
    "N·m": (1e-9, 1e9),
    "Pa/m": (1e-9, 1e18),
    "°C": (1e-9, 1e4),
    "bytes": (1, 1e5),
    "bit/s": (1, 1e12),
}
"""Least magnitude of a number that is not zero, and greatest, by unit."""
_OTHER = (1e-12, 1e12)
_COUNT = (1, 1e9)
_SEED = (1, 2**63 - 1)


def reject_out_of_range(value: Any, key: str = "", unit: str | None = None) -> None:
    """Reject numbers that are too large or too small to compute with.

    Numbers in lists, such as vectors, may be as small as they like.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    if isinstance(value, dict):
        for name, item in value.items():
            reject_out_of_range(item, f"{key}.{name}".lstrip("."), unit_of(name) or unit)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            reject_out_of_range(item, f"{key}[{index}]", unit)
    elif isinstance(value, int | float) and not isinstance(value, bool) and value != 0:
        least, greatest = _range(key, value, unit)
        if key.endswith("]"):
            least = 0.0
        if not least <= abs(value) <= greatest:
            zero = "zero or " if least else ""
            raise DeploymentError(
                f"{key} = {value!r}: the magnitude must be {zero}from {least:g} to {greatest:g}"
            )


def _range(key: str, value: float, unit: str | None) -> tuple[float, float]:
    if key == "seed":
        return _SEED
    if unit is None:
        return _COUNT if isinstance(value, int) else _OTHER
    return _RANGES.get(unit, _OTHER)
