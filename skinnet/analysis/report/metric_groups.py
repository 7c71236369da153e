"""Metric groups for display: metrics by subject, statistics of one quantity in one row."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from skinnet.analysis.report.units import format_value, parse_quantity

__all__ = ["MetricGroup", "QuantityRow", "group_metrics", "group_over_seeds"]

_STATISTICS = ("", "start", "p50", "p99", "p999", "min", "max", "peak", "end")
"""Statistics, as the last segment of a metric's name; the empty one is the quantity itself."""
_SEED_STATISTICS = ("least", "median", "greatest")
_TITLES = {
    "": "The sweep",
    "periodic": "Periodic (clock-driven), all cells",
    "contact": "Contact",
    "send_on_delta": "Send-on-delta, all cells",
    "delta_sigmas": "Send-on-delta thresholds, in multiples of the noise",
    "formation": "Network formation",
    "grasp": "Grasp",
    "guidance": "Guidance by a held force",
    "level_crossing": "Level crossing, all cells",
    "nearest": "Thresholds nearest to the published rates",
    "network": "Packets",
    "noise": "Noise of the sensors",
    "power": "Power",
    "proximity": "Approaches under proximity guidance",
    "published": "Published",
    "object": "Object, true motion and contacts",
    "reaction": "Reactions, from the stimulus to the command in effect and the first motion",
    "recovery": "Recovery from faults",
    "teach_and_grasp": "Teaching and grasping",
    "size": "Sizes and rates of the deployment",
    "smm": "Sensory-motor map",
    "structure": "Structural exploration",
}


@dataclass(frozen=True)
class QuantityRow:
    """Quantity of a group: dotted name with the group's, label, unit, and texts by statistic."""

    name: str
    label: str
    unit: str
    texts: dict[str, str]


@dataclass
class MetricGroup:
    """Group of quantities: those with a single value, and those with several statistics."""

    key: str
    title: str
    values: list[QuantityRow] = field(default_factory=list)
    statistics: list[QuantityRow] = field(default_factory=list)

    @property
    def columns(self) -> list[str]:
        """Statistics present in any row, in order."""
        used = {name for row in self.statistics for name in row.texts}
        return [name for name in (*_STATISTICS, *_SEED_STATISTICS) if name in used]


def group_metrics(metrics: dict[str, Any], titles: dict[str, str] | None = None) -> list[MetricGroup]:
    """Group metrics, in the order of their first occurrence; `titles` by group key precede the usual ones."""
    stems: dict[tuple[str, str], dict[str, Any]] = {}
    for name, value in metrics.items():
        key, rest = _split_group(name)
        stem, _, last = rest.rpartition(".")
        if not stem or last not in _STATISTICS:
            stem, last = rest, ""
        stems.setdefault((key, stem), {})[last] = value
    found: dict[str, MetricGroup] = {}
    for (key, stem), values in stems.items():
        group = _group(found, key, titles)
        if len(values) > 1:
            group.statistics.append(_row(key, stem, stem, values))
        else:
            (last,) = values
            group.values.append(_row(key, stem, f"{stem}.{last}" if last else stem, {"": values[last]}))
    return list(found.values())


def group_over_seeds(
    runs: Sequence[dict[str, Any]], titles: dict[str, str] | None = None
) -> list[MetricGroup]:
    """Group the metrics of several runs: least, median and greatest of numbers, counts of other values."""
    found: dict[str, MetricGroup] = {}
    for name in dict.fromkeys(name for metrics in runs for name in metrics):
        values = [metrics[name] for metrics in runs if metrics.get(name) is not None]
        key, stem = _split_group(name)
        group = _group(found, key, titles)
        if values and all(_is_number(value) for value in values):
            told = {"least": min(values), "median": median(values), "greatest": max(values)}
            group.statistics.append(_row(key, stem, stem, told))
        else:
            counts = Counter(map(format_value, values))
            text = ", ".join(f"{value}: {count}" for value, count in counts.most_common())
            group.values.append(_row(key, stem, stem, {"": text}))
    return list(found.values())


def _split_group(name: str) -> tuple[str, str]:
    key, dot, rest = name.partition(".")
    return (key, rest) if dot else ("", name)


def _group(found: dict[str, MetricGroup], key: str, titles: dict[str, str] | None) -> MetricGroup:
    title = (titles or {}).get(key) or _TITLES.get(key) or key.replace("_", " ").capitalize()
    return found.setdefault(key, MetricGroup(key, title))


def _row(key: str, stem: str, name: str, values: dict[str, Any]) -> QuantityRow:
    """Row of a quantity; a single statistic becomes part of the label."""
    meant = parse_quantity(stem)
    label = meant.label if name == stem else f"{meant.label}, {name.rpartition('.')[2]}"
    measured = any(_is_number(item) for value in values.values() for item in _items(value))
    texts = {statistic: format_value(value, meant.scale) for statistic, value in values.items()}
    return QuantityRow(f"{key}.{name}".lstrip("."), label, meant.unit if measured else "", texts)


def _items(value: Any) -> Sequence[Any]:
    return value if isinstance(value, list | tuple) else (value,)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
