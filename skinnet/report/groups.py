"""Metric groups for display: metrics by subject, statistics of one quantity in one row."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from skinnet.report.units import quantity, shown

__all__ = ["Group", "Row", "groups", "spread"]

_STATISTICS = ("", "start", "p50", "p99", "p999", "min", "max", "peak", "end")
"""Statistics, as the last segment of a metric's name; the empty one is the quantity itself."""
_SPREAD = ("least", "median", "greatest")
_TITLES = {
    "": "The sweep",
    "clock": "Clock-driven, all cells",
    "contact": "Contact",
    "delta": "Send-on-delta, all cells",
    "delta_sigmas": "Deltas, in multiples of the noise",
    "formation": "Network formation",
    "grasp": "Grasp",
    "guidance": "Guidance by a held force",
    "levels": "Levels, all cells",
    "nearest": "Deltas nearest to what was published",
    "network": "Packets",
    "noise": "Noise of the sensors",
    "power": "Power",
    "proximity": "Approaches under proximity guidance",
    "published": "Published",
    "reaction": "Reactions, from the stimulus to the command in effect",
    "recovery": "Recovery from faults",
    "session": "Session",
    "size": "Size and rates, as deployed",
    "smm": "Sensory-motor map",
    "structure": "Structural exploration",
}


@dataclass(frozen=True)
class Row:
    """Quantity of a group: dotted name with the group's, label, unit, and texts by statistic."""

    name: str
    label: str
    unit: str
    texts: dict[str, str]


@dataclass
class Group:
    """Group of quantities: those with a single value, and those with several statistics."""

    key: str
    title: str
    values: list[Row] = field(default_factory=list)
    statistics: list[Row] = field(default_factory=list)

    @property
    def columns(self) -> list[str]:
        """Statistics present in any row, in order."""
        used = {name for row in self.statistics for name in row.texts}
        return [name for name in (*_STATISTICS, *_SPREAD) if name in used]


def groups(figures: dict[str, Any], titles: dict[str, str] | None = None) -> list[Group]:
    """Group metrics, in the order of their first occurrence; `titles` by group key precede the usual ones."""
    stems: dict[tuple[str, str], dict[str, Any]] = {}
    for name, value in figures.items():
        key, rest = _parted(name)
        stem, _, last = rest.rpartition(".")
        if not stem or last not in _STATISTICS:
            stem, last = rest, ""
        stems.setdefault((key, stem), {})[last] = value
    found: dict[str, Group] = {}
    for (key, stem), values in stems.items():
        group = _group(found, key, titles)
        if len(values) > 1:
            group.statistics.append(_row(key, stem, stem, values))
        else:
            (last,) = values
            group.values.append(_row(key, stem, f"{stem}.{last}" if last else stem, {"": values[last]}))
    return list(found.values())


def spread(runs: Sequence[dict[str, Any]], titles: dict[str, str] | None = None) -> list[Group]:
    """Group the metrics of several runs: least, median and greatest of numbers, counts of other values."""
    found: dict[str, Group] = {}
    for name in dict.fromkeys(name for figures in runs for name in figures):
        values = [figures[name] for figures in runs if figures.get(name) is not None]
        key, stem = _parted(name)
        group = _group(found, key, titles)
        if values and all(_is_number(value) for value in values):
            told = {"least": min(values), "median": median(values), "greatest": max(values)}
            group.statistics.append(_row(key, stem, stem, told))
        else:
            counts = Counter(map(shown, values))
            text = ", ".join(f"{value}: {count}" for value, count in counts.most_common())
            group.values.append(_row(key, stem, stem, {"": text}))
    return list(found.values())


def _parted(name: str) -> tuple[str, str]:
    key, dot, rest = name.partition(".")
    return (key, rest) if dot else ("", name)


def _group(found: dict[str, Group], key: str, titles: dict[str, str] | None) -> Group:
    title = (titles or {}).get(key) or _TITLES.get(key) or key.replace("_", " ").capitalize()
    return found.setdefault(key, Group(key, title))


def _row(key: str, stem: str, name: str, values: dict[str, Any]) -> Row:
    """Row of a quantity; a single statistic becomes part of the label."""
    meant = quantity(stem)
    label = meant.label if name == stem else f"{meant.label}, {name.rpartition('.')[2]}"
    measured = any(_is_number(item) for value in values.values() for item in _items(value))
    texts = {statistic: shown(value, meant.scale) for statistic, value in values.items()}
    return Row(f"{key}.{name}".lstrip("."), label, meant.unit if measured else "", texts)


def _items(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list | tuple) else (value,)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
