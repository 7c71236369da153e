"""Summary section of a report: outcome, speed, processes, failures, counters."""

from collections.abc import Iterable, Sequence
from typing import Any

from skinnet.analysis.report.claims import ClaimComparison, Verdict
from skinnet.analysis.report.html_blocks import flatten, pairs_table, picture_block
from skinnet.analysis.report.markup import Child, Html, join, tag
from skinnet.analysis.report.run_folder import RunFiles, RunResults, SeedResults, Summary
from skinnet.analysis.report.units import format_number, format_value
from skinnet.runtime.outcome import ProcessFailure, ProcessReport

__all__ = [
    "arithmetic_note",
    "environment_table",
    "kept_count",
    "lead_picture_name",
    "outcome_badge",
    "run_summary",
    "runs_table",
    "skin_size",
    "tiles",
]

_OUTCOMES = {"completed": "good", "completed_with_losses": "warn"}
_THIN = "\u2009"


def outcome_badge(kind: str) -> Html:
    """Outcome badge of a run."""
    return tag("span", kind.replace("_", " "), class_=f"badge {_OUTCOMES.get(kind, 'bad')}")


def tiles(items: Iterable[tuple[str, Child]]) -> Html:
    """Tiles of short facts, side by side."""
    return tag(
        "dl", *(tag("div", tag("dt", name), tag("dd", value)) for name, value in items), class_="tiles"
    )


def facts(items: Iterable[tuple[str, Child]]) -> Html:
    """List of longer facts, below each other."""
    rows = (tag("div", tag("dt", name), tag("dd", value)) for name, value in items)
    return tag("dl", *rows, class_="facts")


def with_unit(value: str, unit: str) -> Html:
    """Value with its unit in small type."""
    return join(value, _THIN, tag("small", unit))


def skin_size(metrics: dict[str, Any]) -> Html | None:
    """Size of the skin: cells and patches, tactile points and sheets."""
    parts = []
    if "size.cells" in metrics:
        parts.append(
            with_unit(format_value(metrics["size.cells"]), f"cells in {metrics['size.patches']} patches")
        )
    if "size.tactile_points" in metrics:
        points = format_value(metrics["size.tactile_points"])
        parts.append(with_unit(points, f"points on {metrics['size.sheets']} sheets"))
    return join(*(join(", " if i else None, part) for i, part in enumerate(parts))) if parts else None


def kept_count(comparisons: Sequence[ClaimComparison]) -> Html | None:
    """Count of expectations kept, of those with a verdict."""
    judged = [one for one in comparisons if one.verdict in (Verdict.WITHIN, Verdict.OUTSIDE)]
    if not judged:
        return None
    within = sum(one.verdict is Verdict.WITHIN for one in judged)
    return with_unit(f"{within} of {len(judged)}", "as expected")


def run_summary(run: RunResults) -> Html:
    """Summary of one run, with the picture of its body beside it."""
    summary = run.summary
    items: list[tuple[str, Child]] = [
        ("outcome", outcome_badge(summary.outcome)),
        ("simulated", with_unit(f"{summary.sim_s:.1f}", "s")),
        ("speed", with_unit(f"{summary.rtf:.2f}", "× real time")),
        ("wall clock", with_unit(f"{summary.wall_s:.1f}", "s")),
        ("seed", str(summary.seed)),
        ("pace", summary.pace),
    ]
    if summary.pace == "realtime":
        items.append(("deadline misses", format_number(summary.deadline_misses)))
    items += [("skin", size)] if (size := skin_size(run.metrics)) else []
    items += [("published values", count)] if (count := kept_count(run.comparisons)) else []
    told: list[tuple[str, Child]] = [("log SHA-256", tag("code", summary.log_sha256))]
    told += [("settings", tag("code", setting)) for setting in summary.settings]
    left = tag("div", tiles(items), facts(told), _process_failures(summary.process_failures))
    rest = (_processes(summary.processes), _counters(summary.counters), _unknown_keys(run))
    return join(_with_lead_picture(left, run.files), *rest)


def lead_picture_name(files: RunFiles) -> str | None:
    """Name of the picture shown beside the summary instead of in the gallery."""
    return "body" if any(picture.name == "body" for picture in files.pictures) else None


