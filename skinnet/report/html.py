"""HTML page of a report in one file, without scripts and external resources."""

from collections.abc import Sequence
from importlib.resources import files

from skinnet import __version__
from skinnet.report import overview
from skinnet.report.blocks import cards, comparison, deployment, gallery, kept, section
from skinnet.report.claims import Compared, Verdict, together
from skinnet.report.collect import Made, Results, Run, Seeds, Stress
from skinnet.report.groups import groups, spread
from skinnet.report.markup import Html, join, tag
from skinnet.report.sweep import is_of_a_point, is_threshold, of_each_point, points, thresholds

__all__ = ["render"]

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""Content Security Policy: the browser loads and runs nothing, whatever a file of the run folder contains."""


def render(results: Results) -> str:
    """Render results as an HTML page."""
    match results:
        case Run():
            return _page(results.summary.deployment, f"seed {results.summary.seed}", _run(results))
        case Seeds():
            name = results.runs[0].summary.deployment
            return _page(name, f"{len(results.runs)} seeds", _seeds(results))
        case Stress():
            return _page(results.summary.deployment, "under stress", _stress(results))


def _page(name: str, what: str, sections: Sequence[tuple[str, str, Html]]) -> str:
    """HTML page of sections (key, title, content), with linked contents."""
    style = (files("skinnet.report") / "style.css").read_text(encoding="utf-8")
    title = f"{name}, {what}"
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", http_equiv="Content-Security-Policy", content=_POLICY),
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
        tag("p", what, class_="lead"),
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
        tag("footer", f"Made by skinnet {__version__} from the results alone; nothing in it is loaded."),
        class_="frame",
    )
    return "<!doctype html>\n" + tag("html", head, tag("body", body), lang="en") + "\n"


def _run(run: Run) -> list[tuple[str, str, Html]]:
    rest = [picture for picture in run.made.pictures if picture.name != overview.hero_of(run.made)]
    sections = [("summary", "Summary", overview.of_run(run))]
    if run.compared:
        rows = ((compared, compared.here, kept(compared)) for compared in run.compared)
        sections.append(("papers", "Beside the paper", comparison(rows)))
    sections += [
        ("pictures", "Plots", gallery(rest, run.made.damaged, "plot", "pictures")),
        ("figures", "Figures", cards(groups(run.figures, _titles(run.made)))),
        ("deployment", "The deployment", deployment(run.made)),
        ("versions", "Versions", overview.environment(run.summary.environment, run.summary.version)),
    ]
    return sections


def _seeds(seeds: Seeds) -> list[tuple[str, str, Html]]:
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
    sections = [("summary", "Summary", join(tiles, overview.runs_table(seeds)))]
    if any(run.compared for run in runs):
        sections.append(("papers", "Beside the paper", comparison(_over_seeds(runs))))
    figures = cards(spread([run.figures for run in runs], _titles(one.made)))
    plots = [
        tag(
            "details",
            tag("summary", run.name, tag("span", f"{len(run.made.pictures)} plots", class_="count")),
            tag(
                "div",
                gallery(run.made.pictures, run.made.damaged, f"plot-{number}", "pictures"),
                class_="inside",
            ),
        )
        for number, run in enumerate(runs)
        if run.made.pictures or run.made.damaged
    ]
    sections += [
        ("pictures", "Plots", join(*plots) if plots else gallery((), (), "plot", "pictures")),
        ("figures", "Figures over all seeds", figures),
        ("deployment", "The deployment", join(_first_seed(one), deployment(one.made))),
        ("versions", "Versions", overview.environment(one.summary.environment, one.summary.version)),
    ]
    return sections


def _first_seed(run: Run) -> Html:
    return tag("p", f"That of seed {run.summary.seed}; the others differ in their seed only.", class_="soft")


def _over_seeds(runs: Sequence[Run]) -> list[tuple[Compared, str, Html]]:
    """Claims over all seeds, each once: metrics of all runs, and how many of the runs keep it."""
    rows = []
    for claim in dict.fromkeys(compared.claim for run in runs for compared in run.compared):
        found = [one for run in runs for one in run.compared if one.claim == claim]
        within = sum(one.verdict is Verdict.WITHIN for one in found)
        outside = sum(one.verdict is Verdict.OUTSIDE for one in found)
        sign, kind = ("✗", "bad") if outside else ("✓", "good")
        badge = tag("span", f"{sign} {within} of {len(found)}", class_=f"badge {kind}")
        rows.append((found[0], together(found), badge if within or outside else kept(found[0])))
    return rows


def _stress(stress: Stress) -> list[tuple[str, str, Html]]:
    summary = stress.summary
    rest = {
        name: value
        for name, value in stress.figures.items()
        if not is_of_a_point(name, stress) and not is_threshold(name)
    }
    items = [
        ("points", str(len(summary.points))),
        ("failed", str(len(summary.failed))),
        ("measured", overview.with_unit(f"{summary.stress.get('duration_s', 0):g}", "s a point")),
    ]
    items += [("skin", size)] if (size := overview.skin(stress.figures)) else []
    items += [("figures of the paper", count)] if (count := overview.verdicts(stress.compared)) else []
    failed = [tag("p", tag("b", name), f" failed: {why}") for name, why in summary.failed.items()]
    sections = [("summary", "Summary", join(overview.tiles(items), *failed, points(stress)))]
    if stress.compared:
        rows = ((compared, compared.here, kept(compared)) for compared in stress.compared)
        sections.append(("papers", "Beside the paper", comparison(rows)))
    sections += [
        ("pictures", "Plots", gallery(stress.made.pictures, stress.made.damaged, "plot", "pictures")),
        ("figures", "Figures", join(thresholds(stress), cards(groups(rest)), of_each_point(stress))),
        ("deployment", "The deployment", deployment(stress.made)),
        ("versions", "Versions", overview.environment(summary.environment, "of the sweep")),
    ]
    return sections


def _titles(made: Made) -> dict[str, str]:
    """Titles of metric groups that only this deployment has."""
    if made.deployment is None or made.deployment.nursing is None:
        return {}
    label = made.deployment.nursing.label
    return {label: "Nursing" if label == "nursing" else f"Nursing, experiment {label}"}
