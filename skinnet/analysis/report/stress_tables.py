"""Tables of a stress test: points, send-on-delta thresholds, and every metric of every point."""

from dataclasses import replace
from typing import Any

from skinnet.analysis.report.html_blocks import metric_cards
from skinnet.analysis.report.markup import Html, join, tag
from skinnet.analysis.report.metric_groups import MetricGroup, group_metrics
from skinnet.analysis.report.run_folder import StressResults
from skinnet.analysis.report.units import format_value, parse_quantity

__all__ = ["belongs_to_point", "is_threshold", "point_metrics", "points_table", "thresholds_table"]

_COLUMNS = (
    ("packets_per_s", "packets/s"),
    ("fraction.packets", "share"),
    ("bytes_per_s", "bytes/s"),
    ("fraction.bytes", "share"),
    ("dropped", "dropped"),
    ("missing", "missing"),
    ("latency_us.p99", "model 99 % [µs]"),
    ("machine_us.p99", "transit 99 % [µs]"),
    ("cpu.controller", "controller [CPU s/s]"),
    ("cpu.all", "all [CPU s/s]"),
    ("rtf", "× real time"),
)
_MODALITIES = (("force", ""), ("proximity", ""), ("acceleration", "g"), ("temperature", "°C"))
_THRESHOLDS = (("delta", "delta"), ("noise", "noise and quantisation"), ("delta_sigmas", "ratio"))


def is_threshold(name: str) -> bool:
    """Test whether a metric belongs to the table of thresholds."""
    key, _, rest = name.partition(".")
    return key in dict(_THRESHOLDS) and rest in dict(_MODALITIES)


def belongs_to_point(name: str, stress: StressResults) -> bool:
    """Test whether a metric belongs to a single point; names of points have dots in them."""
    return any(name.startswith(f"{point}.") for point in stress.summary.points)


def points_table(stress: StressResults) -> Html:
    """Table of points, in the order in which they ran."""
    rows = []
    for name in stress.summary.points:
        own = _metrics_of(stress, name)
        cells = [
            tag(
                "td",
                format_value(own.get(key), parse_quantity(key).scale) + _percent(key, own),
                class_="number",
            )
            for key, _ in _COLUMNS
        ]
        why = stress.summary.failed.get(name)
        rows.append(
            tag("tr", tag("th", name, scope="row"), *cells)
            if why is None
            else tag("tr", tag("th", name, scope="row"), tag("td", f"failed: {why}", colspan=len(_COLUMNS)))
        )
    return _table(("point", *(title for _, title in _COLUMNS)), rows)


def thresholds_table(stress: StressResults) -> Html | None:
    """Table of send-on-delta thresholds beside the noise of their sensors."""
    rows = []
    for modality, unit in _MODALITIES:
        values = [stress.metrics.get(f"{key}.{modality}") for key, _ in _THRESHOLDS]
        if any(value is not None for value in values):
            units = (unit, unit, "σ")
            texts = (f"{format_value(v)} {u}".rstrip() for v, u in zip(values, units, strict=True))
            cells = (tag("td", text, class_="number") for text in texts)
            rows.append(tag("tr", tag("th", modality, scope="row"), *cells))
    if not rows:
        return None
    return _table(("thresholds of send-on-delta", *(title for _, title in _THRESHOLDS)), rows)


def point_metrics(stress: StressResults) -> Html:
    """Metrics of every point, one collapsible block for each."""
    folds = []
    for name in stress.summary.points:
        own = _metrics_of(stress, name)
        if own:
            head = tag("summary", tag("code", name), tag("span", f"{len(own)} metrics", class_="count"))
            folds.append(
                tag("details", head, tag("div", metric_cards(_metric_groups(name, own)), class_="inside"))
            )
    return join(*folds)


def _metrics_of(stress: StressResults, point: str) -> dict[str, Any]:
    prefix = f"{point}."
    return {
        name.removeprefix(prefix): value for name, value in stress.metrics.items() if name.startswith(prefix)
    }


def _metric_groups(point: str, own: dict[str, Any]) -> list[MetricGroup]:
    """Metric groups of a point: those of the skin, and those of the computer."""
    parted: dict[str, dict[str, Any]] = {"skin": {}, "machine": {}}
    for name, value in own.items():
        kind = "machine" if name.partition(".")[0] in _COMPUTER_METRICS else "skin"
        parted[kind][f"{point.replace('.', '_')}.{name}"] = value
    return [
        replace(group, key="", title=title.capitalize())
        for title, metrics in parted.items()
        for group in group_metrics(metrics)
    ]


_COMPUTER_METRICS = frozenset(
    {"cores", "cpu", "machine_us", "others_cores", "peak_mb", "rtf", "zenoh_bytes_per_s"}
)


def _percent(key: str, own: dict[str, Any]) -> str:
    return "\u202f%" if parse_quantity(key).unit == "%" and key in own else ""


def _table(heads: tuple[str, ...], rows: list[Html]) -> Html:
    head = (tag("th", name, scope="col", class_="number" if i else None) for i, name in enumerate(heads))
    table = tag("table", tag("thead", tag("tr", *head)), tag("tbody", *rows), class_="wide")
    return tag("div", tag("div", table, class_="scroll", tabindex=0), class_="card block")
