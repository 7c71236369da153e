"""HTML blocks of a report: metric tables, comparison with papers, pictures, the deployment."""

import base64
import re
from collections.abc import Iterable, Sequence
from typing import Any

from skinnet.analysis.report.claims import ClaimComparison, Verdict
from skinnet.analysis.report.markup import Html, join, tag
from skinnet.analysis.report.metric_groups import MetricGroup, QuantityRow
from skinnet.analysis.report.papers import SOURCES
from skinnet.analysis.report.pictures import Picture
from skinnet.analysis.report.run_folder import RunFiles
from skinnet.analysis.report.toml_listing import Line, sections
from skinnet.analysis.report.units import format_value

__all__ = [
    "comparison_table",
    "deployment_listing",
    "flatten",
    "gallery",
    "metric_cards",
    "pairs_table",
    "picture_block",
    "section",
    "verdict_badge",
]

_BADGES = {
    Verdict.WITHIN: ("good", "✓ within"),
    Verdict.OUTSIDE: ("bad", "✗ outside"),
    Verdict.NO_EXPECTATION: ("plain", "no expectation"),
    Verdict.UNMEASURED: ("plain", "not measured"),
    Verdict.SETTING: ("plain", "setting"),
}
_SPACE_BEFORE_UNIT = re.compile(r"(?<=\d) (?=[\d%]|[A-Za-z]{1,2}\b|rad/s)")
_COLUMNS = {"": "value", "p50": "median", "p99": "99 %", "p999": "99.9 %"}


def section(key: str, title: str, *children: Html | None) -> Html:
    """HTML section with a heading, linked from the contents."""
    return tag("section", tag("h2", title), *children, id=key, aria_label=title)


def picture_block(picture: Picture, key: str, back: str) -> Html:
    """Embedded picture with caption; a click shows it in full size, another leads to `back`."""
    data = base64.b64encode(picture.data).decode("ascii")
    image = tag(
        "img",
        src=f"data:image/png;base64,{data}",
        alt=f"{picture.title}. {picture.caption}",
        width=picture.width,
        height=picture.height,
    )
    return tag(
        "figure",
        tag("a", "close", href=f"#{back}", class_="close"),
        tag("a", image, href=f"#{key}", class_="zoom", aria_label=f"{picture.title}, in its own size"),
        tag("figcaption", tag("b", picture.title), ". ", picture.caption, " ", _file(picture)),
        id=key,
    )


def _file(picture: Picture) -> Html:
    return tag("code", f"{picture.name}.png")


def gallery(pictures: Iterable[Picture], damaged: Sequence[str], prefix: str, back: str) -> Html:
    """Gallery of pictures side by side, with the names of unreadable files."""
    shown_ones = [picture_block(picture, f"{prefix}-{i}", back) for i, picture in enumerate(pictures)]
    lost = tag("p", f"No readable pictures: {', '.join(damaged)}.", class_="soft") if damaged else None
    if not shown_ones:
        return join(lost) if lost else tag("p", "No pictures were drawn.", class_="soft")
    return join(tag("div", *shown_ones, class_="gallery"), lost)


def comparison_table(comparisons: Iterable[tuple[ClaimComparison, str, Html]]) -> Html:
    """Table of published and measured values, from rows of claim, measured values as text, and verdict."""
    body, used = [], []
    for compared, here, verdict in comparisons:
        claim = compared.claim
        note = tag("span", claim.note, class_="note") if claim.note else None
        place = f"[{claim.source}] {claim.location}".strip()
        body.append(
            tag(
                "tr",
                tag("th", claim.subject, note, scope="row"),
                tag("td", _join_units(claim.published), data_label="the paper"),
                tag(
                    "td",
                    here,
                    class_="here",
                    data_label="setting" if compared.verdict is Verdict.SETTING else "this run",
                ),
                tag("td", compared.expected, data_label="expected"),
                tag("td", verdict, data_label="verdict"),
                tag("td", place, class_="place", data_label="where"),
            )
        )
        used.append(claim.source)
    heads = ("quantity", "published", "this run (or its setting)", "expected", "", "source")
    table = tag("table", _head(heads), tag("tbody", *body), class_="papers stack")
    sources = [tag("li", tag("b", f"[{key}]"), " ", name) for key, name in SOURCES.items() if key in used]
    return join(tag("div", table, class_="card block"), tag("ul", *sources, class_="sources"))