def _with_lead_picture(left: Html, files: RunFiles) -> Html:
    name = lead_picture_name(files)
    body = [picture_block(picture, "body", "summary") for picture in files.pictures if picture.name == name]
    return tag("div", left, *body, class_="hero" if body else "hero alone")


def _process_failures(failures: Sequence[ProcessFailure]) -> Html | None:
    if not failures:
        return None
    rows = (
        tag(
            "li",
            tag("span", fault.process, class_="badge bad"),
            f" {fault.cause}",
            tag("pre", "\n".join(fault.last_lines), class_="said") if fault.last_lines else None,
        )
        for fault in failures
    )
    return join(tag("h3", "Process failures"), tag("ul", *rows, class_="process_failures"))


def _processes(processes: Sequence[ProcessReport]) -> Html:
    most_s = max((process.cpu_s for process in processes), default=0.0)
    most_mb = max((process.peak_mb for process in processes), default=0.0)
    heads = ("process", "role", "CPU time", "peak memory", "exit code", "process ID")
    rows = (
        tag(
            "tr",
            tag("th", process.name, scope="row"),
            tag("td", process.role, data_label="role"),
            tag("td", _bar(f"{process.cpu_s:.1f} s", process.cpu_s, most_s), data_label="CPU time"),
            tag("td", _bar(f"{process.peak_mb:.0f} MB", process.peak_mb, most_mb), data_label="peak memory"),
            tag("td", format_value(process.exit_code), data_label="exit code"),
            tag("td", str(process.pid), data_label="process ID"),
        )
        for process in processes
    )
    head = tag("thead", tag("tr", *(tag("th", name, scope="col") for name in heads)))
    return tag("div", tag("table", head, tag("tbody", *rows), class_="stack"), class_="card block")


def _bar(text: str, value: float, maximum: float) -> Html:
    share = 100.0 * value / maximum if maximum > 0.0 else 0.0
    return tag("span", text, tag("span", class_="bar", style=f"--share: {share:.1f}%"))


def _counters(counters: dict[str, dict[str, Any]]) -> Html | None:
    rows = [(f"{process}: {name}", value) for process, own in counters.items() for name, value in own.items()]
    return join(tag("h3", "Counters"), pairs_table(rows)) if rows else None


def _unknown_keys(run: RunResults) -> Html | None:
    return (
        join(tag("h3", "Unknown keys of the summary"), pairs_table(flatten(run.unknown_keys)))
        if run.unknown_keys
        else None
    )


def runs_table(seeds: SeedResults) -> Html:
    """Table of runs, one row for each seed."""
    heads = ("seed", "outcome", "simulated", "speed", "published values", "log SHA-256")
    rows = (
        tag(
            "tr",
            tag("th", str(run.summary.seed), scope="row"),
            tag("td", outcome_badge(run.summary.outcome)),
            tag("td", f"{run.summary.sim_s:.1f} s", class_="number"),
            tag("td", f"{run.summary.rtf:.2f} × real time", class_="number"),
            tag("td", kept_count(run.comparisons) or "–"),
            tag("td", tag("code", run.summary.log_sha256[:16] + "…"), title=run.summary.log_sha256),
        )
        for run in seeds.runs
    )
    kinds = (None, None, "number", "number", None, None)
    cells = (tag("th", name, scope="col", class_=kind) for name, kind in zip(heads, kinds, strict=True))
    table = tag("table", tag("thead", tag("tr", *cells)), tag("tbody", *rows), class_="wide")
    return tag("div", tag("div", table, class_="scroll tall", tabindex=0), class_="card block")


def arithmetic_note(summaries: Sequence[Summary]) -> Html:
    """Note that runs were computed with several arithmetics; empty if with one, or if it is not known."""
    known = {summary.arithmetic["all"] for summary in summaries if "all" in summary.arithmetic}
    if len(known) < 2:
        return Html("")
    return tag(
        "p",
        f"The runs were computed with {len(known)} different arithmetics ({', '.join(sorted(known))}): their "
        "values may differ in the last bits, and their logs cannot be compared.",
    )


def environment_table(known: dict[str, Any], version: str) -> Html:
    """Environment of a run: software versions and computer."""
    if known:
        return pairs_table(known.items())
    return tag("p", f"skinnet {version}; the summary holds no environment.", class_="soft")
