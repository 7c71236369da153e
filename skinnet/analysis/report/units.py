"""Units and labels parsed from metric names, and text of metric values.

Metrics carry their units in their names (`latency_ms.p50`, `peak_force_n`), so a new metric needs no entry
here.
"""

import math
from typing import Any, NamedTuple

__all__ = ["Quantity", "format_number", "format_value", "parse_quantity"]

_UNITS = {
    "c": "°C",
    "deg": "°",
    "g": "g",
    "hz": "Hz",
    "kg": "kg",
    "kpa": "kPa",
    "m": "m",
    "mb": "MB",
    "mm": "mm",
    "ms": "ms",
    "n": "N",
    "ns": "ns",
    "ohm": "Ω",
    "rad": "rad",
    "s": "s",
    "us": "µs",
    "v": "V",
}
_RATES = {"rad": "rad/s", "m": "m/s", "per": "1/s"}
"""Rate units by the word before a last `s`."""
_SEGMENT_UNITS = {
    "cores": "cores",
    "cpu": "CPU s per s",
    "delta_sigmas": "σ",
    "fraction": "%",
    "rtf": "× real time",
    "sign_agreement": "%",
}
"""Units of segments that are a quantity without a unit suffix."""
_ABBREVIATIONS = {
    "cop": "centre of pressure",
    "cpu": "CPU",
    "dev": "deviation",
    "dof": "DoF",
    "rtf": "speed",
    "sim": "simulated time",
}
"""Abbreviations in names, written out."""
_SPACE = "\u202f"
_GROUP_DIGITS_FROM = 1e4
_SCIENTIFIC_BELOW = 1e-3


class Quantity(NamedTuple):
    """Quantity of a metric: label, unit, and the scale factor that converts values to the unit."""

    label: str
    unit: str
    scale: float = 1.0


def parse_quantity(name: str) -> Quantity:
    """Quantity of a dotted metric name without its group and statistic."""
    words, unit = [], ""
    for segment in name.split("."):
        known = _SEGMENT_UNITS.get(segment)
        label, found = (segment.split("_"), known) if known else _split(segment)
        unit = unit or found
        words.append(" ".join(_ABBREVIATIONS.get(word, word) for word in label))
    return Quantity(", ".join(word for word in words if word), unit, 100.0 if unit == "%" else 1.0)


def _split(segment: str) -> tuple[list[str], str]:
    """Words of a segment, and the unit of its suffix."""
    words = segment.split("_")
    if len(words) > 1 and words[-1] == "s" and words[-2] in _RATES:
        return words[:-2], _RATES[words[-2]]
    if len(words) > 1 and words[-1] in _UNITS:
        return words[:-1], _UNITS[words[-1]]
    return words, ""


def format_value(value: Any, scale: float = 1.0) -> str:
    """Text of a metric value: floats to four digits, thousands separated, yes or no, lists by comma."""
    match value:
        case bool():
            return "yes" if value else "no"
        case int() | float():
            return format_number(value if scale == 1.0 else value * scale)
        case None | "":
            return "–"
        case list() | tuple():
            return ", ".join(format_value(item, scale) for item in value) or "none"
        case _:
            return str(value)


def format_number(value: float) -> str:
    """Text of a number: integers in full, others to four significant digits."""
    if isinstance(value, int) or abs(value) >= _GROUP_DIGITS_FROM:
        if not math.isfinite(value):
            return str(value)
        text = f"{value:,.0f}" if abs(value) >= _GROUP_DIGITS_FROM else str(value)
        return _minus(text.replace(",", _SPACE))
    if value and abs(value) < _SCIENTIFIC_BELOW:
        digits, _, exponent = f"{value:.2e}".partition("e")
        return _minus(f"{digits} × 10{_superscript(int(exponent))}")
    return _minus(f"{value:.4g}")


def _superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _minus(text: str) -> str:
    return text.replace("-", "−")
