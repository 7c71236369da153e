"""HTML page of a report in one file, without scripts and external resources."""

from collections.abc import Sequence
from importlib.resources import files

from skinnet import __version__
from skinnet.analysis.report import summary_section as overview
from skinnet.analysis.report.claims import ClaimComparison, Verdict, summarise_seeds
from skinnet.analysis.report.html_blocks import (
    comparison_table,
    deployment_listing,
    gallery,
    metric_cards,
    section,
    verdict_badge,
)
from skinnet.analysis.report.markup import Html, join, tag
from skinnet.analysis.report.metric_groups import group_metrics, group_over_seeds
from skinnet.analysis.report.run_folder import Results, RunFiles, RunResults, SeedResults, StressResults
from skinnet.analysis.report.stress_tables import (
    belongs_to_point,
    is_threshold,
    point_metrics,
    points_table,
    thresholds_table,
)

__all__ = ["render_html"]

_CONTENT_SECURITY_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""Content Security Policy: the browser loads and runs nothing, whatever a file of the run folder contains."""


def render_html(results: Results) -> str:
    """Render results as an HTML page."""
    match results:
        case RunResults():
            return _page(results.summary.deployment, f"seed {results.summary.seed}", _run(results))
        case SeedResults():
            name = results.runs[0].summary.deployment
            return _page(name, f"{len(results.runs)} seeds", _seeds(results))
        case StressResults():
            return _page(results.summary.deployment, "under stress", _stress(results))


def _page(name: str, subtitle: str, sections: Sequence[tuple[str, str, Html]]) -> str:
    """HTML page of sections (key, title, content), with linked contents."""
    style = (files("skinnet.analysis.report") / "style.css").read_text(encoding="utf-8")
    title = f"{name}, {subtitle}"
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", http_equiv="Content-Security-Policy", content=_CONTENT_SECURITY_POLICY),
        tag("meta", name="color-scheme", content="light dark"),
        tag("meta", name="generator", content=f"skinnet {__version__}"),
        tag("link", rel="icon", href="data:,"),
        tag("title", f"{title} · skinnet"),
        tag("style", Html(style)),
    )
    links = (tag("li", tag("a", title, href=f"#{key}")) for key, title, _ in sections)
    top = tag(
        "header",
        tag("p", "skinnet report", class_="kicker"),
        tag("h1", name),
        tag("p", subtitle, class_="lead"),
        class_="top",
    )
    body = tag(
        "div",
        top,
        tag(
            "div",
            tag("nav", tag("ul", *links), class_="contents", aria_label="Contents"),
            tag("main", *(section(key, title, content) for key, title, content in sections)),
            class_="columns",
        ),
        tag(
            "footer",
            f"Made by skinnet {__version__} from the results alone; no external resources are loaded.",
        ),
        class_="frame",
    )
    return "<!doctype html>\n" + tag("html", head, tag("body", body), lang="en") + "\n"


def _run(run: RunResults) -> list[tuple[str, str, Html]]:
    rest = [
        picture for picture in run.files.pictures if picture.name != overview.lead_picture_name(run.files)
    ]
    sections = [("summary", "Summary", overview.run_summary(run))]
    if run.comparisons:
        rows = ((compared, compared.measured_text, verdict_badge(compared)) for compared in run.comparisons)
        sections.append(("papers", "Comparison with the papers", comparison_table(rows)))
    sections += [
        ("pictures", "Plots", gallery(rest, run.files.damaged_files, "plot", "pictures")),
        ("metrics", "Figures", metric_cards(group_metrics(run.metrics, _group_titles(run.files)))),
        ("deployment", "The deployment", deployment_listing(run.files)),
        ("versions", "Versions", overview.environment_table(run.summary.environment, run.summary.version)),
    ]
    return sections


def _seeds(seeds: SeedResults) -> list[tuple[str, str, Html]]:
    runs, one = seeds.runs, seeds.runs[0]
    outcomes = [run.summary.outcome for run in runs]
    tiles = overview.tiles(
        [
            ("seeds", str(len(runs))),
            ("completed", f"{outcomes.count('completed')} of {len(runs)}"),
            ("simulated", overview.with_unit(f"{sum(run.summary.sim_s for run in runs):.0f}", "s")),
            ("different logs", str(len({run.summary.log_sha256 for run in runs}))),
        ]
    )
    note = overview.arithmetic_note([run.summary for run in runs])
    sections = [("summary", "Summary", join(tiles, note, overview.runs_table(seeds)))]
    if any(run.comparisons for run in runs):
        sections.append(("papers", "Comparison with the papers", comparison_table(_claims_over_seeds(runs))))
    metrics = metric_cards(group_over_seeds([run.metrics for run in runs], _group_titles(one.files)))
    plots = [
        tag(
            "details",
            tag("summary", run.name, tag("span", f"{len(run.files.pictures)} plots", class_="count")),
            tag(
                "div",
                gallery(run.files.pictures, run.files.damaged_files, f"plot-{number}", "pictures"),
                class_="inside",
            ),
        )
        for number, run in enumerate(runs)
        if run.files.pictures or run.files.damaged_files
    ]
    sections += [
        ("pictures", "Plots", join(*plots) if plots else gallery((), (), "plot", "pictures")),
        ("metrics", "Metrics over all seeds", metrics),
        ("deployment", "The deployment", join(_first_seed(one), deployment_listing(one.files))),
        ("versions", "Versions", overview.environment_table(one.summary.environment, one.summary.version)),
    ]
    return sections


def _first_seed(run: RunResults) -> Html:
    return tag(
        "p", f"Deployment of seed {run.summary.seed}; the others differ only in the seed.", class_="soft"
    )


def _claims_over_seeds(runs: Sequence[RunResults]) -> list[tuple[ClaimComparison, str, Html]]:
    """Claims over all seeds, each once: metrics of all runs, and how many of the runs keep it."""
    rows = []
    for claim in dict.fromkeys(compared.claim for run in runs for compared in run.comparisons):
        found = [one for run in runs for one in run.comparisons if one.claim == claim]
        within = sum(one.verdict is Verdict.WITHIN for one in found)
        outside = sum(one.verdict is Verdict.OUTSIDE for one in found)
        sign, kind = ("✗", "bad") if outside else ("✓", "good")
        badge = tag("span", f"{sign} {within} of {len(found)}", class_=f"badge {kind}")
        rows.append(
            (found[0], summarise_seeds(found), badge if within or outside else verdict_badge(found[0]))
        )
    return rows


def _stress(stress: StressResults) -> list[tuple[str, str, Html]]:
    summary = stress.summary
    rest = {
        name: value
        for name, value in stress.metrics.items()
        if not belongs_to_point(name, stress) and not is_threshold(name)
    }
    items = [
        ("points", str(len(summary.points))),
        ("failed", str(len(summary.failed))),
        ("measured", overview.with_unit(f"{summary.stress.get('duration_s', 0):g}", "s a point")),
    ]
    items += [("skin", size)] if (size := overview.skin_size(stress.metrics)) else []
    items += [("published values", count)] if (count := overview.kept_count(stress.comparisons)) else []
    failed = [tag("p", tag("b", name), f" failed: {why}") for name, why in summary.failed.items()]
    sections = [("summary", "Summary", join(overview.tiles(items), *failed, points_table(stress)))]
    if stress.comparisons:
        rows = (
            (compared, compared.measured_text, verdict_badge(compared)) for compared in stress.comparisons
        )
        sections.append(("papers", "Comparison with the papers", comparison_table(rows)))
    sections += [
        ("pictures", "Plots", gallery(stress.files.pictures, stress.files.damaged_files, "plot", "pictures")),
        (
            "metrics",
            "Figures",
            join(thresholds_table(stress), metric_cards(group_metrics(rest)), point_metrics(stress)),
        ),
        ("deployment", "The deployment", deployment_listing(stress.files)),
        ("versions", "Versions", overview.environment_table(summary.environment, "of the sweep")),
    ]
    return sections


def _group_titles(files: RunFiles) -> dict[str, str]:
    """Titles of metric groups that only this deployment has."""
    if files.deployment is None or files.deployment.nursing is None:
        return {}
    label = files.deployment.nursing.label
    return {label: "Nursing" if label == "nursing" else f"Nursing, experiment {label}"}