def _join_units(text: str) -> str:
    """Replace spaces between numbers and units by no-break spaces."""
    return _SPACE_BEFORE_UNIT.sub("\u00a0", text)


def verdict_badge(comparison: ClaimComparison) -> Html:
    """Verdict badge of one run."""
    kind, text = _BADGES[comparison.verdict]
    return tag("span", text, class_=f"badge {kind}")


def metric_cards(groups: Iterable[MetricGroup]) -> Html:
    """Metric cards, one for each group."""
    return tag("div", *map(_metric_card, groups), class_="cards")


def _metric_card(group: MetricGroup) -> Html:
    key = tag("code", f"{group.key}.…") if group.key else None
    parts = [_value_table(group.values) if group.values else None]
    if group.statistics:
        columns = group.columns
        heads = ("", *(_COLUMNS.get(name, name) for name in columns), "")
        rows = [_statistics_row(row, columns) for row in group.statistics]
        parts.append(tag("div", tag("table", _head(heads, "number"), tag("tbody", *rows)), class_="scroll"))
    return tag("div", tag("h3", group.title, " ", key), *parts, class_="card")


def _value_table(rows: Sequence[QuantityRow]) -> Html:
    body = [
        tag(
            "tr",
            tag("th", row.label, scope="row"),
            tag("td", row.texts[""], class_="number" if len(row.texts[""]) < 24 else "text"),
            tag("td", row.unit, class_="unit"),
            title=row.name,
        )
        for row in rows
    ]
    return tag("table", tag("tbody", *body))


def _statistics_row(row: QuantityRow, columns: Sequence[str]) -> Html:
    return tag(
        "tr",
        tag("th", row.label, scope="row"),
        *(tag("td", row.texts.get(name, ""), class_="number") for name in columns),
        tag("td", row.unit, class_="unit"),
        title=row.name,
    )


def _head(names: Iterable[str], kind: str | None = None) -> Html:
    cells = (tag("th", name, scope="col", class_=kind if i else None) for i, name in enumerate(names))
    return tag("thead", tag("tr", *cells))


def pairs_table(rows: Iterable[tuple[str, Any]]) -> Html:
    """Two-column table of names and values."""
    body = (tag("tr", tag("th", name, scope="row"), tag("td", format_value(value))) for name, value in rows)
    return tag("div", tag("table", tag("tbody", *body)), class_="card block scroll")


def flatten(value: Any, name: str = "") -> Iterable[tuple[str, Any]]:
    """Flatten nested tables into pairs of dotted name and value."""
    if isinstance(value, dict) and value:
        for key, item in value.items():
            yield from flatten(item, f"{name}.{key}".lstrip("."))
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        for index, item in enumerate(value):
            yield from flatten(item, f"{name}[{index}]")
    else:
        yield name, value


def deployment_listing(files: RunFiles) -> Html:
    """TOML listing of the deployment as it was run, one collapsible block for each table."""
    if files.deployment is None:
        if not files.deployment_keys:
            return tag("p", "There is no deployment.json beside the summary.", class_="soft")
        why = "It was written by another version of skinnet; its defaults are unknown."
        return join(tag("p", why, class_="soft"), pairs_table(flatten(files.deployment_keys)))
    folds = []
    for part in sections(files.deployment):
        summary = tag("summary", tag("code", part.title), tag("span", part.note, class_="count"))
        text = tag("pre", *map(_line, part.lines), class_="toml", tabindex=0)
        folds.append(tag("details", summary, tag("div", text, class_="inside flush")))
    hint = tag(
        "p",
        "As TOML, every key. ",
        tag("span", "Marked", class_="swatch"),
        " keys differ from the default; entries of lists show only such keys.",
        class_="soft",
    )
    return join(hint, *folds)


def _line(line: Line) -> Html:
    was = tag("i", f"  # default {line.default}") if line.default else None
    return tag("span", line.text, was, "\n", class_="set" if line.differs else None)
